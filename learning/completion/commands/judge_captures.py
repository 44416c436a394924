"""The work of `starling evaluate completion`: how far methods are off, by region and by cause."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning.completion import methods
from starling.learning.completion.alignment import Target, judged_as
from starling.learning.completion.data.layouts import (
    INFRARED,
    Layout,
    chosen,
    listed,
    readings,
    root,
)
from starling.learning.completion.data.pairs import Pair, Picture
from starling.learning.completion.evaluation import pictures
from starling.learning.completion.evaluation.metrics import (
    Figures,
    Score,
    Sums,
    answered,
    averaged,
    pooled,
    score,
)
from starling.learning.completion.evaluation.sigma_coverage import Coverage, of_regions
from starling.learning.completion.evaluation.training_rooms import learnt_from
from starling.learning.completion.method import Completed, Method, complete
from starling.learning.evaluation.figures.bootstrap import paired_share
from starling.patterns.errors import refuse
from starling.sim.console import progress, record
from starling.sim.console.output import RECORD, OutputFolder, refuse_own_input

ERRORS = ("mae_m", "rmse_m")
_GIVEN = "sensor"  # What the camera itself has, as the first of the methods.


def judge_captures(
    captures: str,
    words: Sequence[str],
    out: Path,
    *,
    layout: Layout = "captures",
    align: Target = "none",
    picture: Picture = INFRARED,
    rooms: Sequence[str] | None = None,
    frames: int | None = None,
    seed: int = 0,
    force: bool = False,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Complete frames whose truth is known by several methods, and compare.

    Args:
        captures: capture set with reference depth and the camera's own, or data set of another
            layout.
        words: methods, as `methods.asked` takes them.
        out: folder for figures and pictures.
        layout: as `layouts.listed` takes it.
        align: what depth is brought to by scale and shift before it is judged, frame by frame, the
            camera's own too; see `alignment.judged_as`.
        picture: the image that goes with a capture's depth.
        rooms: to judge; None judges all.
        frames: to judge, so many of theirs, evenly spread; None judges all.
        seed: of the intervals' draws.
        force: replace what was judged before.
        track: wraps the loop over frames.

    Returns:
        `{"methods": {WORD: {"all", "hole", "valid", "edge", "reasons"}}, "pooled": the same of all
        pixels alike, "rooms": {WORD: {ROOM: ...}}, "gains": {WORD: {REGION: {FIGURE: ...}}},
        "sigma": {WORD: {REGION: ...}}, "learnt_from": {WORD: [ROOM, ...]}, "seconds_a_frame":
        {WORD: ...}, "out", "frames", "seconds"}`. `methods` are means over rooms, each of whose
        pixels count alike; `sensor` is the camera's own depth. `sigma` tells how often the error
        that a method expects covers its own (`sigma_coverage`), unaligned. A gain is what share of
        the error of the best method that learns nothing a learnt one takes away, means over rooms,
        with a 95 % interval over rooms; of pixels that all methods have depth of. `learnt_from` are
        rooms that a method has learnt from, as far as its folder tells: judging there flatters it.

    Raises:
        InputError: whatever is wrong with the captures, the methods or the folder.
    """
    begun = time.perf_counter()
    judged = chosen(listed(captures, layout, picture), rooms, frames)
    refuse_own_input(out, root(captures, layout))
    if not words:
        raise refuse("methods", "must be at least one", "none", f"Of {', '.join(methods.NAMES)}.")
    ready = {word: methods.asked(word) for word in dict.fromkeys(words)}
    scores: dict[str, dict[str, list[Score]]] = {word: {} for word in (_GIVEN, *ready)}
    common: dict[str, dict[str, list[Score]]] = {word: {} for word in ready}
    spent: dict[str, list[float]] = {word: [] for word in ready}
    sigmas: dict[str, dict[str, Coverage]] = {word: {} for word in ready}
    worst = pictures.Worst()
    for one in readings(judged, track, "judge"):
        truth_m, completed = one.truth(), _completed(ready, one, spent)
        told = {
            word: judged_as(align, depth_m, sensor_m=one.depth_m, truth_m=truth_m)
            for word, depth_m in (
                (_GIVEN, one.depth_m),
                *((word, found.depth_m) for word, found in completed.items()),
            )
        }
        for word, found in completed.items():
            for region, part in of_regions(found, truth_m, one.valid).items():
                sigmas[word][region] = sigmas[word].get(region, Coverage()) + part
        judge = partial(score, valid=one.valid, focal_baseline_px_m=one.focal_baseline_px_m)
        causes = one.causes()
        by_all = np.all([answered(told[word]) for word in ready], axis=0)
        for word, depth_m in told.items():
            found = judge(depth_m, truth_m, causes=causes)
            scores[word].setdefault(one.room, []).append(found)
            if word in common:
                if not by_all.all():
                    found = judge(depth_m, np.where(by_all, truth_m, np.float32(np.nan)))
                common[word].setdefault(one.room, []).append(found)
        worst.see(one, told)
    by_room, alike = _by_room(scores), _by_room(common)
    figures = {
        "methods": {word: _averaged(list(of.values())) for word, of in by_room.items()},
        "pooled": {word: pooled(of.values()).figures() for word, of in by_room.items()},
        "rooms": {
            word: {room: one.figures() for room, one in of.items()} for word, of in by_room.items()
        },
        "gains": _gains(alike, seed),
        "sigma": {
            word: {region: part.figures() for region, part in of.items()}
            for word, of in sigmas.items()
        },
        "learnt_from": {word: learnt_from(word, captures, list(by_room[word])) for word in ready},
        "seconds_a_frame": {word: float(np.median(one)) for word, one in spent.items()},
        "frames": sum(map(len, scores[_GIVEN].values())),
    }
    asked = {
        "captures": captures,
        "methods": list(words),
        "layout": layout,
        "align": align,
        "picture": picture,
        "rooms": rooms,
        "frames": frames,
        "seed": seed,
    }
    with OutputFolder(out, force=force) as folder:
        folder.write("worst.png", worst.drawn())
        kept = {"verb": "evaluate completion", "arguments": asked, "versions": record.versions()}
        folder.write(RECORD, record.dumps({**kept, "figures": figures}))
    return {**figures, "out": str(folder.path), "seconds": round(time.perf_counter() - begun, 3)}


