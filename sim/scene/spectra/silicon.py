"""Absorption of light in the collecting depth of a silicon pixel."""

from __future__ import annotations

import numpy as np

from starling.patterns import errors
from starling.sim.scene.spectra.wavelength import Spectrum

# Depth of the collecting layer [um], assumed because makers do not publish it. It collects 0.23 of
# the photons at 850 nm, about as the ordinary version of a chip.
PLAIN_UM = 5.0

# Share of photons that enter and can be collected (reflection, fill factor), the highest possible
# quantum efficiency. Assumed, and equal at all wavelengths.
COLLECTED = 0.75

_K_NM = np.arange(380.0, 1101.0, 10.0)
# fmt: off
# Extinction coefficient k of intrinsic silicon at 300 K, times 1000, every 10 nm from 380.
# Source: Green, Solar Energy Materials and Solar Cells 92 (2008) 1305, table 1.
_K = 1e-3 * np.array([
    946.0, 445.0, 296.0, 227.0, 176.0, 138.0, 107.0, 86.3, 71.38, 62.09, 55.0, 49.13, 44.17,
    39.37, 36.42, 33.11, 30.29, 27.97, 25.76, 24.13, 22.52, 21.08, 19.93, 18.45, 17.37, 16.44,
    15.43, 14.43, 13.5, 12.74, 11.91, 11.2, 10.53, 10.06, 9.626, 8.946, 8.362, 7.819, 7.197, 6.74,
    6.393, 5.834, 5.411, 4.995, 4.613, 4.273, 3.944, 3.612, 3.278, 2.984, 2.682, 2.429, 2.17,
    1.962, 1.757, 1.547, 1.369, 1.179, 1.024, 0.8722, 0.7487, 0.6224, 0.5093, 0.4107, 0.3239,
    0.2475, 0.187, 0.1362, 0.09363, 0.06812, 0.05328, 0.04077, 0.03064,
])
# fmt: on


def absorption_per_um(wavelength_nm: Spectrum) -> Spectrum:
    """Absorption coefficient 4 pi k / lambda [1 / um], by interpolation of log k."""
    log_k = np.interp(wavelength_nm, _K_NM, np.log(_K))
    return 4 * np.pi * np.exp(log_k) / (wavelength_nm * 1e-3)


def absorbed(wavelength_nm: Spectrum, epitaxy_um: float) -> Spectrum:
    """Share of the entering photons absorbed within a depth (Beer-Lambert).

    Args:
        wavelength_nm: 380 to 1100 [nm].
        epitaxy_um: Depth [um], above 0; infinite gives an ideal detector.
    """
    return -np.expm1(-absorption_per_um(wavelength_nm) * epitaxy_um)


def depth_um(efficiency: float, wavelength_nm: float) -> float:
    """Depth of the layer with this quantum efficiency at this wavelength [um].

    Infinite if the efficiency reaches `COLLECTED`: an ideal detector, equally efficient at all
    wavelengths.

    Raises:
        InputError: if the efficiency is not in (0, 1].
    """
    errors.in_interval("quantum efficiency", efficiency, 1e-6, 1.0, "Give a share, not percent.")
    if efficiency >= COLLECTED:
        return float("inf")
    per_um = float(absorption_per_um(np.array([wavelength_nm]))[0])
    return float(-np.log1p(-efficiency / COLLECTED)) / per_um
