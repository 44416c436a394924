"""Light as numbers: from a projector's power to radiant intensity, from radiance to electrons."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal

_PLANCK_J_S = 6.62607015e-34
_LIGHT_M_S = 299792458.0


def electrons_per_radiance(camera: Nominal, transmission: float) -> float:
    """Electrons in a pixel for a radiance of 1 W m^-2 sr^-1 at the lens.

    A lens of f-number N lays pi L T / (4 N^2) on the imager's plane on its axis (the small-angle
    form, as docs of this project count); times the pixel's area and the time this is energy, over
    h c / wavelength photons, of which the quantum efficiency become electrons.

    Args:
        camera: nominal.
        transmission: T of lens and filter, in (0, 1].

    Raises:
        WithheldError: if nominal.json leaves out what this needs, or the transmission cannot be.
    """
    told = {
        "quantum_efficiency": camera.quantum_efficiency,
        "pixel_pitch_m": camera.pixel_pitch_m,
        "f_number": camera.f_number,
        "wavelength_nm": camera.wavelength_nm,
    }
    known = {name: value for name, value in told.items() if value is not None}
    if len(known) < len(told):
        missing = ", ".join(sorted(set(told) - set(known)))
        raise refusal("nominal.json", "must tell of the imager's light", f"no {missing}", "Add it.")
    if not 0 < transmission <= 1:
        raise refusal("transmission", "must be in (0, 1]", transmission, "1 is a perfect lens.")
    irradiance = math.pi * transmission / (4 * known["f_number"] ** 2)
    energy_j = irradiance * known["pixel_pitch_m"] ** 2 * camera.exposure_s
    photons = energy_j * known["wavelength_nm"] * 1e-9 / (_PLANCK_J_S * _LIGHT_M_S)
    return photons * known["quantum_efficiency"]


def intensity_w_sr(
    shape_of_light: NDArray[np.floating], half_tangents: tuple[float, float], power_w: float
) -> NDArray[np.float32]:
    """Radiant intensity [W sr^-1] of a point whose light on a plane across its axis is known.

    At a tangent vector t from the axis the plane at unit distance is sqrt(1 + t^2) away and
    inclined by the angle of that cosine's inverse: it receives I / (1 + t^2)^(3/2). Its area
    times what it receives is the power, all of which passes it.

    Args:
        shape_of_light: (h, w) >= 0, irradiance of the plane at any scale over the field; pixels are
            even in tangents, the field ends half a pixel beyond the outer centres.
        half_tangents: of half the field, across and down.
        power_w: all light.

    Returns:
        (h, w), at the pixels' centres.
    """
    height, width = shape_of_light.shape
    half_x, half_y = half_tangents
    area_m2 = 4 * half_x * half_y
    scale = power_w / (area_m2 * float(shape_of_light.mean(dtype=np.float64)))
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * half_x
    y = ((np.arange(height) + 0.5) / height * 2 - 1) * half_y
    slant = (1 + x[None, :] ** 2 + y[:, None] ** 2) ** 1.5
    return (shape_of_light * scale * slant).astype(np.float32)
