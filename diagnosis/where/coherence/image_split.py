"""Split of a scene's infrared power: explained by simulation, common to the imagers, or not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.where.coherence.spectra import SAMPLES, Spectra, band_sums, cross
from starling.diagnosis.where.coherence.views import PairSpectra

Powers = NDArray[np.float64]  # (bands,) mean square per pixel.

_LEAST_COMMON = 0.05  # Below this coherent share of the simulated power, a gain is chance.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ScenePowers:
    """Power of one scene's images by band; explained, coherent and incoherent sum to the total."""

    total: Powers  # Geometric mean of both imagers.
    explained: Powers  # Predicted by the simulation with the best gain in each band.
    coherent: Powers  # Unexplained, and common to both imagers.
    incoherent: Powers  # Of each imager alone.
    gain: Powers  # Real over simulated amplitude.
    simulated_total: Powers
    simulated_incoherent: Powers
    windows: int


def split_powers(real: PairSpectra, base: PairSpectra) -> ScenePowers:
    """Split the power of a pair by what a simulated pair explains.

    The simulated pair's own noise is no part of the prediction: its coherent power is that of the
    cross spectrum of its imagers. Cross spectra are unbiased for any number of windows. The
    explained power is a square, whose bias is subtracted (Bendat and Piersol, Random Data, 9.2).

    Args:
        real: captured pair, at least one window.
        base: simulated pair in the same windows.
    """
    count = len(real.left)
    total, _ = _geometric_power(real)
    simulated_total, ratio = _geometric_power(base)
    common = _mean(base.left, base.right)
    enough = common > _LEAST_COMMON * simulated_total
    known = np.where(enough, common, 1.0)
    gain = np.stack([_mean(real.left, base.left) * ratio, _mean(real.right, base.right) / ratio])
    gain = np.where(enough, gain / known, 0.0)
    explained = gain[0] * gain[1] * common
    explained = explained - (total - explained) / (2 * count * SAMPLES) * enough
    unexplained = real.less(base, gain)
    coherent = _mean(unexplained.left, unexplained.right)
    return ScenePowers(
        total=total,
        explained=explained,
        coherent=coherent,
        incoherent=total - explained - coherent,
        gain=gain,
        simulated_total=simulated_total,
        simulated_incoherent=simulated_total - common,
        windows=count,
    )


def _geometric_power(pair: PairSpectra) -> tuple[Powers, Powers]:
    """Return the geometric mean of both imagers' powers, and right over left amplitude."""
    left = band_sums(cross(pair.left, pair.left).real * pair.left_power) / len(pair.left)
    right = band_sums(cross(pair.right, pair.right).real * pair.right_power) / len(pair.left)
    return np.sqrt(left * right), np.sqrt(right / np.maximum(left, 1e-12))


def _mean(first: Spectra, second: Spectra) -> Powers:
    return band_sums(cross(first, second)) / len(first)
