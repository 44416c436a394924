"""Radiometry: from projector power to radiant intensity, and from radiance to electrons."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal

_PLANCK_J_S = 6.62607015e-34
_LIGHT_M_S = 299792458.0


def electrons_per_radiance(camera: Nominal, transmission: float) -> float:
    """Return the electrons per pixel for a radiance of 1 W m^-2 sr^-1 at the lens.

    A lens of f-number N gives an on-axis irradiance of pi L T / (4 N^2) (small-angle form, the
    convention of this project). Irradiance times pixel area and exposure is energy. Energy over
    h c / wavelength is photons, and the quantum efficiency converts them to electrons.

    Args:
        camera: Nominal camera.
        transmission: Transmission T of lens and filter, in (0, 1].

    Raises:
        WithheldError: if nominal.json lacks a needed value, or the transmission is out of range.
    """
    required = {
        "quantum_efficiency": camera.quantum_efficiency,
        "pixel_pitch_m": camera.pixel_pitch_m,
        "f_number": camera.f_number,
        "wavelength_nm": camera.wavelength_nm,
    }
    known = {name: value for name, value in required.items() if value is not None}
    if len(known) < len(required):
        missing = ", ".join(sorted(set(required) - set(known)))
        rule = "must hold the optical data of the imager"
        raise refusal("nominal.json", rule, f"no {missing}", "Add it.")
    if not 0 < transmission <= 1:
        raise refusal("transmission", "must be in (0, 1]", transmission, "1 is a perfect lens.")
    irradiance = math.pi * transmission / (4 * known["f_number"] ** 2)
    energy_j = irradiance * known["pixel_pitch_m"] ** 2 * camera.exposure_s
    photons = energy_j * known["wavelength_nm"] * 1e-9 / (_PLANCK_J_S * _LIGHT_M_S)
    return photons * known["quantum_efficiency"]


def intensity_w_sr(
    shape_of_light: NDArray[np.floating], half_tangents: tuple[float, float], power_w: float
) -> NDArray[np.float32]:
    """Return the radiant intensity [W sr^-1] of a point source with a given pattern and power.

    At a tangent vector t from the axis, a plane at unit distance receives the irradiance
    I / (1 + t^2)^(3/2). The irradiance integrated over the field is the power.

    Args:
        shape_of_light: Relative irradiance (h, w) >= 0 of the plane across the axis. Pixels are
            uniform in tangents. The field ends half a pixel beyond the outer pixel centres.
        half_tangents: Tangents of half the field (x, y).
        power_w: Total optical power [W].

    Returns:
        Radiant intensity (h, w) [W sr^-1] at the pixel centres.
    """
    height, width = shape_of_light.shape
    half_x, half_y = half_tangents
    area_m2 = 4 * half_x * half_y
    scale = power_w / (area_m2 * float(shape_of_light.mean(dtype=np.float64)))
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * half_x
    y = ((np.arange(height) + 0.5) / height * 2 - 1) * half_y
    obliquity = (1 + x[None, :] ** 2 + y[:, None] ** 2) ** 1.5
    return (shape_of_light * scale * obliquity).astype(np.float32)
