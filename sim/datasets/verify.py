"""The work of `starling verify`: is a data set whole, and would it come out the same again?"""

from __future__ import annotations

import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from starling.patterns import errors
from starling.sim.captures import info as capture_info
from starling.sim.console import progress
from starling.sim.datasets import index, set_folder, shard, stages
from starling.sim.datasets import plan as plans
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.render_view import Row, fingerprint, take


def verify(
    path: Path, *, sample: int = 8, track: progress.Progress = progress.silent
) -> dict[str, Any]:
    """Recompute every frame's checksum, and make a sample of views again.

    Args:
        path: folder of a finished set.
        sample: views that are made anew and compared, by lot; 0 makes none.
        track: wraps the loops.

    Returns:
        `{"frames", "missing", "duplicate", "differing", "frames_per_s", "bytes_per_frame"}`;
        missing are frames of the plan that are in no row, but those of views that were skipped, or
        whose files are not there; differing those whose files are not what the index says, or come
        out otherwise when made again.

    Raises:
        InputError: if the set is not finished, or its plan cannot be read.
    """
    started = time.perf_counter()
    rows = index.read(path)
    told = _told(path)
    lost: set[int] = set()
    other: set[int] = set()
    for files, group in _grouped(path, rows, track):
        for row in group:
            if not all(name in files for name in row["files"]):
                lost.add(row["frame"])
            elif fingerprint({name: files[name] for name in row["files"]}) != row["sha256"]:
                other.add(row["frame"])
    plan = plans.from_table(told["plan"], Path(told["run"]["folder"]))
    skipped = {one["view"] for one in set_folder.figures(path)["skipped"]}
    frames, missing, duplicate = index.counted(rows, plan.count - plan.frames * len(skipped))
    other |= _made_otherwise(path, plan, rows, sample, track) if sample else set()
    return {
        "frames": frames,
        "missing": missing + len(lost),
        "duplicate": duplicate,
        "differing": len(other),
        "frames_per_s": len(rows) / (time.perf_counter() - started),
        "bytes_per_frame": sum(row["bytes"] for row in rows) / max(len(rows), 1),
    }


def _told(path: Path) -> Mapping[str, Any]:
    """What the set was made by."""
    try:
        return tomllib.loads((path / set_folder.PLAN).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        rule = f"must have its {set_folder.PLAN}"
        advice = "Copy it again, or verify what was copied from."
        raise errors.refuse("set", rule, f"{path}: {error}", advice) from error


def _grouped(
    path: Path, rows: Sequence[Row], track: progress.Progress
) -> Iterator[tuple[Mapping[str, bytes], Sequence[Row]]]:
    """Files that are there, and the rows that tell of them: by archive, or by view."""
    by: dict[str, list[Row]] = {}
    for row in rows:
        by.setdefault(row["shard"] or row["name"].partition("/")[0], []).append(row)
    for group in track(list(by.values()), "checksums"):
        archive = group[0]["shard"]
        if not archive:
            names = [name for row in group for name in row["files"]]
            there = [name for name in names if (path / name).is_file()]
            yield {name: (path / name).read_bytes() for name in there}, group
        elif (path / archive).is_file():
            yield shard.unpacked((path / archive).read_bytes()), group
        else:
            yield {}, group


def _made_otherwise(
    path: Path, plan: Plan, rows: Sequence[Row], sample: int, track: progress.Progress
) -> set[int]:
    """Frames of some views that come out otherwise when they are made again."""
    views = sorted({row["view"] for row in rows})
    lot = np.random.default_rng(plan.seed).permutation(len(views))[:sample]
    info = capture_info.read(path / capture_info.FILE)
    stages.of.cache_clear()  # Files may have changed since this process read them.
    before = {row["frame"]: row["sha256"] for row in rows}
    other: set[int] = set()
    for number in track([views[one] for one in sorted(lot)], "made again"):
        for row in take(plan, number, info, path).rows:
            if before.get(row["frame"]) != row["sha256"]:
                other.add(row["frame"])
    return other
