"""`starling verify`: check a data set's completeness, checksums and reproducibility."""

from __future__ import annotations

import dataclasses
import hashlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from starling.patterns import errors
from starling.patterns.errors import InputError
from starling.sim import files
from starling.sim.captures import info as capture_info
from starling.sim.captures.info import CaptureInfo
from starling.sim.console import output, progress
from starling.sim.datasets import index, render_view, set_folder, shard
from starling.sim.datasets import plan as plans
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.render_view import Row, fingerprint, render

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, slots=True)
class Finding:
    """One damage of a set."""

    file: str  # File, archive or frame, by path in the set.
    problem: str


def verify(
    path: Path, *, sample: int = 8, track: progress.Progress = progress.silent
) -> dict[str, Any]:
    """Recompute every checksum, and regenerate a random sample of views.

    Args:
        path: folder of a finished set.
        sample: number of views to regenerate and compare; 0 regenerates none.
        track: wraps the loops.

    Returns:
        `{"frames", "missing", "duplicate", "differing", "findings", "frames_per_s",
        "bytes_per_frame"}`. `missing` counts frames of the plan that have no row or no files,
        except skipped views. `differing` counts frames whose files do not match the index or the
        regenerated ones. `findings` lists every damage as `{"file", "problem"}`.

    Raises:
        InputError: if the folder holds no file of a finished set, or pyarrow is not installed.
    """
    sample = errors.whole_number("sample", sample, 0, 2**63 - 1)
    started = time.perf_counter()
    index.refuse_without()
    _refuse_no_set(path)
    findings: list[Finding] = []
    _check_own_files(path, findings)
    info_file = path / capture_info.FILE
    info = _attempt(findings, capture_info.FILE, lambda: capture_info.read(info_file))
    rows = _attempt(findings, index.FILE, lambda: index.read(path)) or []
    lost, differing = _check_frames(path, rows, findings, track)
    findings += [
        Finding(file=name, problem=f"is not listed in {index.FILE}")
        for name in (_unlisted(path, rows) if rows else ())
    ]
    figures = _attempt(findings, output.RECORD, lambda: set_folder.figures(path))
    plan = _attempt(findings, set_folder.PLAN, lambda: _plan(path))
    wanted = len({row["frame"] for row in rows})
    if plan is not None:
        wanted = plan.count - plan.frames * (0 if figures is None else len(figures.skipped))
        findings += _unplanned(plan, rows)
        if sample and info is not None:
            differing |= _irreproducible(path, plan, info, rows, sample, findings, track)
    frames, missing, duplicate = index.count_frames(rows, wanted)
    if missing or duplicate:
        problem = f"lacks {missing} frames of the plan, and repeats {duplicate}"
        findings.append(Finding(file=index.FILE, problem=problem))
    return {
        "frames": frames,
        "missing": missing + len(lost),
        "duplicate": duplicate,
        "differing": len(differing),
        "findings": [dataclasses.asdict(finding) for finding in findings],
        "frames_per_s": len(rows) / (time.perf_counter() - started),
        "bytes_per_frame": sum(row["bytes"] for row in rows) / max(len(rows), 1),
    }


def _refuse_no_set(path: Path) -> None:
    names = (index.FILE, output.RECORD, set_folder.PLAN, set_folder.CHECKSUMS)
    if not any((path / name).is_file() for name in names):
        advice = "Is it a finished set of generate?"
        raise errors.refuse("set", f"must have its {output.RECORD}", path, advice)


def _attempt(findings: list[Finding], file: str, read: Callable[[], T]) -> T | None:
    """Read a part of the set; report its refusal as a finding."""
    try:
        return read()
    except InputError as error:
        findings.append(Finding(file=file, problem=str(error)))
        return None


def _check_own_files(path: Path, findings: list[Finding]) -> None:
    """Compare the set's own files with their checksums."""
    known = _attempt(findings, set_folder.CHECKSUMS, lambda: set_folder.checksums(path)) or {}
    for name in set_folder.OWN_FILES if known else ():
        data = _attempt(findings, name, lambda name=name: files.read_bytes(path / name))
        if data is None:
            continue
        if name not in known:
            problem = f"is not listed in {set_folder.CHECKSUMS}"
        elif hashlib.sha256(data).hexdigest() != known[name]:
            problem = f"differs from its checksum in {set_folder.CHECKSUMS}"
        else:
            continue
        findings.append(Finding(file=name, problem=problem))


