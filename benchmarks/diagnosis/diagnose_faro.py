"""Diagnose the gap between a simulated and a real D415: where, which effects, how far.

The script diagnoses one scene of each room of `d415-faro`. The sensor is the preset, in all rooms,
or a sensor fitted by `benchmarks/calibration/calibrate_faro.py --out DIR`, in the rooms held out of
its fit. OUT holds reports and cached simulations, so an interrupted run can continue.

Usage:
    STARLING_CAPTURES=... python benchmarks/diagnosis/diagnose_faro.py --out OUT [--residual]
    STARLING_CAPTURES=... python benchmarks/diagnosis/diagnose_faro.py --out OUT --sensor FILE \
        --rooms 4426 5074 k 6422 g --leave-out motion
    STARLING_CAPTURES=... python benchmarks/diagnosis/diagnose_faro.py --out OUT --set d415-table \
        --bounds
    STARLING_CAPTURES=... python benchmarks/diagnosis/diagnose_faro.py --out OUT --set d415-table \
        --bounds --off
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
    parser.add_argument("--rooms", nargs="*", default=[], help="rooms to diagnose; default: all")
    parser.add_argument("--leave-out", nargs="*", default=[], help="families to exclude")
    parser.add_argument(
        "--bounds",
        action="store_true",
        help="exclude the border that was cropped from the published depth",
    )
    parser.add_argument("--off", action="store_true", help="use the pairs with the projector off")
    parser.add_argument("--residual", action="store_true")
    options = parser.parse_args()
    started = time.perf_counter()
    whole = Path(os.environ["STARLING_CAPTURES"]) / options.set
    part = options.out / "captures"
    if not part.exists():
        temporary = options.out / ".captures"  # Renamed when complete.
        shutil.rmtree(temporary, ignore_errors=True)
        copy_scenes(whole, temporary, options.rooms)
        if options.bounds:
            for scene in capture.open_set(temporary).scenes:
                crop_reference(scene)
        temporary.rename(part)
    emitter = "off" if options.off else None
    sensor = resolve.load(options.sensor, captures=str(part), emitter=emitter)
    with progress.on_stderr() as track:
        answer = diagnose_captures(
            str(part),
            sensor,
            options.out / "report",
            cache=options.out / "cache",
            leave_out=options.leave_out,
            residual=options.residual,
            force=True,
            track=track,
        )
    print(as_text(answer))
    print(f"{(time.perf_counter() - started) / 60:.1f} minutes")


def copy_scenes(whole: Path, part: Path, rooms: list[str]) -> None:
    """Write a capture set with the first scene of each room."""
    for scene in first_of_each(whole, rooms).values():
        shutil.copytree(scene.path, part / scene.name)
    shutil.copy(whole / "capture.toml", part)


def crop_reference(scene: capture.CapturedScene) -> None:
    """Remove reference depth outside the rectangle of rows and columns with depth."""
    inside = bounds(scene.frame(scene.frames[0]).depth_m)
    path = str(scene.path / "truth.png")
    truth = cv2.imread(path, cv2.IMREAD_UNCHANGED)
    cv2.imwrite(path, np.where(inside, truth, 0).astype(truth.dtype))


if __name__ == "__main__":
    main()
