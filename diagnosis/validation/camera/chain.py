"""The imaging chain of the camera: from linear light to an infrared pair."""

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
from starling.diagnosis.validation.camera.dots import ProjectorDots
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import SIDES, Image, SceneLight
from starling.diagnosis.validation.camera.readout import Codes


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ExposedPair:
    """Infrared images (h, w): uint8 for at most 8 bits, else uint16 [DN]."""

    left: Codes
    right: Codes


def expose(
    light: SceneLight, strengths: Strengths, dots: ProjectorDots, draws: Draws
) -> ExposedPair:
    """Expose an infrared pair of a scene.

    Args:
        light: Linear light of the scene.
        strengths: Nominal camera and effect strengths.
        dots: Dots of the projector, gathered from all scenes of the capture set.
        draws: Random streams of this scene and frame.
    """
    images = {side: _expose_imager(light, strengths, dots, draws, side) for side in SIDES}
    return ExposedPair(left=images["left"], right=images["right"])


def expected_electrons(
    light: SceneLight, strengths: Strengths, dots: ProjectorDots, draws: Draws, side: str
) -> Image:
    """Return the expected electrons per pixel (h, w) of one exposure of one imager."""
    nominal = strengths.nominal
    view = light.view(side)
    projected = projector.project(view, strengths, dots, draws)
    received = scene_light.leave(projected, strengths)
    if side == "right":
        received = outside.displace_body(received, light, strengths, draws)
    laser = lens.focus(received.laser_e, view, strengths)
    rest = lens.focus(received.rest_e, view, strengths)
    exponent = strengths.value("vignetting")
    if exponent != 0.0:
        factor = lens.vignetting(nominal, exponent)
        laser, rest = laser * factor, rest * factor
    laser, rest = lens.veil(laser, rest, strengths.value("veil"))
    misalignment = alignment.imager_alignment(side, strengths)
    laser = alignment.resample(laser, misalignment, nominal)
    rest = alignment.resample(rest, misalignment, nominal)
    grain = speckle.grain(
        nominal.shape,
        strengths.value("laser_speckle"),
        nominal,
        draws.scene_rng(f"{side}/speckle"),
    )
    image = laser * grain + rest
    image = outside.ghost(image, strengths.value("lens_ghost"))
    image = outside.lamps(image, view, strengths.value("mains_banding"), draws)
    image = outside.astigmatism(image, strengths.value("astigmatism"), nominal)
    image = outside.finger_print(image, strengths.value("finger_print"), side, draws)
    return outside.ramp(image, strengths.value("brightness_ramp"), draws.frame)


def _expose_imager(
    light: SceneLight, strengths: Strengths, dots: ProjectorDots, draws: Draws, side: str
) -> Codes:
    charge_e = imager.charge(
        expected_electrons(light, strengths, dots, draws, side), strengths, side, draws
    )
    charge_e = outside.column_rain(
        charge_e, strengths.value("column_rain"), strengths.value("saturation"), side, draws
    )
    dn = outside.compress(readout.codes(charge_e, strengths), strengths.value("block_compression"))
    return readout.round_codes(dn, round(strengths.value("quantisation")))
