"""Laser speckle on the imagers: static while nothing moves, independent in each imager."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

from starling.sim import randomness
from starling.sim.arrays import Image
from starling.sim.imaging import speckle_field
from starling.sim.sensor.sensor import Imager, Projector


def apply_speckle(
    laser: Image,
    imager: Imager,
    projector: Projector,
    side: Literal["left", "right"],
    *,
    seed: int,
) -> Image:
    """Multiply the laser's light by speckle; the input array if the contrast is 0.

    Args:
        laser: (h, w) the laser's light, blurred by the lens [W m^-2 sr^-1].
        imager: its aperture sets the grain size.
        projector: supplies wavelength and speckle contrast.
        side: which imager; speckle is independent in each.
        seed: seed of the capture; its frames share the speckle.
    """
    if projector.speckle_contrast == 0:
        return laser
    grain_px = speckle_field.grain_px(
        wavelength_nm=projector.wavelength_nm,
        f_number=imager.lens.f_number,
        pixel_pitch_m=imager.pixel_pitch_m,
    )
    height, width = laser.shape
    return laser * _field((height, width), projector.speckle_contrast, grain_px, side, seed)


@lru_cache(maxsize=2)  # Both imagers: the frames of a capture share one draw.
def _field(shape: tuple[int, int], contrast: float, grain_px: float, side: str, seed: int) -> Image:
    rng = randomness.generator(seed, 0, "optics", f"speckle {side}")
    field = speckle_field.field(shape, contrast=contrast, grain_px=grain_px, rng=rng)
    field.setflags(write=False)  # The cache returns the same array to all callers.
    return field
