"""Exposure: from radiance at the lens to the mean electrons a pixel collects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from starling.sim.render.layers import Image
from starling.sim.sensor.sensor import Imager

_PLANCK_J_S = 6.62607015e-34
_LIGHT_M_S = 299792458.0


@dataclass(frozen=True, kw_only=True, slots=True)
class Exposure:
    """What the exposure control chose."""

    exposure_s: float
    gain: float


def recorded(record: Mapping[str, Any]) -> Exposure | None:
    """The exposure that a frame's record (`frame.json`) tells; None where it tells none that can
    be: both numbers must be finite and > 0.

    Args:
        record: by key, `exposure_s` and `gain` among them.
    """
    told = [record.get(name) for name in ("exposure_s", "gain")]
    known = [
        float(one)
        for one in told
        if isinstance(one, (int, float)) and not isinstance(one, bool) and 0 < one < math.inf
    ]
    return Exposure(exposure_s=known[0], gain=known[1]) if len(known) == 2 else None


def electrons_per_radiance(imager: Imager, wavelength_nm: float, exposure_s: float) -> float:
    """Mean electrons in a pixel for a radiance of 1 W m^-2 sr^-1 at the lens, on the axis.

    Image irradiance pi L T / (4 N^2) (thin lens, object far away), times the pixel's area and
    time, over the energy h c / lambda of a photon, times the quantum efficiency.

    Source: EMVA Standard 1288, release 4.0, eqs. 1 to 4; image irradiance: Horn, Robot Vision,
    sec. 10.3.
    """
    irradiance = np.pi * imager.lens.transmission / (4 * imager.lens.f_number**2)
    photon_j = _PLANCK_J_S * _LIGHT_M_S / (wavelength_nm * 1e-9)
    energy_j = irradiance * imager.pixel_pitch_m**2 * exposure_s
    return float(energy_j / photon_j * imager.quantum_efficiency)


def control(imager: Imager, radiance: Image, wavelength_nm: float) -> Exposure:
    """Choose the exposure: fixed, or such that the mean signal meets the level aimed at.

    Auto exposure changes the integration time up to `auto_exposure_max_s`; the gain stays. It
    meters the light, before all noise and before gamma.
    """
    if imager.auto_exposure_level == 0:
        return Exposure(exposure_s=imager.exposure_s, gain=imager.gain)
    per_second = electrons_per_radiance(imager, wavelength_nm, 1.0) * float(radiance.mean())
    aim_dn = imager.auto_exposure_level * imager.ceiling_dn - imager.black_level_dn
    wanted = max(aim_dn, 1.0) / max(per_second * imager.dn_per_electron, 1e-30)
    return Exposure(exposure_s=min(wanted, imager.auto_exposure_max_s), gain=imager.gain)


def mean_electrons(
    imager: Imager, radiance: Image, wavelength_nm: float, exposure: Exposure
) -> Image:
    """Expected electrons a pixel, before noise (h, w)."""
    scale = electrons_per_radiance(imager, wavelength_nm, exposure.exposure_s)
    return radiance * np.float32(scale)
