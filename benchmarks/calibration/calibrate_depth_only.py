"""Calibrate from depth only on the real D415 scenes, without their infrared images.

    python benchmarks/calibration/calibrate_depth_only.py 3

Captures: `d415-faro` in the folder $STARLING_CAPTURES. The argument is the number of rooms. The
first scene of each of these rooms is fitted; the first scenes of as many other rooms are held out.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from starling.calibration.depth.depth_only import GROUPS, fit_depth
from starling.calibration.depth.depth_twin import render_twin
from starling.calibration.depth.hole_places import compare_readings
from starling.calibration.observation import Observation
from starling.calibration.solution import Solution
from starling.sim.captures.capture import CapturedScene, open_set
from starling.sim.sensor import presets

COLUMNS = ("bias_px", "nmad_px", "scatter_px", "ndp_rate", "ndp_iou")
SIDES = ("device", "before", "after")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Outcome:
    """A fit to some rooms, with the figures of held-out rooms."""

    solution: Solution
    held_out: Mapping[str, Mapping[str, float]]
    seconds: float  # Wall time of the fit [s].


def folder() -> Path:
    """Return the folder of the scenes; it may not exist."""
    return Path(os.environ.get("STARLING_CAPTURES", "")) / "d415-faro"


def depth_observation(scene: CapturedScene) -> Observation:
    """Read the depth and reference of a scene, without infrared images."""
    frame = scene.frame(scene.frames[0])
    return Observation(
        name=scene.name,
        room=scene.room,
        info=scene.info,
        depth_m=frame.depth_m,
        truth_m=scene.truth_m(),
    )


def first_scenes(where: Path, *, spread: int) -> list[Observation]:
    """Return the first scene of each room; every `spread`-th room comes first."""
    first: dict[str, CapturedScene] = {}
    for scene in open_set(where).scenes:
        first.setdefault(scene.room, scene)
    rooms = sorted(first)
    order = [room for start in range(spread) for room in rooms[start::spread]]
    return [depth_observation(first[room]) for room in order]


def run(where: Path, rooms: int, free: Sequence[str] = GROUPS) -> Outcome:
    """Fit the first rooms and score as many others."""
    seen = first_scenes(where, spread=2)[: 2 * rooms]
    start = presets.load("d415")
    start_s = time.perf_counter()
    solution = fit_depth(seen[:rooms], start, free=free)
    seconds = time.perf_counter() - start_s
    nominal = seen[0].info.geometry_into(start)
    twins = [
        render_twin(scene_observation, nominal, seed=100 + n)
        for n, scene_observation in enumerate(seen[rooms:])
    ]
    return Outcome(
        solution=solution,
        held_out=compare_readings(twins, nominal, solution.sensor),
        seconds=seconds,
    )


def _median_gap(column: str, side: str, rows: Mapping[str, Mapping[str, float]]) -> float:
    gaps = [abs(row[f"{column}_{side}"] - row[f"{column}_device"]) for row in rows.values()]
    return float(np.median(gaps))


def _table(title: str, rows: Mapping[str, Mapping[str, float]]) -> None:
    print(f"\n{title}: device, before, after")
    print("scene   " + "".join(f"{column:>27}" for column in COLUMNS))
    for name, row in rows.items():
        cells = [f"{row[f'{column}_{side}']:9.3f}" for column in COLUMNS for side in SIDES]
        print(f"{name:8}" + "".join(cells))
    for column in ("scatter_px", "ndp_rate"):
        before, after = (_median_gap(column, side, rows) for side in SIDES[1:])
        print(f"median gap of {column}: {before:.4f} before, {after:.4f} after")


def main() -> None:
    """Print the estimates, the unidentifiable parameters, and the figures of both groups."""
    where = folder()
    if not where.is_dir():
        raise SystemExit(f"no captures at {where}; set STARLING_CAPTURES to their folder")
    result = run(where, int(sys.argv[1]) if len(sys.argv) > 1 else 3)
    print(f"fit: {result.seconds:.0f} s")
    for estimate in result.solution.estimates:
        print(
            f"{estimate.name:22} {estimate.value:9.4f} +- {estimate.sd:7.4f} "
            f"{estimate.unit:5} from {estimate.start:.4f}"
        )
    print("score: " + ", ".join(f"{cost:.2f}" for cost in result.solution.cost))
    print("\n".join(result.solution.undetermined))
    _table("fitted", result.solution.scenes)
    _table("held out", result.held_out)


if __name__ == "__main__":
    main()
