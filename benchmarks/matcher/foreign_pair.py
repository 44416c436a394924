"""Match a rectified pair of any camera, and compare it with the camera's own depth if there is one.

Usage:
    python benchmarks/matcher/foreign_pair.py LEFT RIGHT --setting oak --search 192
        [--depth DEPTH_MM --focal FX --baseline M] [--rows FIRST LAST]
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim import metrics
from starling.sim.commands.compare import dot_contrast
from starling.sim.sensor import matcher
from starling.sim.stereo.matching import match

SATURATED = 65535  # Code of depth that a device writes beyond its range.


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("left", type=Path)
    parser.add_argument("right", type=Path)
    parser.add_argument("--setting", default="d4xx")
    parser.add_argument("--search", type=int, default=128)
    parser.add_argument("--depth", type=Path)
    parser.add_argument("--focal", type=float)
    parser.add_argument("--baseline", type=float)
    parser.add_argument("--rows", type=int, nargs=2)
    flags = parser.parse_args()
    left, right = (
        cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in (flags.left, flags.right)
    )
    assert left is not None and right is not None
    setting = dataclasses.replace(matcher.named(flags.setting), search_px=flags.search)
    ours = match(left, right, setting).disparity_px
    rows = slice(*(flags.rows or (0, len(left))))
    seen = np.zeros(left.shape, bool)
    seen[rows, flags.search :] = True
    print(f"mean level {left.mean():.1f} DN, dot contrast {dot_contrast(left):.3f}")
    print(f"ours: fill {np.isfinite(ours[seen]).mean():.3f}")
    if flags.depth:
        device = disparity(flags.depth, flags.focal * flags.baseline)
        compare(ours, device, seen)


def disparity(path: Path, focal_baseline: float) -> NDArray[np.float32]:
    """Return the disparity [px] of depth in millimetres, NaN where there is none."""
    code = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert code is not None
    known = (code > 0) & (code < SATURATED)
    return np.where(known, 1000 * focal_baseline / np.maximum(code, 1), np.nan).astype(np.float32)


def compare(
    ours: NDArray[np.float32], device: NDArray[np.float32], seen: NDArray[np.bool_]
) -> None:
    """Print the figures of our disparity, with the device's as reference."""
    figures = metrics.disparity_figures(ours, device, seen & np.isfinite(device))
    overlap = metrics.hole_overlap(ours, device, seen)
    print(f"device: fill {np.isfinite(device[seen]).mean():.3f}")
    print(f"NMAD {figures.nmad_px:.3f} px, bias {figures.bias_px:.3f} px")
    print(f"over 1 px {figures.bad1_pct:.1f} %, hole IoU {overlap:.3f}")


if __name__ == "__main__":
    main()
