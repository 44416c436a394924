"""Implementation of `starling compare --methods`: captures compared with holes drawn by methods."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning import registry
from starling.learning.commands.train_captures import trained
from starling.learning.data import captured
from starling.learning.data.captured import Simulation
from starling.learning.data.example import Image, known_holes
from starling.learning.evaluation.metrics import (
    Judged,
    classification,
    judge,
    pool,
    probability_code,
    probability_of_code,
)
from starling.learning.features import holes
from starling.learning.features.holes import Holes
from starling.learning.method import Predictor
from starling.learning.sampling import sampling
from starling.learning.sampling.sampling import DrawnFrame
from starling.patterns.errors import refuse
from starling.sim.captures.capture import CaptureSet
from starling.sim.console import progress
from starling.sim.plotting import panels, sheet
from starling.sim.plotting.sheet import Panel

_PANEL_IN = 4.2
_SHOWN = 4  # Number of scenes in the picture, the first ones.
_UNTRAINED = ("perfect", "physics")


def predictors(methods: Sequence[str]) -> dict[str, Predictor]:
    """Create methods that need no training, or load methods that `starling train` saved.

    Args:
        methods: names, or folders of trained models.

    Raises:
        InputError: if a word is neither, or two methods have the same name.
    """
    result: dict[str, Predictor] = {}
    for word in methods:
        if word in _UNTRAINED:
            name, predictor = word, registry.method(word).load(Path())
        else:
            name, predictor = trained(Path(word))
        if name in result:
            raise refuse("methods", "must be different", name, "Name each once.")
        result[name] = predictor
    return result


def compare_methods(
    captures: CaptureSet,
    methods: Mapping[str, Predictor],
    *,
    simulation: Simulation | None = None,
    seed: int = 0,
    track: progress.Progress = progress.silent,
) -> tuple[dict[str, Any], bytes]:
    """Draw holes by several methods and compare them with the device's.

    Args:
        captures: captures with the device's depth, and reference depth if known.
        methods: trained methods by name.
        simulation: for methods that use physics.
        seed: seed of the holes.
        track: wraps the loop over scenes.

    Returns:
        `{"real": {"ndp_rate"}, "methods": {NAME: {"ndp_rate", "ndp_iou", "area_ks", "perimeter_ks",
        "run_ks", "auc", "brier_skill", "ece", ...}}}` over all scenes, and a picture (PNG bytes) of
        the first scenes. `ndp_iou`, the rate and the distances (two-sample Kolmogorov-Smirnov,
        0 is best) are of holes drawn once.

    Raises:
        InputError: if the captures are invalid, or a method lacks physics.
    """
    judged: dict[str, Judged] = {}
    drawn_holes: dict[str, list[Holes]] = {name: [] for name in methods}
    overlap: dict[str, list[tuple[int, int]]] = {name: [] for name in methods}
    real: list[Holes] = []
    rows: list[list[Panel]] = []
    captured.warn_of_estimates(captures.scenes)
    for scene in track(captures.scenes, "compare"):
        example = captured.example(scene, simulation=simulation)
        ndp, counted = known_holes(example)
        real.append(holes.measure(ndp, counted))
        drawn: dict[str, DrawnFrame] = {}
        for name, method in methods.items():
            probability = method.probability(example)
            frame = sampling.draw_frame(name, probability, example, seed=seed)
            drawn[name] = frame
            rounded = probability_of_code(probability_code(probability))
            scene_judged = judge(rounded, ndp, counted)
            judged[name] = pool([judged[name], scene_judged]) if name in judged else scene_judged
            drawn_holes[name].append(holes.measure(frame.ndp, counted))
            both, either = ndp & frame.ndp & counted, (ndp | frame.ndp) & counted
            overlap[name].append((int(both.sum()), int(either.sum())))
        if len(rows) < _SHOWN:
            device_m = scene.frame(scene.frames[0]).depth_m
            assert device_m is not None  # Checked by `captured.example`.
            rows.append(_row(scene.name, device_m, drawn))
    real_holes = holes.pool(real)
    figures = {
        name: _figures(judged[name], holes.pool(drawn_holes[name]), real_holes, overlap[name])
        for name in methods
    }
    picture = sheet.draw(rows, captures.info.shape, panel_in=_PANEL_IN)
    return {"real": {"ndp_rate": real_holes.share}, "methods": figures}, picture


def _figures(
    judged: Judged, drawn: Holes, real: Holes, overlap: Sequence[tuple[int, int]]
) -> dict[str, float]:
    both, either = np.sum(overlap, axis=0)
    return {
        "ndp_rate": drawn.share,
        "ndp_iou": float(both / max(either, 1)),
        "area_ks": holes.distance(drawn.area_px, real.area_px).kolmogorov_smirnov,
        "perimeter_ks": holes.distance(drawn.perimeter_px, real.perimeter_px).kolmogorov_smirnov,
        "run_ks": holes.distance(drawn.run_px, real.run_px).kolmogorov_smirnov,
        **dataclasses.asdict(classification(judged)),
    }


def _row(name: str, device_m: Image, drawn: Mapping[str, DrawnFrame]) -> list[Panel]:
    depths = {f"{name}: device": device_m} | {key: frame.depth_m for key, frame in drawn.items()}
    limits = panels.depth_limits(*depths.values())
    return [
        Panel(
            draw=partial(panels.depth, depth_m=depth_m, limits=limits, title=title),
            below_in=panels.BAR_IN,
        )
        for title, depth_m in depths.items()
    ]
