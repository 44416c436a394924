"""From charge to codes: converter, tone curve, black level, the device's own resampling."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera import psf
from starling.diagnosis.validation.camera.catalogue import Strengths

Codes = NDArray[np.uint8] | NDArray[np.uint16]
_KNOTS = 129  # Of the tone curve's table.


def codes(charge_e: NDArray[np.float64], strengths: Strengths) -> NDArray[np.float64]:
    """Turn charge into digital numbers, not yet rounded.

    Args:
        charge_e: Charge (h, w) [electrons].
        strengths: The effects.

    Returns:
        Digital numbers (h, w) within the code range.
    """
    ceiling = top(strengths)
    signal = charge_e * dn_per_e(strengths)
    if strengths.acting("gamma"):
        signal = tone(signal, strengths.of("gamma"), ceiling)
    dn = np.clip(signal + strengths.of("black_level"), 0.0, ceiling)
    return smooth(dn, strengths.of("smoothing"))


def top(strengths: Strengths) -> float:
    """Largest code [DN]."""
    return 2.0 ** strengths.of("quantisation") - 1.0


def dn_per_e(strengths: Strengths) -> float:
    """Digital numbers for an electron: the ceiling over the full well, times the gain."""
    nominal = strengths.nominal
    scale = nominal.dn_per_e * strengths.of("gain")
    scale *= nominal.full_well_e / strengths.of("saturation")
    return scale * top(strengths) / (2.0**nominal.bit_depth - 1.0)


def tone(signal_dn: NDArray[np.float64], gamma: float, ceiling: float) -> NDArray[np.float64]:
    """Apply a tone curve as devices do: straight lines between the knots of a table.

    Knots lie closer where the curve is steep. Noise below 0 is cut off: the curve has no values.
    """
    signal = np.linspace(0.0, 1.0, _KNOTS) ** max(gamma, 1.0)
    return ceiling * np.interp(signal_dn / ceiling, signal, signal ** (1.0 / gamma))


def smooth(dn: NDArray[np.float64], sigma_px: float) -> NDArray[np.float64]:
    """Average neighbouring codes, as a device's resampling does, by a kernel of that variance."""
    if sigma_px == 0.0:
        return dn
    return psf.blur(np.rint(dn), psf.kernel("gaussian", sigma_px))


def whole(dn: NDArray[np.float64], bits: int) -> Codes:
    """Round to codes of so many bits, kept in 8 bits where they fit and else in 16."""
    rounded = np.clip(np.rint(dn), 0, 2**bits - 1)
    return rounded.astype(np.uint8) if bits <= 8 else rounded.astype(np.uint16)
