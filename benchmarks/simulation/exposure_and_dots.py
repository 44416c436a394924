"""Measure exposure control, dots and black level in the rooms of a D415, real and simulated.

    python benchmarks/simulation/exposure_and_dots.py $STARLING_CAPTURES/d415-faro [SIMULATED ...]

It prints four figures of each scene and folder. Three are of the left image: the mean level, the
mean of its middle (0.8 of rows and columns), and the darkest mean of 25 x 25 px. The fourth is how
dots differ between both imagers. A dot differs by the logarithm of its height on the left over that
on the right, less the median of nine neighbouring dots. The figure is the standard deviation over
sqrt(2). Speckle and noise are independent in both imagers, and the pattern is the same.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene
from starling.sim.imaging.imager import metered_rows_columns
from starling.sim.metrics import MAD_TO_SIGMA

BLACK_DN = 4.0
MIDDLE = 0.8  # Share of rows and columns.
PLACE_PX = 25  # Side of a dark place.
LEVEL_DN = 12.0  # Dots on darker surfaces drown in noise.
FLAT_PX = 1.5  # Largest range of disparities around a dot.
NEIGHBOURS = 9
_STEPS = np.arange(-1.0, 1.01, 0.25)

Array = NDArray[np.float32]


def heights(image: Array) -> Array:
    """Return the level above the mean of 15 x 15 px, slightly smoothed (h, w)."""
    smooth = cv2.GaussianBlur(image, (0, 0), 0.7)
    return np.asarray(smooth - cv2.blur(image, (15, 15)), np.float32)


def peak(image: Array, x: NDArray, y: NDArray) -> Array:
    """Return the largest interpolated value within a pixel of each place."""
    values = [
        cv2.remap(
            image,
            (x + across)[None].astype(np.float32),
            (y + down)[None].astype(np.float32),
            cv2.INTER_CUBIC,
        )[0]
        for across in _STEPS
        for down in _STEPS[::2]
    ]
    return np.max(values, axis=0)


def dot_difference(left: Array, right: Array, disparity_px: Array) -> float:
    """Return how the heights of dots differ between both imagers."""
    high, mean = heights(left), cv2.GaussianBlur(left, (0, 0), 12)
    smooth = cv2.GaussianBlur(left, (0, 0), 0.7)
    dots = (smooth == cv2.dilate(smooth, np.ones((5, 5)))) & (high > 0.3 * mean) & (mean > LEVEL_DN)
    known = cv2.erode(np.isfinite(disparity_px).astype(np.uint8), np.ones((PLACE_PX, PLACE_PX)))
    filled, window = np.nan_to_num(disparity_px), np.ones((15, 15))
    flat = cv2.dilate(filled, window) - cv2.erode(filled, window) < FLAT_PX
    dots[:, :150] = dots[:, -20:] = dots[:10] = dots[-10:] = False
    y, x = np.nonzero(dots & flat & (known > 0))
    if len(x) < 10 * NEIGHBOURS:
        return float("nan")
    ours = peak(high, x, y)
    theirs = peak(heights(right), x - disparity_px[y, x], y)
    ratio = np.log(np.maximum(ours, 1e-3) / np.maximum(theirs, 1e-3))
    near = KDTree(np.c_[x, y]).query(np.c_[x, y], k=NEIGHBOURS)[1]
    rest = ratio - np.median(ratio[near], axis=1)
    shrunk = np.sqrt(NEIGHBOURS / (NEIGHBOURS - 1))  # Its own value is in the median.
    return float(MAD_TO_SIGMA * np.median(np.abs(rest)) * shrunk / np.sqrt(2))


def figures(scene: CapturedScene, truth_m: Array | None) -> str:
    """Return the figures of a scene; a device's depth gives the disparities where it is real."""
    frame = scene.frame(0)
    assert frame.ir_left is not None and frame.ir_right is not None
    left, right = (image.astype(np.float32) for image in (frame.ir_left, frame.ir_right))
    middle = left[metered_rows_columns(left.shape, MIDDLE)].mean()
    darkest = cv2.blur(left, (PLACE_PX, PLACE_PX)).min()
    depth_m = frame.depth_m if truth_m is None else truth_m
    assert depth_m is not None
    disparity_px = scene.info.disparity_px(depth_m)
    dots = dot_difference(left - BLACK_DN, right - BLACK_DN, disparity_px)
    return f"{left.mean():6.2f} {middle:6.2f} {darkest:6.2f} {dots:6.3f}"


def main() -> None:
    """Print a line for each scene."""
    real, *simulated = (capture.open_set(Path(folder)) for folder in sys.argv[1:])
    print(
        "scene, room: level, level of the middle, darkest place [DN], difference of dots; by folder"
    )
    others = [{scene.name: scene for scene in each.scenes} for each in simulated]
    for scene in real.scenes:
        rows = [figures(scene, None)]
        for each in others:
            if scene.name in each:
                rows.append(figures(each[scene.name], scene.truth_m()))
        print(f"{scene.name} {scene.room:5}: {' | '.join(rows)}", flush=True)


if __name__ == "__main__":
    main()
