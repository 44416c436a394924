"""The imaging chain of the camera: from linear light to an infrared pair."""

from __future__ import annotations

from dataclasses import dataclass

from starling.diagnosis.validation.camera import imager, light, optics, outside, projector
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.imager import Codes
from starling.diagnosis.validation.camera.light import SIDES, SceneLight
from starling.diagnosis.validation.camera.projector import Dots
from starling.diagnosis.validation.camera.psf import Image


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ExposedPair:
    """Infrared images (h, w): uint8 for at most 8 bits, else uint16 [DN]."""

    left: Codes
    right: Codes


def expose(scene: SceneLight, strengths: Strengths, dots: Dots, draws: Draws) -> ExposedPair:
    """Expose an infrared pair of a scene.

    Args:
        scene: Linear light of the scene.
        strengths: Nominal camera and effect strengths.
        dots: Dots of the projector, gathered from all scenes of the capture set.
        draws: Random streams of this scene and frame.
    """
    images = {side: _expose_imager(scene, strengths, dots, draws, side) for side in SIDES}
    return ExposedPair(left=images["left"], right=images["right"])


def expected_electrons(
    scene: SceneLight, strengths: Strengths, dots: Dots, draws: Draws, side: str
) -> Image:
    """Return the expected electrons per pixel (h, w) of one exposure of one imager."""
    nominal = strengths.nominal
    view = scene.view(side)
    projected = projector.project(view, strengths, dots, draws)
    received = light.leave(projected, strengths)
    if side == "right":
        received = outside.displace_body(received, scene, strengths, draws)
    laser = optics.focus(received.laser_e, view, strengths)
    rest = optics.focus(received.rest_e, view, strengths)
    exponent = strengths["vignetting"]
    if exponent != 0.0:
        factor = optics.vignetting(nominal, exponent)
        laser, rest = laser * factor, rest * factor
    laser, rest = optics.veil(laser, rest, strengths["veil"])
    misalignment = optics.imager_alignment(side, strengths)
    laser = optics.resample(laser, misalignment, nominal)
    rest = optics.resample(rest, misalignment, nominal)
    grain = optics.speckle(
        nominal.shape,
        strengths["laser_speckle"],
        nominal,
        draws.scene_rng(f"{side}/speckle"),
    )
    image = laser * grain + rest
    image = outside.ghost(image, strengths["lens_ghost"])
    image = outside.lamps(image, view, strengths["mains_banding"], draws)
    image = outside.astigmatism(image, strengths["astigmatism"], nominal)
    image = outside.finger_print(image, strengths["finger_print"], side, draws)
    return outside.ramp(image, strengths["brightness_ramp"], draws.frame)


def _expose_imager(
    scene: SceneLight, strengths: Strengths, dots: Dots, draws: Draws, side: str
) -> Codes:
    charge_e = imager.charge(
        expected_electrons(scene, strengths, dots, draws, side), strengths, side, draws
    )
    charge_e = outside.column_rain(
        charge_e, strengths["column_rain"], strengths["saturation"], side, draws
    )
    dn = outside.compress(imager.codes(charge_e, strengths), strengths["block_compression"])
    return imager.round_codes(dn, round(strengths["quantisation"]))
