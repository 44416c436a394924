"""Calibration from depth and holes alone on the real D415 scenes, their infrared left aside.

    python benchmarks/calibration/calibrate_depth_only.py 3

Captures: `d415-faro` in the folder $STARLING_CAPTURES. The first scene of so many rooms is fitted;
the first scenes of as many other rooms are held out.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from starling.calibration.depth.depth_figures import side_by_side
from starling.calibration.depth.depth_only import GROUPS, fit_depth
from starling.calibration.depth.depth_twin import twin
from starling.calibration.observation import Observation
from starling.calibration.solution import Solution
from starling.sim.captures.capture import CapturedScene, open_set
from starling.sim.sensor import presets

COLUMNS = ("bias_px", "nmad_px", "scatter_px", "ndp_rate", "ndp_iou")
SIDES = ("device", "before", "after")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Outcome:
    """A fit to some rooms, and figures of rooms it never saw."""

    solution: Solution
    held_out: Mapping[str, Mapping[str, float]]
    seconds: float  # Of the fit.


def folder() -> Path:
    """Where the scenes are, if they are on this machine."""
    return Path(os.environ.get("STARLING_CAPTURES", "")) / "d415-faro"


def depth_alone(scene: CapturedScene) -> Observation:
    """One scene's depth and reference; its infrared is not read."""
    frame = scene.frame(scene.frames[0])
    return Observation(
        name=scene.name,
        room=scene.room,
        info=scene.info,
        depth_m=frame.depth_m,
        truth_m=scene.truth_m(),
    )


def one_a_room(where: Path, *, spread: int) -> list[Observation]:
    """Return the first scene of each room, by room, every `spread`-th room first."""
    first: dict[str, CapturedScene] = {}
    for scene in open_set(where).scenes:
        first.setdefault(scene.room, scene)
    rooms = sorted(first)
    order = [room for start in range(spread) for room in rooms[start::spread]]
    return [depth_alone(first[room]) for room in order]


def outcome(where: Path, rooms: int, free: Sequence[str] = GROUPS) -> Outcome:
    """Fit the first rooms and score as many others."""
    seen = one_a_room(where, spread=2)[: 2 * rooms]
    start = presets.load("d415")
    began = time.perf_counter()
    solution = fit_depth(seen[:rooms], start, free=free)
    seconds = time.perf_counter() - began
    nominal = seen[0].info.geometry_into(start)
    twins = [twin(one, nominal, seed=100 + n) for n, one in enumerate(seen[rooms:])]
    return Outcome(
        solution=solution,
        held_out=side_by_side(twins, nominal, solution.sensor),
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
    """Print the estimates, what is not told, and the figures of both groups of rooms."""
    where = folder()
    if not where.is_dir():
        raise SystemExit(f"no captures at {where}; set STARLING_CAPTURES to their folder")
    found = outcome(where, int(sys.argv[1]) if len(sys.argv) > 1 else 3)
    print(f"fit: {found.seconds:.0f} s")
    for one in found.solution.estimates:
        print(f"{one.name:22} {one.value:9.4f} +- {one.sd:7.4f} {one.unit:5} from {one.start:.4f}")
    print("score: " + ", ".join(f"{cost:.2f}" for cost in found.solution.cost))
    print("\n".join(found.solution.undetermined))
    _table("fitted", found.solution.scenes)
    _table("held out", found.held_out)


if __name__ == "__main__":
    main()
