"""The whole camera: from linear light to an infrared pair."""

from __future__ import annotations

from dataclasses import dataclass

from starling.diagnosis.validation.camera import (
    alignment,
    imager,
    lens,
    outside,
    projector,
    readout,
    scene_light,
    speckle,
)
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.dots import Dots
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import SIDES, Image, Light
from starling.diagnosis.validation.camera.readout import Codes


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Pair:
    """Infrared images (h, w), 8 bit if the codes have so few, else 16."""

    left: Codes
    right: Codes


def expose(light: Light, strengths: Strengths, found: Dots, draws: Draws) -> Pair:
    """Take an infrared pair of a scene.

    Args:
        light: The scene's linear light.
        strengths: The camera and its effects.
        found: The projector's dots, of all scenes that this camera sees.
        draws: Random numbers of this scene and frame.
    """
    images = {side: _image(light, strengths, found, draws, side) for side in SIDES}
    return Pair(left=images["left"], right=images["right"])


def at_pixels(light: Light, strengths: Strengths, found: Dots, draws: Draws, side: str) -> Image:
    """Expected electrons of one exposure in the pixels of one imager (h, w)."""
    nominal = strengths.nominal
    view = light.view(side)
    thrown = projector.throw(view, strengths, found, draws)
    arriving = scene_light.leave(thrown, strengths)
    if side == "right":
        arriving = outside.displace_body(arriving, light, strengths, draws)
    laser = lens.focus(arriving.laser_e, view, strengths)
    rest = lens.focus(arriving.rest_e, view, strengths)
    exponent = strengths.of("vignetting")
    if exponent != 0.0:
        dim = lens.vignetting(nominal, exponent)
        laser, rest = laser * dim, rest * dim
    laser, rest = lens.veil(laser, rest, strengths.of("veil"))
    where = alignment.of_side(side, strengths)
    laser = alignment.land(laser, where, nominal)
    rest = alignment.land(rest, where, nominal)
    grain = speckle.grain(
        nominal.shape,
        strengths.of("laser_speckle"),
        nominal,
        draws.of_scene(f"{side}/speckle"),
    )
    landed = laser * grain + rest
    landed = outside.ghost(landed, strengths.of("lens_ghost"))
    landed = outside.lamps(landed, view, strengths.of("mains_banding"), draws)
    landed = outside.astigmatism(landed, strengths.of("astigmatism"), nominal)
    landed = outside.finger_print(landed, strengths.of("finger_print"), side, draws)
    return outside.ramp(landed, strengths.of("brightness_ramp"), draws.frame)


def _image(light: Light, strengths: Strengths, found: Dots, draws: Draws, side: str) -> Codes:
    held = imager.charge(at_pixels(light, strengths, found, draws, side), strengths, side, draws)
    held = outside.column_rain(
        held, strengths.of("column_rain"), strengths.of("saturation"), side, draws
    )
    dn = outside.compress(readout.codes(held, strengths), strengths.of("block_compression"))
    return readout.whole(dn, round(strengths.of("quantisation")))
