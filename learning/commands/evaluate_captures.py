"""The work of `starling evaluate`: methods, captures, figures of rooms that nobody learnt from."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning import registry, shipped
from starling.learning.commands import work_folder
from starling.learning.commands.train_captures import PHYSICS, trained, trained_method
from starling.learning.data import captured, folds
from starling.learning.data.captured import Simulation
from starling.learning.data.example import Example, Image
from starling.learning.evaluation import evaluate, pictures, report
from starling.learning.evaluation.evaluate import Told
from starling.learning.icp import case_study
from starling.learning.method import Method, Predictor
from starling.patterns.errors import refuse
from starling.patterns.whole import whole
from starling.sim.captures import capture, png
from starling.sim.captures.capture import CaptureSet
from starling.sim.console import output, progress

FOLDS = "folds"  # In the output: ROOM/METHOD/ with what was learnt and SCENE.png, what was told.
_CODES = 65535  # A probability is kept in 16 bits.

Simulations = Callable[[str], Simulation]  # Of the room held out: its sensor may not have seen it.


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan:
    """What is evaluated, and how.

    Raises:
        InputError: if `icp` is 1 or negative: a variance needs two.
    """

    methods: tuple[str, ...]  # Trained anew for each room, on others.
    models: tuple[Path, ...] = ()  # Folders of `starling train`, asked as they are.
    held: tuple[str, ...] | None = None  # Rooms to judge; None judges all.
    learn_from: int | None = None  # Rooms to learn from; None learns from all others.
    steps: int | None = None  # Of a network's training.
    start: tuple[Path, ...] = ()  # Trained models that methods of the same name go on from.
    icp: int = (
        0  # First guesses an object of the case study (`starling.learning.icp`); 0 leaves it out.
    )
    seed: int = 0

    def __post_init__(self) -> None:
        if self.icp:
            whole("icp", self.icp, 2, 10**6, "Give a number of trials, or 0.")


def evaluate_captures(
    captures: str,
    out: Path,
    plan: Plan,
    *,
    simulations: Simulations | None = None,
    force: bool = False,
    asked: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Judge methods room by room; what was cut short is gone on with when asked for again.

    Args:
        captures: capture set with reference depth and the device's own.
        out: folder for models, probabilities, figures and pictures.
        plan: which methods, and on what.
        simulations: for methods that build on physics.
        force: drop what starling left in the folder.
        asked: more arguments for the record.
        track: wraps loops that take long.

    Returns:
        Figures of every method (see `starling.learning.evaluation.report.figures`), "icp" (see
        `starling.learning.icp.case_study.figures`; empty where it was not asked for), "out", "seconds".

    Raises:
        InputError: whatever is wrong with captures, methods or the folder.
    """
    begun = time.perf_counter()
    opened = capture.open_set(captures)
    output.refuse_own_input(out, opened.path)
    rooms = tuple(dict.fromkeys(scene.room for scene in opened.scenes))
    held_out = plan.held or rooms
    captured.check_rooms(opened, held_out)
    trained_models = [trained(folder) for folder in plan.models]
    names = (*plan.methods, *(name for name, _ in trained_models))
    methods, models = _methods(names, plan), dict(trained_models)
    learnt_from = {
        held: folds.learnt_from(rooms, held, plan.learn_from) if plan.methods else ()
        for held in held_out
    }
    if plan.icp:
        case_study.check_objects(scene for scene in opened.scenes if scene.room in held_out)
    on_physics = [name for name in names if name in registry.ON_PHYSICS]
    if on_physics and simulations is None:
        raise refuse("sensor", f"must be given for {on_physics[0]}", "none", "Give --sensor.")
    simulated = {
        held: captured.caching(simulations(held), out / PHYSICS)
        for held in held_out
        if on_physics and simulations
    }
    arguments = {
        "captures": captures,
        "plan": plan,
        "simulated_with": {
            held: captured.sensor_digest(how.sensor) for held, how in simulated.items()
        },
        **(asked or {}),
    }
    work_folder.begin(out, arguments, force=force)
    told: dict[str, list[Told]] = {name: [] for name in names}
    for held in track(held_out, "rooms"):
        fold = _Fold(opened, held, learnt_from[held], simulated.get(held))
        for name in names:
            folder = out / FOLDS / held / name
            learnt = partial(_learnt, fold, methods[name], models.get(name), folder, plan, track)
            told[name] += _told(fold, folder, learnt)
    scores = {name: evaluate.scores(of_it) for name, of_it in told.items()}
    figures = report.figures(scores, seed=plan.seed)
    figures["icp"] = {}
    if plan.icp:
        outcomes = case_study.case_study(opened, told, trials=plan.icp, seed=plan.seed, track=track)
        figures["icp"] = case_study.figures(outcomes)
    output.write_file(out / "curves.png", pictures.curves(scores), force=True)
    output.write_file(out / "scenes.png", pictures.scenes(told), force=True)
    work_folder.end(out, "evaluate", arguments, figures)
    return {**figures, "out": str(out), "seconds": round(time.perf_counter() - begun, 3)}


@dataclass(frozen=True, eq=False)
class _Fold:
    """A room held out and those learnt from; scenes are read when first asked for."""

    captures: CaptureSet
    held: str
    rooms: tuple[str, ...]  # To learn from.
    simulation: Simulation | None

    @cached_property
    def learnt_from(self) -> list[Example]:
        return captured.examples(self.captures, rooms=self.rooms, simulation=self.simulation)

    @cached_property
    def judged(self) -> list[Example]:
        return captured.examples(self.captures, rooms=(self.held,), simulation=self.simulation)


def _methods(names: Sequence[str], plan: Plan) -> dict[str, Method]:
    if not names:
        raise refuse("methods", "must be at least one", "none", "Give --methods or --models.")
    if len(set(names)) < len(names):
        raise refuse("methods", "must be different", ", ".join(names), "Name each once.")
    start = {trained_method(model): shipped.folder(model) for model in plan.start}
    for name in start:
        if name not in plan.methods:
            raise refuse("start", "must be for a method that learns", name, "Name it, or drop it.")
    return {name: registry.method(name, steps=plan.steps, start=start.get(name)) for name in names}


def _learnt(
    fold: _Fold,
    method: Method,
    model: Predictor | None,
    folder: Path,
    plan: Plan,
    track: progress.Progress,
) -> Predictor:
    """The model where there is one, else what the method learns from the fold's rooms."""
    if model is not None:
        return model
    return method.fit(fold.learnt_from, folder=folder, seed=plan.seed, track=track)


def _told(fold: _Fold, folder: Path, predictor: Callable[[], Predictor]) -> list[Told]:
    """What a method tells of the held-out scenes: read where it lies there already."""
    names = [scene.name for scene in fold.captures.scenes if scene.room == fold.held]
    paths = [folder / f"{name}.png" for name in names]
    if not all(path.is_file() for path in paths):
        made = predictor()
        for path, example in zip(paths, fold.judged, strict=True):
            code = np.round(made.probability(example) * _CODES).astype(np.uint16)
            output.write_file(path, png.encode(code), force=True)
    return [
        Told(example=example, probability=read_told(path))
        for path, example in zip(paths, fold.judged, strict=True)
    ]


def read_told(path: Path) -> Image:
    """Read a probability (h, w) that an evaluation has kept in one of its folds.

    Raises:
        InputError: if it is missing or no such image.
    """
    return png.read(path, "probability").astype(np.float32) / np.float32(_CODES)
