"""The work of `starling generate`: a plan in, a data set out, in however many runs."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import tomli_w

from starling.patterns import errors
from starling.sim.console import progress
from starling.sim.console.threads import cores
from starling.sim.datasets import index, local_workers, ray_workers, render_view, set_folder
from starling.sim.datasets import plan as plans
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.set_folder import Layout
from starling.sim.datasets.source import Captured, Dropped, Files
from starling.sim.datasets.task import Made, Task, tasks
from starling.sim.datasets.view import view
from starling.sim.render import backend

SHARD_FRAMES = 64  # Of an archive, and of what a worker makes at a time.


def generate(
    plan: Path,
    out: Path,
    *,
    workers: int = 0,
    ray: str = "",
    layout: Layout = "folders",
    shard_frames: int = SHARD_FRAMES,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Make a data set, or go on with one; what is whole on disk is not made again.

    Args:
        plan: TOML file (see `starling.sim.datasets.plan`).
        out: folder of the set, new or begun by the same plan.
        workers: processes of this machine; 0 takes one for each core.
        ray: address of a Ray cluster that makes it in their stead; see `starling.sim.datasets.ray_workers`.
        layout: a folder each view, or archives in WebDataset's layout.
        shard_frames: of an archive, and of what a worker makes at a time.
        track: wraps the loop over tasks.

    Returns:
        `{"out", "frames", "missing", "duplicate", "differing", "skipped", "frames_per_s",
        "bytes_per_frame", "seconds"}`; rates are of what this run made, None where it was nothing;
        frames of views that were skipped are not missing; `differing` is None: `verify` looks.

    Raises:
        InputError: whatever is wrong with plan or folder, a scene's file that is missing where the
            plan stops at that, a full disk, or a worker that died. What is there stays.
    """
    errors.in_interval("workers", workers, 0, 4096)
    errors.in_interval("shard_frames", shard_frames, 1, 10**6)
    if ray and workers:
        raise errors.refuse("workers", "must be 0 with ray", workers, "The cluster has its own.")
    started = time.perf_counter()
    index.refuse_without()
    asked = plans.read(plan)
    info = render_view.info_of(render_view.camera(view(asked, 0)))
    every = tasks(asked, shard_frames)
    new = 0
    with set_folder.opened(out, text(plan, asked, layout, shard_frames), layout) as folder:
        if not folder.finished:
            folder.describe(info)
            done = folder.done()
            left = [one for one in every if one.number not in done]
            made = (
                ray_workers.made(asked, info, out, left, ray)
                if ray
                else local_workers.made(asked, info, out, left, workers or cores())
            )
            for one in _told(made, left, track):
                folder.put(one)
                new += len(one.rows)
            folder.finish({"verb": "generate", "layout": layout})
        figures = set_folder.figures(out)
    seconds = time.perf_counter() - started
    wanted = asked.count - asked.frames * len(figures["skipped"])
    frames, missing, duplicate = index.counted(index.read(out), wanted)
    return {
        "out": str(out),
        "frames": frames,
        "missing": missing,
        "duplicate": duplicate,
        "differing": None,
        "skipped": figures["skipped"],
        "frames_per_s": new / seconds if new else None,
        "bytes_per_frame": figures["bytes"] / frames if frames else None,
        "seconds": round(seconds, 3),
    }


def _told(made: Iterator[Made], left: Sequence[Task], track: progress.Progress) -> Iterator[Made]:
    """Tell of each as it comes."""
    for _ in track(left, "shards"):
        yield next(made)


def text(path: Path, plan: Plan, layout: Layout, shard_frames: int) -> str:
    """All that a set follows from, as its `plan.toml` says it.

    Args:
        path: of the plan's file.
        plan: what it says.
        layout: of the set.
        shard_frames: likewise.
    """
    files = {str(one): one.stat().st_size for one in _files(plan)}
    run = {
        "folder": str(path.absolute().parent),
        "layout": layout,
        "shard_frames": shard_frames,
        "variant": str(backend.mitsuba().variant()),
    }
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    return tomli_w.dumps({"plan": table, "run": run, "files": files})


def _files(plan: Plan) -> list[Path]:
    """Files that scenes and sensors are read from, by name."""
    found = {Path(one.preset) for one in plan.sensors if one.preset.endswith(".toml")}
    for source in plan.sources:
        if isinstance(source, (Files, Dropped)):
            found |= set(source.paths)
        if isinstance(source, Captured):
            found |= {path / "truth.png" for path in source.paths}
    return sorted(path for path in found if path.is_file())
