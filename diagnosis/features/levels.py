"""How bright an image is: on dots and between them, by place and depth; its codes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import Ground, Image, Mask

_PERCENTILES = (1, 5, 25, 50, 75, 95, 99, 99.9)


def levels(image: Image, ground: Ground, ceiling: float) -> dict[str, float]:
    """Logarithms of mean levels (1 code added) and of percentiles; share of full pixels.

    Args:
        image: (h, w) codes of one imager, warped into the left view or the left itself.
        ground: of the scene.
        ceiling: largest code.
    """
    found = {}
    for name in ("radius", "depth", "x", "y", "level"):
        for where_name, where in ground.crossed(name, "dots"):
            found[f"level.{where_name}"] = bins.log(1 + bins.mean(image, where))
    inside = image[ground.counted & np.isfinite(image)]
    if inside.size < bins.FEWEST:
        return found
    share = _shares(_counts(inside, ceiling))
    # Pixels of a code lie anywhere within it: whole codes would hide what moves dark ones a little.
    values = np.interp(np.divide(_PERCENTILES, 100), share, np.arange(share.size) - 0.5)
    for percent, value in zip(_PERCENTILES, values, strict=True):
        found[f"level.percentile {percent:g}"] = bins.log(1 + max(float(value), 0.0))
    found["level.full"] = float(np.arcsin(np.sqrt(np.mean(inside >= ceiling))))
    return found


def codes(image: Image, where: Mask, ceiling: float) -> dict[str, float]:
    """Share of codes that are empty, and how far codes are off their neighbours in number.

    Args:
        image: (h, w) of one imager as it was put out: between pixels there are other codes.
        where: (h, w) pixels that count.
        ceiling: largest code.
    """
    found: dict[str, float] = {}
    inside = image[where]
    if inside.size < bins.FEWEST:
        return found
    count = _counts(inside, ceiling)
    share = _shares(count)
    low, high = np.searchsorted(share[1:], (0.05, 0.95))
    used = count[low : high + 1]
    found["codes.empty"] = float(np.mean(used == 0)) if used.size else float("nan")
    # A code is as frequent as its neighbours unless the converter has steps.
    if used.size > 4:
        expected = 0.5 * (used[:-2] + used[2:])
        found["codes.comb"] = float(np.abs(used[1:-1] - expected).sum() / max(used.sum(), 1))
    return found


def _counts(inside: NDArray, ceiling: float) -> NDArray[np.int64]:
    """Pixels by code."""
    return np.bincount(np.clip(np.rint(inside), 0, ceiling).astype(np.int64))


def _shares(count: NDArray[np.int64]) -> NDArray[np.float64]:
    """Share of the pixels below each code, and below the one after the last."""
    return np.concatenate([[0.0], np.cumsum(count) / count.sum()])
