r"""Judge depth on surfaces and at edges apart: where does a simulation differ from a real D415?

Pixels outside of the place are hidden on both sides, so holes are alike and depth alone is judged.
*Surfaces*: more than 8 px from holes and from steps of 0.35 px between neighbours, on both sides.
*Edges*: the other pixels that have depth on both sides.
Captures: `d415-faro` in the folder $STARLING_CAPTURES.

Usage:
    starling simulate $STARLING_CAPTURES/d415-faro --sensor d415 --out OUT/preset
    python benchmarks/simulation/judge_places.py preset=OUT/preset --judges 3
"""

from __future__ import annotations

import argparse
import tempfile
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from judge_d415 import areas, depth_of, matched, open_named, open_real, write

from starling.learning.judge.judge import judge
from starling.learning.judge.samples import ScenePair, pair, statistics
from starling.sim.arrays import Image, Mask
from starling.sim.captures.capture import CapturedScene, CaptureSet, Frame
from starling.sim.captures.info import CaptureInfo
from starling.sim.sensor import resolve

REACH_PX = 17  # Side of the square around a hole or a step.
STEP_PX = 0.35  # Range of disparities in 3x3 px that counts as a step.
PLACES = ("surfaces", "edges")


def smooth(depth_m: Image, info: CaptureInfo) -> Mask:
    """Return the pixels (h, w) without a hole or a step nearby."""
    disparity_px = info.disparity_px(depth_m)
    known = np.isfinite(disparity_px)
    square = np.ones((3, 3), np.uint8)
    highest = cv2.dilate(np.where(known, disparity_px, -1).astype(np.float32), square)
    lowest = cv2.erode(np.where(known, disparity_px, 1000).astype(np.float32), square)
    rough = (~known | (highest - lowest > STEP_PX)).astype(np.uint8)
    return cv2.dilate(rough, np.ones((REACH_PX, REACH_PX), np.uint8)) == 0


def masked_pair(place: str, real: CapturedScene, sim: CapturedScene) -> tuple[ScenePair, float]:
    """Return the statistics of both sides in a place, and its share of the image."""
    depths_m = depth_of(real), depth_of(sim)
    surface = smooth(depths_m[0], real.info) & smooth(depths_m[1], real.info)
    both = np.isfinite(depths_m[0]) & np.isfinite(depths_m[1])
    kept = surface if place == "surfaces" else both & ~surface
    cells = [
        statistics(
            "depth",
            Frame(number=0, ir_left=None, ir_right=None, depth_m=np.where(kept, depth_m, np.nan)),
            real.info,
        )
        for depth_m in depths_m
    ]
    return pair(real, cells[0], sim, cells[1]), float(kept.mean())


def report(name: str, place: str, real: CaptureSet, sim: CaptureSet, judges: int) -> None:
    """Print the area of a place, its interval, that of other rooms, and of one judge."""
    simulated = {scene.name: scene for scene in sim.scenes}
    masked = [masked_pair(place, scene, simulated[scene.name]) for scene in real.scenes]
    judged = judge([each for each, _ in masked], judges=judges)
    share = np.mean([part for _, part in masked])
    print(f"| {name} | {place} | {share:.2f} | {areas(judged)} |", flush=True)


def main() -> None:
    """Print a row for each set and place."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("sets", nargs="*", metavar="NAME=FOLDER", help="simulated captures")
    parser.add_argument("--judges", type=int, default=3)
    options = parser.parse_args()
    real = open_real()
    print("| depth | place | share | AUC | other rooms | single |\n" + "|---" * 6 + "|", flush=True)
    with tempfile.TemporaryDirectory() as temporary:
        sensor = resolve.load("d415", captures=str(real.path))
        row = partial(matched, sensor=sensor, simulated=False)
        out = Path(temporary) / "matched"
        sets = {"our matcher on the real images": write(row, real, real, out)}
        sets |= open_named(options.sets)
        for name, captures in sets.items():
            for place in PLACES:
                report(name, place, real, captures, options.judges)


if __name__ == "__main__":
    main()
