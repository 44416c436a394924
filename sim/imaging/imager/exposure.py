"""Exposure: radiance at the lens to mean electrons in a pixel."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from starling.sim.arrays import Image
from starling.sim.sensor.sensor import Imager, Sensor

_PLANCK_J_S = 6.62607015e-34
_LIGHT_M_S = 299792458.0


@dataclass(frozen=True, kw_only=True, slots=True)
class Exposure:
    """Integration time and gain of a frame."""

    exposure_s: float
    gain: float


def read_exposure(record: Mapping[str, Any]) -> Exposure | None:
    """Read the exposure from a frame's record (`frame.json`).

    Args:
        record: the record; `exposure_s` and `gain` are read.

    Returns:
        The exposure, or None unless both numbers are finite and > 0. A warning reports an exposure
        time that is not used because the gain is unknown.
    """
    entries = [record.get(name) for name in ("exposure_s", "gain")]
    known = [
        float(value)
        for value in entries
        if isinstance(value, (int, float)) and not isinstance(value, bool) and 0 < value < math.inf
    ]
    if len(known) == 1 and record.get("exposure_s") == known[0] and not record.get("gain"):
        warnings.warn("frame.json: exposure_s is not used without gain.", stacklevel=2)
    return Exposure(exposure_s=known[0], gain=known[1]) if len(known) == 2 else None


def electrons_per_radiance(imager: Imager, wavelength_nm: float, exposure_s: float) -> float:
    """Return the mean electrons in a pixel on the axis for a radiance of 1 W m^-2 sr^-1.

    The image irradiance is pi L T / (4 N^2) for a thin lens and a distant object. The charge is
    this times pixel area, integration time and quantum efficiency, over the photon energy
    h c / lambda.

    Source: EMVA Standard 1288, release 4.0, eqs. 1 to 4; image irradiance: Horn, Robot Vision,
    sec. 10.3.
    """
    irradiance = np.pi * imager.lens.transmission / (4 * imager.lens.f_number**2)
    photon_j = _PLANCK_J_S * _LIGHT_M_S / (wavelength_nm * 1e-9)
    energy_j = irradiance * imager.pixel_pitch_m**2 * exposure_s
    return float(energy_j / photon_j * imager.quantum_efficiency)


def choose_exposure(imager: Imager, radiance: Image, wavelength_nm: float) -> Exposure:
    """Choose the exposure: the fixed one, or one that brings the mean signal to the set level.

    Auto exposure changes the integration time up to `auto_exposure_max_s`, and then the gain up to
    `auto_exposure_max_gain`. It meters the light before noise and gamma, in the middle of the
    image (`metered_rows_columns`).

    Source: librealsense#3925, gain takes over at the exposure's limit; #8220, gain codes 16 to 248.
    """
    if imager.auto_exposure_level == 0:
        return Exposure(exposure_s=imager.exposure_s, gain=imager.gain)
    metered = radiance[metered_rows_columns(radiance.shape, imager.auto_exposure_roi)]
    per_second = electrons_per_radiance(imager, wavelength_nm, 1.0) * float(metered.mean())
    aim_dn = imager.auto_exposure_level * imager.ceiling_dn - imager.black_level_dn
    wanted = max(aim_dn, 1.0) / max(per_second * imager.dn_per_electron, 1e-30)
    exposure_s = min(wanted, imager.auto_exposure_max_s)
    if imager.auto_exposure_max_gain <= imager.gain:
        return Exposure(exposure_s=exposure_s, gain=imager.gain)
    gain = min(imager.gain * wanted / exposure_s, imager.auto_exposure_max_gain)
    return Exposure(exposure_s=exposure_s, gain=gain)


def metered_rows_columns(shape: tuple[int, ...], share: float) -> tuple[slice, slice]:
    """Return the rows and columns of the middle of an image (h, w) that are metered."""
    rows, columns = (
        slice(first, max(side - first, first + 1))
        for side in shape
        for first in (round(side * (1 - share) / 2),)
    )
    return rows, columns


def at_gain(sensor: Sensor, exposure: Exposure) -> Sensor:
    """Return a sensor at the gain of an exposure; the right imager's gain keeps its ratio."""
    if exposure.gain == sensor.left.gain:
        return sensor
    ratio = exposure.gain / sensor.left.gain
    left, right = (
        dataclasses.replace(part, gain=part.gain * ratio) for part in (sensor.left, sensor.right)
    )
    return dataclasses.replace(sensor, left=left, right=right)


def mean_electrons(
    imager: Imager, radiance: Image, wavelength_nm: float, exposure: Exposure
) -> Image:
    """Return the expected electrons per pixel, before noise (h, w)."""
    scale = electrons_per_radiance(imager, wavelength_nm, exposure.exposure_s)
    return radiance * np.float32(scale)
