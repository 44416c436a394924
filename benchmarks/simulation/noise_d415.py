"""Measure the noise of a D415's infrared images where each imager's own is seen alone.

    python benchmarks/simulation/noise_d415.py $STARLING_CAPTURES/d415-faro SIMULATED [--rooms ...]

Windows of 48 px lie on one surface. There the right image is brought into the left view by the
scanner's disparity. A shift, a gain and an offset are fitted, as rectification leaves shifts of
0.2 px. The difference has no pattern and no texture. Its power over 1 + gain^2 is the noise of one
imager. Interpolation removes equal parts of real and simulated noise.

It prints figures of each scene, real and simulated: noise and power of the left image by period,
and the scatter of dots. A dot's height is compared with the median of nine neighbours. Then it fits
noise = a + b level + c power of dots to all windows. b gives electrons, c speckle.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import exposure_and_dots
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from starling.sim import metrics
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene
from starling.sim.scene.captured import depth_surface

SIDE_PX = 48
MARGIN_PX = 8
PERIODS_PX = ((2, 4), (4, 8))
BLACK_DN = exposure_and_dots.BLACK_DN
LEVELS_DN = (3.0, 60.0)  # Levels of the windows of the fit, above black.
STEPS = 3  # Steps of the registration.
GAINS = (0.5, 2.0)  # Windows with another gain show two surfaces.
ROBUST = 0.25  # Residual, relative, that halves a window's weight.

Array = NDArray[np.float32]
Table = NDArray[np.float64]  # (windows, 6): level, noise at 2-4 px, at 4-8 px, power, same; dots.


def surface(scene: CapturedScene) -> tuple[Array, NDArray[np.bool_]]:
    """Return the disparity of a scene's smooth surface, and the mask away from its edges."""
    truth_m = scene.truth_m()
    assert truth_m is not None
    truth_px = scene.info.disparity_px(truth_m)
    smooth_px = depth_surface.smooth(depth_surface.close_holes(truth_px))
    inner = np.isfinite(truth_px) & np.isfinite(smooth_px) & ~metrics.depth_edges(smooth_px)
    return np.nan_to_num(smooth_px).astype(np.float32), inner


