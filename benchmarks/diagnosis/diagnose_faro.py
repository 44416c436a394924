"""What separates a simulated D415 from the real one: where, which effects, how far.

Diagnoses one scene of each room of `d415-faro`, from the preset in all rooms, and from sensors that
`benchmarks/calibration/calibrate_faro.py --out DIR` fitted, each in the rooms that it never saw. Reports are
kept in OUT, as is all that is simulated: a run that was stopped goes on where it was.

Usage:
    STARLING_CAPTURES=... python benchmarks/diagnosis/diagnose_faro.py --out OUT [--residual]
    STARLING_CAPTURES=... python benchmarks/diagnosis/diagnose_faro.py --out OUT --sensor FILE \
        --rooms 4426 5074 k 6422 g --leave-out motion
    STARLING_CAPTURES=... python benchmarks/diagnosis/diagnose_faro.py --out OUT --set d415-table --bounds
    STARLING_CAPTURES=... python benchmarks/diagnosis/diagnose_faro.py --out OUT --set d415-table --bounds \
        --off
"""

from __future__ import annotations

import argparse
import os
import shutil
import time
from pathlib import Path

import cv2
import numpy as np
from rooms import first_of_each
from table_gap import bounds

from starling.diagnosis.command import as_text, diagnose_captures
from starling.sim.captures import capture
from starling.sim.console import progress
from starling.sim.sensor import resolve


def main() -> None:
    """Diagnose and print the answer."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--set", default="d415-faro")
    parser.add_argument("--sensor", default="d415")
    parser.add_argument("--rooms", nargs="*", default=[], help="rooms to ask; all if none")
    parser.add_argument("--leave-out", nargs="*", default=[], help="families that are not tried")
    parser.add_argument(
        "--bounds",
        action="store_true",
        help="leave out a border that the device's depth was cut by before it was published",
    )
    parser.add_argument("--off", action="store_true", help="the pairs with the projector off")
    parser.add_argument("--residual", action="store_true")
    asked = parser.parse_args()
    begun = time.perf_counter()
    whole = Path(os.environ["STARLING_CAPTURES"]) / asked.set
    part = asked.out / "captures"
    if not part.exists():
        aside = asked.out / ".captures"  # Named last: what is half done is done again.
        shutil.rmtree(aside, ignore_errors=True)
        chosen(whole, aside, asked.rooms)
        if asked.bounds:
            for scene in capture.open_set(aside).scenes:
                bound(scene)
        aside.rename(part)
    emitter = "off" if asked.off else None
    sensor = resolve.load(asked.sensor, captures=str(part), emitter=emitter)
    with progress.on_stderr() as track:
        told = diagnose_captures(
            str(part),
            sensor,
            asked.out / "report",
            cache=asked.out / "cache",
            leave_out=asked.leave_out,
            residual=asked.residual,
            force=True,
            track=track,
        )
    print(as_text(told))
    print(f"{(time.perf_counter() - begun) / 60:.1f} minutes")


def chosen(whole: Path, part: Path, rooms: list[str]) -> None:
    """Write a capture set that has the first scene of each room."""
    for scene in first_of_each(whole, rooms).values():
        shutil.copytree(scene.path, part / scene.name)
    shutil.copy(whole / "capture.toml", part)


def bound(scene: capture.CapturedScene) -> None:
    """Forget reference depth outside the rectangle in which most rows and columns have depth."""
    inside = bounds(scene.frame(scene.frames[0]).depth_m)
    path = str(scene.path / "truth.png")
    truth = cv2.imread(path, cv2.IMREAD_UNCHANGED)
    cv2.imwrite(path, np.where(inside, truth, 0).astype(truth.dtype))


if __name__ == "__main__":
    main()
