"""Implementation of `starling compare --judge`: how well networks separate simulated from real."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning.evaluation.evaluate import HolePrediction
from starling.learning.judge import pictures, samples
from starling.learning.judge.figures import summary
from starling.learning.judge.judge import JudgedScene, Judgement, judge, room_scores
from starling.learning.judge.samples import pairs
from starling.learning.sampling import sampling
from starling.sim.captures.capture import CaptureSet, Frame
from starling.sim.commands.compare import compare, pair_scenes
from starling.sim.console import output, progress, record
from starling.sim.console.names import file_name
from starling.sim.console.output import Folder, OutputFolder

_FEW_WINDOWS = 30  # Fewer give areas such as 0 or 1 by chance.


def compare_and_judge(
    real: CaptureSet,
    sim: CaptureSet,
    kinds: Sequence[str],
    out: Path | None = None,
    *,
    judges: int = 1,
    seed: int = 0,
    force: bool = False,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Compare two sets and judge them.

    Args:
        real: captures of a device.
        sim: simulated captures of the same scenes.
        kinds: see `judge_captures`.
        out: folder for record and pictures; None writes nothing.
        judges: see `judge_captures`.
        seed: see `judge_captures`.
        force: replace an earlier folder.
        track: wraps the long loops.

    Returns:
        The figures of `starling.sim.commands.compare.compare`, and `judge` with those of
        `judge_captures`.

    Raises:
        InputError: as `compare` and `judge_captures`, or if the folder is taken.
    """
    judged = partial(judge_captures, real, sim, kinds, judges=judges, seed=seed, track=track)
    if out is None:
        return compare(real, sim, track=track) | {"judge": judged()}
    for source in (real, sim):
        output.refuse_own_input(out, source.path)
    with OutputFolder(out, force=force) as folder:
        result = compare(real, sim, track=track) | {"judge": judged(folder=folder)}
        arguments = {
            "real": real.path,
            "sim": sim.path,
            "kinds": list(kinds),
            "judges": judges,
            "seed": seed,
        }
        folder.write(output.RECORD, record.of_run("compare", arguments, result))
    return result | {"out": str(out)}


def judge_captures(
    real: CaptureSet,
    sim: CaptureSet,
    kinds: Sequence[str],
    *,
    judges: int = 1,
    seed: int = 0,
    track: progress.Progress = progress.silent,
    folder: Folder | None = None,
) -> dict[str, dict[str, Any]]:
    """Judge the first frames of all scenes that both sets hold.

    Args:
        real: captures of a device.
        sim: simulated captures of the same scenes.
        kinds: `depth`, `holes`, `infrared`.
        judges: number of judges, whose mean scores count.
        seed: seed of folds, weights and draws.
        track: wraps the long loops.
        folder: gets the pictures of each kind.

    Returns:
        By kind: `{"auc", "interval", "p_value", "rooms": {ROOM: auc}, "windows", "single",
        "seconds"}`. `single` is `{"mean", "deviation"}` of the areas of single judges.

    Raises:
        InputError: if there are fewer than three rooms, no judge, sizes differ, or images are
            missing.
    """
    result: dict[str, dict[str, Any]] = {}
    for kind in kinds:
        start_s = time.perf_counter()
        matched = pairs(kind, real, sim, track=track)
        judged = judge(matched, judges=judges, seed=seed, track=track)
        result[kind] = _figures(judged, seed)
        if folder is not None:
            _draw(kind, judged.scenes, real, sim, folder)
        result[kind]["seconds"] = time.perf_counter() - start_s
    return result


def _figures(judged: Judgement, seed: int) -> dict[str, Any]:
    figures = summary(room_scores(judged.scenes), seed)
    if figures["windows"] < _FEW_WINDOWS:
        text = f"judge: {figures['windows']} windows of each side are too few for a reliable AUC."
        warnings.warn(f"{text} Give larger images or more scenes.", stacklevel=3)
    deviation = float(np.std(judged.areas, ddof=1)) if len(judged.areas) > 1 else None
    single = {"mean": float(np.mean(judged.areas)), "deviation": deviation}
    return {**figures, "single": single}


def judge_methods(
    predictions: Mapping[str, Sequence[HolePrediction]],
    captures: CaptureSet,
    rooms: Sequence[str],
    *,
    judges: int = 1,
    seed: int = 0,
    track: progress.Progress = progress.silent,
) -> dict[str, dict[str, Any]]:
    """Judge the holes that methods draw, against the device's.

    Args:
        predictions: probabilities of the same held-out scenes, by method.
        captures: set of these scenes.
        rooms: held-out rooms.
        judges: as in `judge_captures`.
        seed: seed of the holes, and as in `judge_captures`.
        track: wraps the long loops.

    Returns:
        By method, as `judge_captures`, `holes` alone: drawn depth has no noise of a device.

    Raises:
        InputError: as `judge_captures`.
    """
    scenes = {scene.name: scene for scene in captures.scenes if scene.room in rooms}
    known = {name: samples.read("holes", scene) for name, scene in scenes.items()}
    result: dict[str, dict[str, Any]] = {}
    for method, predicted in predictions.items():
        start_s = time.perf_counter()
        drawn = []
        for each in track(predicted, "draw holes"):
            real = scenes[each.example.scene]
            cells = samples.statistics("holes", _drawn(method, each, seed), real.info)
            drawn.append(samples.pair(real, known[real.name], real, cells))
        figures = _figures(judge(drawn, judges=judges, seed=seed, track=track), seed)
        result[method] = {"holes": {**figures, "seconds": time.perf_counter() - start_s}}
    return result


def _drawn(method: str, prediction: HolePrediction, seed: int) -> Frame:
    """Draw a frame with depth wherever there is no hole, also where the reference is unknown."""
    drawn = sampling.draw_frame(method, prediction.probability, prediction.example, seed=seed)
    flat_m = np.where(drawn.ndp, np.float32(np.nan), np.float32(1.0))
    return Frame(number=0, depth_m=flat_m)


def _draw(
    kind: str, judged: Sequence[JudgedScene], real: CaptureSet, sim: CaptureSet, folder: Folder
) -> None:
    sides = [[pictures.view(kind, scene) for scene in scenes] for scenes in pair_scenes(real, sim)]
    folder.write(f"{kind}-windows.png", pictures.crops(judged, sides))
    for each, views in zip(judged, sides, strict=True):
        folder.write(f"{kind}/{file_name(each.pair.scene)}.png", pictures.maps(each, views))
