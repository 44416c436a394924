"""`starling verify`: check a data set's completeness, checksums and reproducibility."""

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
from starling.sim.datasets import index, render_view, set_folder, shard
from starling.sim.datasets import plan as plans
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.render_view import Row, fingerprint, render


def verify(
    path: Path, *, sample: int = 8, track: progress.Progress = progress.silent
) -> dict[str, Any]:
    """Recompute every frame's checksum, and regenerate a random sample of views.

    Args:
        path: folder of a finished set.
        sample: number of views to regenerate and compare; 0 regenerates none.
        track: wraps the loops.

    Returns:
        `{"frames", "missing", "duplicate", "differing", "frames_per_s", "bytes_per_frame"}`.
        `missing` counts frames of the plan that have no row or no files, except skipped views.
        `differing` counts frames whose files do not match the index or the regenerated ones.

    Raises:
        InputError: if the set is not finished, or its plan cannot be read.
    """
    started = time.perf_counter()
    rows = index.read(path)
    origin = _origin(path)
    lost: set[int] = set()
    differing: set[int] = set()
    for files, group in _grouped(path, rows, track):
        for row in group:
            if not all(name in files for name in row["files"]):
                lost.add(row["frame"])
            elif fingerprint({name: files[name] for name in row["files"]}) != row["sha256"]:
                differing.add(row["frame"])
    plan = plans.from_table(origin["plan"], Path(origin["run"]["folder"]))
    skipped = {entry["view"] for entry in set_folder.figures(path)["skipped"]}
    frames, missing, duplicate = index.count_frames(rows, plan.count - plan.frames * len(skipped))
    differing |= _irreproducible(path, plan, rows, sample, track) if sample else set()
    return {
        "frames": frames,
        "missing": missing + len(lost),
        "duplicate": duplicate,
        "differing": len(differing),
        "frames_per_s": len(rows) / (time.perf_counter() - started),
        "bytes_per_frame": sum(row["bytes"] for row in rows) / max(len(rows), 1),
    }


def _origin(path: Path) -> Mapping[str, Any]:
    """Read the set's `plan.toml`."""
    try:
        return tomllib.loads((path / set_folder.PLAN).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        rule = f"must have its {set_folder.PLAN}"
        advice = "Copy it again, or verify the original."
        raise errors.refuse("set", rule, f"{path}: {error}", advice) from error


def _grouped(
    path: Path, rows: Sequence[Row], track: progress.Progress
) -> Iterator[tuple[Mapping[str, bytes], Sequence[Row]]]:
    """Yield the existing files of each archive or view, with their rows."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row["shard"] or row["name"].partition("/")[0], []).append(row)
    for group in track(list(groups.values()), "checksums"):
        archive = group[0]["shard"]
        if not archive:
            names = [name for row in group for name in row["files"]]
            existing = [name for name in names if (path / name).is_file()]
            yield {name: (path / name).read_bytes() for name in existing}, group
        elif (path / archive).is_file():
            yield shard.unpack((path / archive).read_bytes()), group
        else:
            yield {}, group


def _irreproducible(
    path: Path, plan: Plan, rows: Sequence[Row], sample: int, track: progress.Progress
) -> set[int]:
    """Regenerate a random sample of views; return the frames that differ."""
    views = sorted({row["view"] for row in rows})
    chosen = np.random.default_rng(plan.seed).permutation(len(views))[:sample]
    info = capture_info.read(path / capture_info.FILE)
    render_view.load_scene.cache_clear()  # Files may have changed since this process read them.
    before = {row["frame"]: row["sha256"] for row in rows}
    differing: set[int] = set()
    for number in track([views[place] for place in sorted(chosen)], "regenerated"):
        for row in render(plan, number, info, path).rows:
            if before.get(row["frame"]) != row["sha256"]:
                differing.add(row["frame"])
    return differing
