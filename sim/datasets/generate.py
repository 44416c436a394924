"""`starling generate`: generate a data set from a plan, in one or several runs."""

from __future__ import annotations

import dataclasses
import time
import warnings
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import tomli_w

from starling.patterns import errors
from starling.sim import files
from starling.sim.console import progress
from starling.sim.console.output import RECORD
from starling.sim.console.threads import cores
from starling.sim.datasets import check_plan, index, render_view, set_folder
from starling.sim.datasets import plan as plans
from starling.sim.datasets.plan import Plan, view
from starling.sim.datasets.set_folder import Layout
from starling.sim.datasets.source import Captured, Dropped, SceneFiles
from starling.sim.datasets.workers import Task, TaskResult, run_locally, run_on_ray, tasks
from starling.sim.render import backend

SHARD_FRAMES = 64  # Default number of frames per archive and per task.


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
    """Generate a data set or resume one; complete tasks on disk are not repeated.

    Args:
        plan: TOML file (see `starling.sim.datasets.plan`).
        out: folder of the set: a new one, or one started by the same plan.
        workers: processes on this machine; 0 uses one per core.
        ray: address of a Ray cluster that replaces them (see `starling.sim.datasets.workers`).
        layout: one folder per view, or archives in the WebDataset layout.
        shard_frames: frames per archive and per task.
        track: wraps the loop over tasks.

    Returns:
        `{"out", "frames", "missing", "duplicate", "differing", "skipped", "frames_per_s",
        "bytes_per_frame", "seconds"}`. Rates refer to the frames of this run, and are None without
        new frames. Frames of skipped views do not count as missing. `differing` is None; `verify`
        measures it.

    Raises:
        InputError: if plan or folder are invalid, the disk is full, or a worker died. Also if the
            record of a complete task is damaged, or a file of a scene is missing and the plan says
            `missing = "stop"`. Complete tasks remain.
    """
    workers = errors.whole_number("workers", workers, 0, 4096)
    shard_frames = errors.whole_number("shard_frames", shard_frames, 1, 10**6)
    if ray and workers:
        raise errors.refuse("workers", "must be 0 with ray", workers, "The cluster has its own.")
    started = time.perf_counter()
    index.refuse_without()
    parsed = plans.read(plan)
    if not (out / RECORD).is_file():
        check_plan.refuse_failing(parsed)
    info = render_view.info_of(render_view.camera(view(parsed, 0)))
    all_tasks = tasks(parsed, shard_frames)
    new = 0
    with set_folder.opened(out, text(plan, parsed, layout, shard_frames), layout) as folder:
        if not folder.finished:
            folder.describe(info)
            done = folder.done(all_tasks, parsed.frames)
            remaining = [task for task in all_tasks if task.number not in done]
            results = (
                run_on_ray(parsed, info, out, remaining, ray)
                if ray
                else run_locally(
                    parsed,
                    info,
                    out,
                    remaining,
                    workers or cores(),
                    on_disk=layout == "folders",
                )
            )
            with closing(results):  # Workers end before the folder is given free.
                for result in _tracked(results, remaining, track):
                    folder.put(result)
                    new += len(result.rows)
            _refuse_changed(text(plan, parsed, layout, shard_frames), out)
            folder.finish({"verb": "generate", "layout": layout})
        figures = set_folder.figures(out)
    seconds = time.perf_counter() - started
    wanted = parsed.count - parsed.frames * len(figures.skipped)
    rows = index.read(out)
    _warn_of_empty(rows)
    frames, missing, duplicate = index.count_frames(rows, wanted)
    return {
        "out": str(out),
        "frames": frames,
        "missing": missing,
        "duplicate": duplicate,
        "differing": None,
        "skipped": [dataclasses.asdict(view) for view in figures.skipped],
        "frames_per_s": new / seconds if new else None,
        "bytes_per_frame": figures.bytes / frames if frames else None,
        "seconds": round(seconds, 3),
    }


def _refuse_changed(now: str, out: Path) -> None:
    """Refuse to finish a set whose plan, meshes or sensor files changed during the run."""
    if files.read_text(out / set_folder.PLAN) != now:
        rule, advice = "must stay the same during the run", "Generate the set again."
        raise errors.refuse("files of the plan", rule, out, advice)


def _warn_of_empty(rows: Sequence[Mapping[str, Any]]) -> None:
    empty = [row["name"] for row in rows if row["ndp_rate"] == 1]
    if empty:
        warnings.warn(
            f"{len(empty)} of {len(rows)} frames have no depth, {empty[0]} first. "
            "Do their poses look at surfaces within range?",
            stacklevel=3,
        )


def _tracked(
    results: Generator[TaskResult], remaining: Sequence[Task], track: progress.Progress
) -> Generator[TaskResult]:
    """Yield results as they arrive, with progress."""
    for _ in track(remaining, "shards"):
        yield next(results)


def text(path: Path, plan: Plan, layout: Layout, shard_frames: int) -> str:
    """Return the set's `plan.toml`: everything that determines its content.

    Args:
        path: file of the plan.
        plan: the parsed plan.
        layout: layout of the set.
        shard_frames: frames per archive and per task.
    """
    digests = {str(file): files.file_digest(file) for file in _files(plan)}
    run = {
        "folder": str(path.absolute().parent),
        "layout": layout,
        "shard_frames": shard_frames,
        "variant": str(backend.mitsuba().variant()),
    }
    table = files.read_toml(path, dict)
    return tomli_w.dumps({"plan": table, "run": run, "files": digests})


def _files(plan: Plan) -> list[Path]:
    """Return the files of scenes and sensors, sorted by name."""
    paths = {Path(sensor.preset) for sensor in plan.sensors if sensor.preset.endswith(".toml")}
    for source in plan.sources:
        if isinstance(source, (SceneFiles, Dropped)):
            paths |= set(source.paths)
        if isinstance(source, Captured):
            paths |= {path / "truth.png" for path in source.paths}
    return sorted(path for path in paths if path.is_file())
