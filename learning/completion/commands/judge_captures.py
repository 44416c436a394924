"""Implementation of `starling evaluate completion`: errors of methods by region and cause."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning.completion import methods
from starling.learning.completion.alignment import Target, align_to_target
from starling.learning.completion.commands.train_captures import training_rooms
from starling.learning.completion.data.layouts import (
    INFRARED,
    Layout,
    list_frames,
    read_frames,
    root,
    select_frames,
)
from starling.learning.completion.data.pairs import Pair, Picture
from starling.learning.completion.evaluation import pictures
from starling.learning.completion.evaluation.coverage import Coverage, coverage_by_region, pooled
from starling.learning.completion.evaluation.metrics import (
    Figures,
    Score,
    Sums,
    average,
    has_depth,
    pool,
    score,
)
from starling.learning.completion.method import Completed, CompletionMethod, complete
from starling.learning.evaluation.bootstrap import paired_share
from starling.patterns.errors import refuse, whole_number
from starling.sim.console import progress, record
from starling.sim.console.output import RECORD, OutputFolder, refuse_own_input

VERB = "evaluate completion"
ERRORS = ("mae_m", "rmse_m")
_GIVEN = "sensor"  # Name of the camera's own depth, the first row of the results.


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
    """Complete frames with known truth by several methods and compare the results.

    `methods` are means over rooms, where all pixels of a room are pooled. `pooled` pools all
    pixels. `sensor` is the camera's own depth. `sigma` is the coverage of unaligned errors by the
    predicted standard deviation and intervals, pooled over pixels (`Coverage`); holes also by
    cause. `sigma_rooms` has the same by room.

    A gain is the relative reduction of the error by a learnt method, compared with the best
    classical method. It is a mean over rooms with a 95 % interval over rooms, over pixels where all
    methods have depth. `learnt_from` lists the rooms that a method was trained on, according to its
    folder; results there are too good.

    Args:
        captures: capture set with reference depth and the camera's own, or data set of another
            layout.
        words: methods, see `methods.create`.
        out: output folder for figures and pictures.
        layout: see `layouts.list_frames`.
        align: target that depth, also the camera's own, is aligned to by scale and shift before
            evaluation, frame by frame; see `alignment.align_to_target`.
        picture: image to use with a capture's depth.
        rooms: rooms to evaluate; None evaluates all.
        frames: number of their frames to evaluate, evenly spaced; None evaluates all.
        seed: seed of the bootstrap.
        force: replace earlier results.
        track: wraps the loop over frames.

    Returns:
        `{"methods": {WORD: {"all", "hole", "valid", "edge", "reasons"}}, "pooled": {WORD: ...},
        "rooms": {WORD: {ROOM: ...}}, "gains": {WORD: {REGION: {FIGURE: ...}}}, "sigma": {WORD:
        {REGION: ...}}, "sigma_rooms": {WORD: {ROOM: {REGION: ...}}}, "learnt_from": {WORD: [ROOM,
        ...]}, "seconds_a_frame": {WORD: ...}, "out", "frames", "seconds"}`.

    Raises:
        InputError: if the captures, the methods or the folder are invalid.
    """
    start = time.perf_counter()
    whole_number("seed", seed, 0, 2**63 - 1)
    judged = select_frames(list_frames(captures, layout, picture), rooms, frames)
    refuse_own_input(out, root(captures, layout))
    if not words:
        advice = f"Choose from {', '.join(methods.NAMES)}."
        raise refuse("methods", "must be at least one", "none", advice)
    ready = {word: methods.create(word) for word in dict.fromkeys(words)}
    scores: dict[str, dict[str, list[Score]]] = {word: {} for word in (_GIVEN, *ready)}
    common: dict[str, dict[str, list[Score]]] = {word: {} for word in ready}
    spent: dict[str, list[float]] = {word: [] for word in ready}
    sigmas: dict[str, dict[str, dict[str, Coverage]]] = {word: {} for word in ready}
    worst = pictures.WorstFrames()
    for pair in read_frames(judged, track, "judge"):
        truth_m, completed = pair.truth(), _complete_by_all(ready, pair, spent)
        aligned = {
            word: align_to_target(align, depth_m, sensor_m=pair.depth_m, truth_m=truth_m)
            for word, depth_m in (
                (_GIVEN, pair.depth_m),
                *((word, result.depth_m) for word, result in completed.items()),
            )
        }
        causes = pair.causes()
        for word, result in completed.items():
            regions = sigmas[word].setdefault(pair.room, {})
            for region, part in coverage_by_region(result, truth_m, pair.valid, causes).items():
                regions[region] = regions.get(region, Coverage()) + part
        judge = partial(score, valid=pair.valid, focal_baseline_px_m=pair.focal_baseline_px_m)
        by_all = np.all([has_depth(aligned[word]) for word in ready], axis=0)
        for word, depth_m in aligned.items():
            frame_score = judge(depth_m, truth_m, causes=causes)
            scores[word].setdefault(pair.room, []).append(frame_score)
            if word in common:
                if not by_all.all():
                    frame_score = judge(depth_m, np.where(by_all, truth_m, np.float32(np.nan)))
                common[word].setdefault(pair.room, []).append(frame_score)
        worst.add(pair, aligned)
    by_room, common_by_room = _by_room(scores), _by_room(common)
    figures = {
        "methods": {word: _average(list(room.values())) for word, room in by_room.items()},
        "pooled": {word: pool(room.values()).figures() for word, room in by_room.items()},
        "rooms": {
            word: {room: room_score.figures() for room, room_score in room_scores.items()}
            for word, room_scores in by_room.items()
        },
        "gains": _gains(common_by_room, seed),
        "sigma": {word: _figures(pooled(room.values())) for word, room in sigmas.items()},
        "sigma_rooms": {
            word: {room: _figures(regions) for room, regions in rooms_of_word.items()}
            for word, rooms_of_word in sigmas.items()
        },
        "learnt_from": {
            word: training_rooms(word, captures, list(by_room[word])) for word in ready
        },
        "seconds_a_frame": {word: float(np.median(times)) for word, times in spent.items()},
        "frames": sum(map(len, scores[_GIVEN].values())),
    }
    arguments = {
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
        folder.write("worst.png", worst.draw())
        content = {"verb": VERB, "arguments": arguments, "versions": record.versions()}
        folder.write(RECORD, record.dumps({**content, "figures": figures}))
    return {**figures, "out": str(folder.path), "seconds": round(time.perf_counter() - start, 3)}


def _complete_by_all(
    ready: Mapping[str, CompletionMethod], pair: Pair, spent: Mapping[str, list[float]]
) -> dict[str, Completed]:
    completed = {}
    for word, method in ready.items():
        start = time.perf_counter()
        completed[word] = complete(method, pair.image, pair.depth_m, pair.valid)
        spent[word].append(time.perf_counter() - start)
    return completed


def _figures(regions: Mapping[str, Coverage]) -> dict[str, dict[str, float | int | None]]:
    return {region: part.figures() for region, part in regions.items()}


def _by_room(scores: Mapping[str, Mapping[str, Sequence[Score]]]) -> dict[str, dict[str, Score]]:
    return {
        word: {room: pool(each) for room, each in rooms.items()} for word, rooms in scores.items()
    }


def _average(rooms: Sequence[Score]) -> dict[str, Any]:
    """Average over rooms, region by region."""
    causes = sorted({cause for room in rooms for cause in room.reasons})
    return {
        **{name: average(getattr(room, name) for room in rooms) for name in _REGIONS},
        "reasons": {
            cause: average(room.reasons.get(cause, Sums()) for room in rooms) for cause in causes
        },
    }


_REGIONS = ("all", "hole", "valid", "edge")


def _gains(by_room: Mapping[str, Mapping[str, Score]], seed: int) -> dict[str, Any]:
    """Compare learnt methods with the best classical method, by region and error."""
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
        errors = {}
        for room, room_score in by_room[method].items():
            figures: Figures = getattr(room_score, region).figures()
            error = figures[name]
            if error is not None:
                errors[room] = float(error)
        return errors

    best = min(plain, key=lambda method: np.mean(list(errors_of(method).values()) or [np.inf]))
    best_errors, word_errors = errors_of(best), errors_of(word)
    both = [room for room, error in best_errors.items() if room in word_errors and error > 0]
    if len(both) < 2:
        return None
    share = paired_share(
        [best_errors[room] for room in both], [word_errors[room] for room in both], both, seed=seed
    )
    return {
        "best": best,
        "gain_pct": 100 * share.share,
        "interval": [100 * share.low, 100 * share.high],
        "rooms_better": share.less,
        "rooms": share.rooms,
    }