def _completed(
    ready: Mapping[str, Method], one: Pair, spent: Mapping[str, list[float]]
) -> dict[str, Completed]:
    found = {}
    for word, method in ready.items():
        started = time.perf_counter()
        found[word] = complete(method, one.image, one.depth_m, one.valid)
        spent[word].append(time.perf_counter() - started)
    return found


def _by_room(scores: Mapping[str, Mapping[str, Sequence[Score]]]) -> dict[str, dict[str, Score]]:
    return {
        word: {room: pooled(each) for room, each in rooms.items()} for word, rooms in scores.items()
    }


def _averaged(rooms: Sequence[Score]) -> dict[str, Any]:
    """Means over rooms, region by region."""
    causes = sorted({cause for room in rooms for cause in room.reasons})
    return {
        **{name: averaged(getattr(room, name) for room in rooms) for name in _REGIONS},
        "reasons": {
            cause: averaged(room.reasons.get(cause, Sums()) for room in rooms) for cause in causes
        },
    }


_REGIONS = ("all", "hole", "valid", "edge")


def _gains(by_room: Mapping[str, Mapping[str, Score]], seed: int) -> dict[str, Any]:
    """Learnt methods beside the best that learns nothing, region by region, error by error."""
    plain = [word for word in by_room if word in methods.CLASSICAL]
    learnt = [word for word in by_room if word not in plain]
    if not plain or len(next(iter(by_room.values()))) < 2:
        return {}
    return {
        word: {
            region: {name: _gain(by_room, plain, word, region, name, seed) for name in ERRORS}
            for region in _REGIONS
        }
        for word in learnt
    }


def _gain(
    by_room: Mapping[str, Mapping[str, Score]],
    plain: Sequence[str],
    word: str,
    region: str,
    name: str,
    seed: int,
) -> dict[str, Any] | None:
    def errors_of(method: str) -> dict[str, float]:
        found = {}
        for room, one in by_room[method].items():
            figures: Figures = getattr(one, region).figures()
            error = figures[name]
            if error is not None:
                found[room] = float(error)
        return found

    best = min(plain, key=lambda method: np.mean(list(errors_of(method).values()) or [np.inf]))
    theirs, own = errors_of(best), errors_of(word)
    both = [room for room, error in theirs.items() if room in own and error > 0]
    if len(both) < 2:
        return None
    less = paired_share(
        [theirs[room] for room in both], [own[room] for room in both], both, seed=seed
    )
    return {
        "best": best,
        "gain_pct": 100 * less.share,
        "interval": [100 * less.low, 100 * less.high],
        "rooms_better": less.less,
        "rooms": less.rooms,
    }
