"""From charge to codes: converter, tone curve, black level and the device's smoothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera import psf
from starling.diagnosis.validation.camera.catalogue import Strengths

Codes = NDArray[np.uint8] | NDArray[np.uint16]
_KNOTS = 129  # Number of entries of the tone curve table.


def codes(charge_e: NDArray[np.float64], strengths: Strengths) -> NDArray[np.float64]:
    """Convert charge to digital numbers before rounding.

    Args:
        charge_e: Charge (h, w) [electrons].
        strengths: Nominal camera and effect strengths.

    Returns:
        Digital numbers (h, w), clipped to the code range.
    """
    ceiling = top(strengths)
    signal = charge_e * dn_per_e(strengths)
    if strengths.is_active("gamma"):
        signal = tone(signal, strengths.value("gamma"), ceiling)
    dn = np.clip(signal + strengths.value("black_level"), 0.0, ceiling)
    return smooth(dn, strengths.value("smoothing"))


def top(strengths: Strengths) -> float:
    """Return the largest code [DN]."""
    return 2.0 ** strengths.value("quantisation") - 1.0


def dn_per_e(strengths: Strengths) -> float:
    """Return the conversion factor [DN/electron]: largest code over full well, times the gain."""
    nominal = strengths.nominal
    scale = nominal.dn_per_e * strengths.value("gain")
    scale *= nominal.full_well_e / strengths.value("saturation")
    return scale * top(strengths) / (2.0**nominal.bit_depth - 1.0)


def tone(signal_dn: NDArray[np.float64], gamma: float, ceiling: float) -> NDArray[np.float64]:
    """Apply a gamma curve by linear interpolation in a table, as devices do.

    Knots are denser where the curve is steep. Values below 0 become 0.
    """
    signal = np.linspace(0.0, 1.0, _KNOTS) ** max(gamma, 1.0)
    return ceiling * np.interp(signal_dn / ceiling, signal, signal ** (1.0 / gamma))


def smooth(dn: NDArray[np.float64], sigma_px: float) -> NDArray[np.float64]:
    """Average neighbouring codes with a Gaussian kernel, as the device's resampling does."""
    if sigma_px == 0.0:
        return dn
    return psf.blur(np.rint(dn), psf.kernel("gaussian", sigma_px))


def round_codes(dn: NDArray[np.float64], bits: int) -> Codes:
    """Round to codes of `bits` bits, stored as uint8 for at most 8 bits, else as uint16."""
    rounded = np.clip(np.rint(dn), 0, 2**bits - 1)
    return rounded.astype(np.uint8) if bits <= 8 else rounded.astype(np.uint16)