def windows(left: Array, right: Array, disparity_px: Array, inner: NDArray[np.bool_]) -> Table:
    """Measure level, noise and power of dots in each window."""
    taper = np.hanning(SIDE_PX + 1)[:-1]
    taper = np.outer(taper, taper)
    scale = 1 / (taper**2).sum() / SIDE_PX**2
    across = np.fft.fftfreq(SIDE_PX)
    frequency = np.hypot(across, across[:, None])
    bands = [(frequency * low <= 1) & (frequency * high > 1) for low, high in PERIODS_PX]
    height, width = left.shape
    rows = []
    for row in range(MARGIN_PX, height - SIDE_PX - MARGIN_PX, SIDE_PX // 2):
        for column in range(metrics.LEFT_BAND_PX, width - SIDE_PX - MARGIN_PX, SIDE_PX // 2):
            part = (slice(row, row + SIDE_PX), slice(column, column + SIDE_PX))
            if not inner[part].all() or column - disparity_px[part].max() < MARGIN_PX:
                continue
            rest, gain = registered(left[part], right, disparity_px[part], row, column)
            if not GAINS[0] < gain < GAINS[1]:
                continue
            level = left[part].mean() - BLACK_DN
            noise, whole = (
                [(np.abs(np.fft.fft2(values * taper)) ** 2)[band].sum() * scale for band in bands]
                for values in (rest, left[part] - left[part].mean())
            )
            noise = [power / (1 + gain**2) for power in noise]
            rows.append([level, *noise, *whole, max(whole[1] - noise[1], 0)])
    return np.array(rows)


def registered(
    left: Array, right: Array, disparity_px: Array, row: int, column: int
) -> tuple[Array, float]:
    """Return a window less the right image's, with fitted shift, gain and offset; and the gain."""
    down, across = np.mgrid[row : row + SIDE_PX, column : column + SIDE_PX].astype(np.float32)
    shift, gain, offset = np.zeros(2), 1.0, 0.0
    moved = left
    for step in range(STEPS + 1):
        x = (across - disparity_px - shift[0]).astype(np.float32)
        y = (down - shift[1]).astype(np.float32)
        moved = cv2.remap(right, x, y, cv2.INTER_LANCZOS4)
        slopes: list[Array] = []
        if step < STEPS:
            slopes = [
                np.asarray(-cv2.Sobel(moved, cv2.CV_32F, *order, scale=1 / 8), np.float32)
                for order in ((1, 0), (0, 1))
            ]
        columns = [image.ravel() for image in (moved, np.ones_like(moved), *slopes)]
        gain, offset, *moves = np.linalg.lstsq(np.stack(columns, 1), left.ravel(), rcond=None)[0]
        if gain < GAINS[0]:
            break
        if moves:
            shift = np.clip(shift + np.array(moves) / gain, -2, 2)
    return np.asarray(left - gain * moved - offset, np.float32), float(gain)


def fit(rows: Table) -> NDArray[np.floating[Any]]:
    """Fit noise at 2 to 4 px = a + b level + c power of dots; robust, with relative weights."""
    rows = rows[(rows[:, 0] > LEVELS_DN[0]) & (rows[:, 0] < LEVELS_DN[1])]
    terms = np.column_stack([np.ones(len(rows)), rows[:, 0], rows[:, 5]])
    noise = rows[:, 1]
    weight = 1 / np.maximum(np.median(noise), noise)
    values: NDArray[np.floating[Any]] = np.zeros(3)
    for _ in range(20):
        values = np.linalg.lstsq(terms * weight[:, None], noise * weight, rcond=None)[0]
        model = np.maximum(terms @ values, 0.01)
        weight = 1 / model / np.sqrt(1 + ((noise / model - 1) / ROBUST) ** 2)
    return values


def scatter(left: Array) -> float:
    """Return the standard deviation of the logarithm of dots' heights around their neighbours'."""
    high, mean = exposure_and_dots.heights(left), cv2.GaussianBlur(left, (0, 0), 12)
    smooth = cv2.GaussianBlur(left, (0, 0), 0.7)
    peaks = (smooth == cv2.dilate(smooth, np.ones((5, 5)))) & (high > 0.3 * mean)
    peaks &= mean > exposure_and_dots.LEVEL_DN
    y, x = np.nonzero(peaks)
    if len(x) < 10 * exposure_and_dots.NEIGHBOURS:
        return float("nan")
    logarithm = np.log(high[y, x])
    near = KDTree(np.c_[x, y]).query(np.c_[x, y], k=exposure_and_dots.NEIGHBOURS)[1]
    rest = logarithm - np.median(logarithm[near], axis=1)
    return float(metrics.MAD_TO_SIGMA * np.median(np.abs(rest)))


def pair(scene: CapturedScene) -> tuple[Array, Array]:
    """Return the infrared pair of a scene's fullest frame."""
    frame = scene.fullest()
    assert frame.ir_left is not None and frame.ir_right is not None
    return frame.ir_left.astype(np.float32), frame.ir_right.astype(np.float32)


def show(label: str, tables: Sequence[Sequence[Table]]) -> None:
    """Print the fits to all windows, real and simulated."""
    for kind, parts in zip(("real", "simulated"), tables, strict=True):
        a, b, c = fit(np.concatenate(parts))
        print(f"{label}, {kind}: noise 2-4 px = {a:.4f} + {b:.5f} level + {c:.5f} dots [DN^2]")


def main() -> None:
    """Print a line for each scene, and the fits."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("real", type=Path)
    parser.add_argument("simulated", type=Path)
    parser.add_argument("--rooms", nargs="*", default=[], help="all rooms if none")
    options = parser.parse_args()
    simulated = {scene.name: scene for scene in capture.open_set(options.simulated).scenes}
    tables: tuple[list[Table], list[Table]] = ([], [])
    print(
        "scene, room: noise at 2-4 px, at 4-8 px, power at 2-4 px, at 4-8 px [DN^2], scatter of "
        "dots, level [DN]; real, simulated, ratio"
    )
    for scene in capture.open_set(options.real).scenes:
        if scene.name not in simulated or (options.rooms and scene.room not in options.rooms):
            continue
        disparity_px, inner = surface(scene)
        figures = []
        for table, seen in zip(tables, (scene, simulated[scene.name]), strict=True):
            left, right = pair(seen)
            table.append(windows(left, right, disparity_px, inner))
            noise = np.median(table[-1][:, 1:3], axis=0)
            power = np.mean(table[-1][:, 3:5], axis=0)
            figures.append([*noise, *power, scatter(left - BLACK_DN), left.mean()])
        columns = " | ".join(
            f"{real:.3f} {ours:.3f} {ours / real:.3f}" for real, ours in zip(*figures, strict=True)
        )
        print(f"{scene.name} {scene.room:5}: {columns}", flush=True)
    show("all windows", tables)


if __name__ == "__main__":
    main()
