"""Estimate the window of a device's mean from its depth and the infrared pairs.

    python benchmarks/matcher/mean_window.py [d415]

The device's disparity on smooth surfaces is regressed on our matcher's disparity before its mean.
Predictors are neighbouring rows after a mean of 15 columns, or columns after a mean of 9 rows. The
coefficients are the device's window. Its ends are soft, as the noise of two matchers differs. The
same regression of our own smoothed disparity shows the error of the method. Deviations are
jackknifed over scenes. Captures: tuned rooms of `d415-faro` in the folder $STARLING_CAPTURES.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from match_faro import folder, scenes, setting_of
from numpy.typing import NDArray

from starling.sim.sensor.matcher import Matcher, Refinement
from starling.sim.stereo.matching import match

REACH_PX = 12  # Largest distance of a neighbour.
SHOWN_PX = 10  # Largest distance that is printed.
SLOW_PX = 61  # Side of the window whose mean is removed.
SMOOTH_PX = 0.5  # Largest difference to the mean of 21 px, and between the matchers.
AXES = {"rows": (15, 1), "columns": (1, 9)}  # Columns and rows of the mean before the regression.


@dataclass(frozen=True, slots=True)
class Sums:
    """Normal equations of one scene."""

    matrix: NDArray
    vector: NDArray


def main() -> None:
    """Print the window of the device and of our matcher."""
    matcher = setting_of(sys.argv[1] if len(sys.argv) > 1 else "d415")
    tuned = [scene for scene in scenes(folder()) if scene.tuned]
    raw = [match(each.left, each.right, unsmoothed(matcher)).disparity_px for each in tuned]
    ours = [match(each.left, each.right, matcher).disparity_px for each in tuned]
    for name, smoothed in (("device", [each.device_px for each in tuned]), ("ours", ours)):
        for axis, before in AXES.items():
            pairs = zip(raw, smoothed, strict=True)
            report(name, axis, [sums(*pair, axis, before) for pair in pairs])


def unsmoothed(matcher: Matcher) -> Matcher:
    """Return a matcher without refinement."""
    return replace(matcher, refinement=Refinement())


def sums(raw: NDArray, smoothed: NDArray, axis: str, before: tuple[int, int]) -> Sums:
    """Sum products of neighbours of the raw disparity with the smoothed one.

    Args:
        raw: (h, w) disparity before the mean [px].
        smoothed: (h, w) disparity after it [px].
        axis: direction of the neighbours.
        before: columns and rows of a mean before the regression.
    """
    known = np.isfinite(raw) & np.isfinite(smoothed)
    around = local_mean(raw, known, 21)
    smooth = known & (np.abs(raw - around) < SMOOTH_PX) & (np.abs(raw - smoothed) < SMOOTH_PX)
    window = np.ones((2 * REACH_PX + 3, 2 * REACH_PX + 3), np.uint8)
    inside = cv2.erode(smooth.astype(np.uint8), window, borderValue=0) > 0
    fast = np.where(smooth, raw - local_mean(raw, smooth, SLOW_PX), 0.0)
    target = (smoothed - local_mean(smoothed, smooth, SLOW_PX))[inside]
    fast = cv2.blur(fast, before)
    number = 0 if axis == "rows" else 1
    shifted = (np.roll(fast, -shift, number)[inside] for shift in range(-REACH_PX, REACH_PX + 1))
    neighbours = np.stack(list(shifted))
    return Sums(neighbours @ neighbours.T, neighbours @ target)


def local_mean(values: NDArray, known: NDArray[np.bool_], side_px: int) -> NDArray:
    """Average the known values of a square window."""
    side = (side_px, side_px)
    total = cv2.boxFilter(np.where(known, values, 0.0), cv2.CV_64F, side, normalize=False)
    count = cv2.boxFilter(known.astype(np.float64), cv2.CV_64F, side, normalize=False)
    return total / np.maximum(count, 1.0)


def report(name: str, axis: str, scene_sums: Sequence[Sums]) -> None:
    """Print the coefficients [%], their largest deviation, and their centre."""
    window = solve(scene_sums)
    others = [
        solve([*scene_sums[:number], *scene_sums[number + 1 :]])
        for number in range(len(scene_sums))
    ]
    error = jackknife(np.stack(others))
    centres = np.array([centre(each) for each in others])
    shown = slice(REACH_PX - SHOWN_PX, REACH_PX + SHOWN_PX + 1)
    print(f"{name}, {axis}: centre {centre(window):+.2f} +- {jackknife(centres):.2f} px")
    print(" ".join(f"{100 * value:.0f}" for value in window[shown]), end="")
    print(f"  (+- {100 * np.median(error):.1f})")


def solve(scene_sums: Sequence[Sums]) -> NDArray:
    """Return the regression's coefficients (neighbours,)."""
    matrix = np.sum([each.matrix for each in scene_sums], axis=0)
    vector = np.sum([each.vector for each in scene_sums], axis=0)
    return np.linalg.solve(matrix, vector)


def centre(window: NDArray) -> float:
    """Return the mean position of the coefficients within `SHOWN_PX` [px]."""
    places = np.arange(-SHOWN_PX, SHOWN_PX + 1)
    inner = window[REACH_PX - SHOWN_PX : REACH_PX + SHOWN_PX + 1]
    return float(inner @ places / inner.sum())


def jackknife(values: NDArray) -> NDArray:
    """Return the standard deviation of a figure from its values (scenes, ...) without one each."""
    return values.std(axis=0) * np.sqrt(len(values) - 1)


if __name__ == "__main__":
    main()