def _check_frames(
    path: Path, rows: Sequence[Row], findings: list[Finding], track: progress.Progress
) -> tuple[set[int], set[int]]:
    """Compare the files of all frames with the index; return lost and differing frames."""
    lost: set[int] = set()
    differing: set[int] = set()
    for existing, group in _grouped(path, rows, findings, track):
        extra = set(existing).difference(*(row["files"] for row in group))
        findings += [
            Finding(file=f"{group[0]['shard']}: {name}", problem=f"is not listed in {index.FILE}")
            for name in sorted(extra)
        ]
        for row in group:
            absent = [name for name in row["files"] if name not in existing]
            if absent:
                lost.add(row["frame"])
                problem = f"lacks {', '.join(absent)}"
            elif not _is_listed(row, {name: existing[name] for name in row["files"]}):
                differing.add(row["frame"])
                problem = "differs from its checksum in the index"
            else:
                continue
            findings.append(Finding(file=row["name"], problem=problem))
    return lost, differing


def _is_listed(row: Row, contents: Mapping[str, bytes]) -> bool:
    """Return whether files have the size and the checksum of their row."""
    size = sum(map(len, contents.values()))
    return size == row["bytes"] and fingerprint(contents) == row["sha256"]


def _unlisted(path: Path, rows: Sequence[Row]) -> list[str]:
    """Return archives, and files in folders of views, that readers would take for the set's own.

    Hidden files, and other files at the top of the set, are the user's own.
    """
    listed = {row["shard"] for row in rows}.union(*(row["files"] for row in rows))
    files = [*path.glob("*.tar"), *(file for file in path.glob("*/**/*") if not file.is_dir())]
    names = [file.relative_to(path).as_posix() for file in files]
    return sorted(
        name
        for name in names
        if name not in listed and not any(part[0] == "." for part in name.split("/"))
    )


def _unplanned(plan: Plan, rows: Sequence[Row]) -> Iterator[Finding]:
    """Compare what the index says of each frame with the plan."""
    planned = lru_cache(maxsize=1)(partial(plans.view, plan))
    for row in rows:
        number, repeat = row["view"], row["repeat"]
        if not (0 <= number < plan.scenes * plan.views and 0 <= repeat < plan.frames):
            yield Finding(file=row["name"], problem="is not in the plan")
            continue
        view = planned(number)
        expected = {
            "frame": number * plan.frames + repeat,
            "name": f"{view.name}/{repeat}",
            **{name: getattr(view, name) for name in ("scene", "room", "sensor", "seed")},
        }
        wrong = [name for name, value in expected.items() if row[name] != value]
        if wrong:
            problem = f"has another {', '.join(wrong)} in {index.FILE} than in the plan"
            yield Finding(file=row["name"], problem=problem)


def _plan(path: Path) -> Plan:
    origin = set_folder.origin(path)
    return plans.from_table(origin.plan, Path(origin.run.folder))


def _grouped(
    path: Path, rows: Sequence[Row], findings: list[Finding], track: progress.Progress
) -> Iterator[tuple[Mapping[str, bytes], Sequence[Row]]]:
    """Yield the existing files of each archive or frame, with their rows."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row["shard"] or row["name"], []).append(row)
    for group in track(list(groups.values()), "checksums"):
        archive = group[0]["shard"]
        if archive:
            yield _attempt(findings, archive, lambda name=archive: _unpack(path, name)) or {}, group
            continue
        names = [name for row in group for name in row["files"]]
        existing = [name for name in names if (path / name).is_file()]
        yield {name: files.read_bytes(path / name) for name in existing}, group


def _unpack(path: Path, name: str) -> dict[str, bytes]:
    return shard.unpack(files.read_bytes(path / name), name)


def _irreproducible(
    path: Path,
    plan: Plan,
    info: CaptureInfo,
    rows: Sequence[Row],
    sample: int,
    findings: list[Finding],
    track: progress.Progress,
) -> set[int]:
    """Regenerate a random sample of views; return the frames that differ."""
    views = sorted({row["view"] for row in rows if row["view"] < plan.scenes * plan.views})
    chosen = np.random.default_rng(plan.seed).permutation(len(views))[:sample]
    render_view.load_scene.cache_clear()  # Files may have changed since this process read them.
    before = {row["frame"]: {**row, "shard": None} for row in rows}
    differing: set[int] = set()
    for number in track([views[place] for place in sorted(chosen)], "regenerated"):
        view = f"view {number}"
        rendered = _attempt(findings, view, lambda n=number: render(plan, n, info, path))
        for row in () if rendered is None else rendered.rows:
            if before.get(row["frame"]) != {**row, "shard": None}:
                differing.add(row["frame"])
                problem = "differs from the regenerated frame"
                findings.append(Finding(file=row["name"], problem=problem))
    return differing
