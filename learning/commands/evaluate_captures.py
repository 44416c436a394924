"""Implementation of `starling evaluate`: metrics of methods on held-out rooms."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from starling.learning import registry, shipped
from starling.learning.commands import work_folder
from starling.learning.commands.judge_captures import judge_methods
from starling.learning.commands.train_captures import PHYSICS, trained, trained_method
from starling.learning.data import captured
from starling.learning.data.captured import Simulation
from starling.learning.data.example import Example, Image
from starling.learning.evaluation import evaluate, pictures
from starling.learning.evaluation.evaluate import HolePrediction
from starling.learning.evaluation.metrics import probability_code, probability_of_code
from starling.learning.icp import case_study
from starling.learning.judge.judge import refuse_judges
from starling.learning.method import Method, Predictor
from starling.patterns import errors
from starling.patterns.errors import refuse, whole_number
from starling.sim.captures import capture, png
from starling.sim.captures.capture import CaptureSet
from starling.sim.console import output, progress
from starling.sim.console.names import file_name
from starling.sim.on_demand import OnDemand


def choose_training_rooms(
    rooms: Sequence[str], held: str, count: int | None = None
) -> tuple[str, ...]:
    """Return the training rooms of a held-out room: the next ones in cyclic order.

    Args:
        rooms: all rooms in an arbitrary order.
        held: the held-out room.
        count: number of training rooms; None takes all others.

    Raises:
        InputError: if the room is unknown, or there are too few other rooms.
    """
    errors.one_of("held-out room", held, rooms)
    number = list(rooms).index(held)
    remaining = (*rooms[number + 1 :], *rooms[:number])
    if not remaining:
        raise errors.refuse("rooms", "must be at least 2", 1, "Take captures of more rooms.")
    wanted = len(remaining) if count is None else count
    errors.in_interval("rooms to learn from", wanted, 1, len(remaining))
    return remaining[:wanted]


FOLDS = "folds"  # Output folder with ROOM/METHOD/: trained model, and predictions SCENE.png.

# Simulation for a held-out room, so that its sensor can be calibrated without this room.
Simulations = Callable[[str], Simulation]


@dataclass(frozen=True, kw_only=True, slots=True)
class EvaluationPlan:
    """Settings of an evaluation.

    Raises:
        InputError: if `icp` is 1 or negative: a variance needs two trials. Also if `judges` is not
            1 to 100.
    """

    methods: tuple[str, ...]  # Trained for each held-out room on other rooms.
    models: tuple[Path, ...] = ()  # Folders of `starling train`, evaluated without training.
    held: tuple[str, ...] | None = None  # Held-out rooms; None evaluates all.
    heldout: str | None = None  # Capture set of the held-out rooms; None is that of the training.
    learn_from: int | None = None  # Number of training rooms; None uses all others.
    steps: int | None = None  # Training steps of a network.
    start: tuple[Path, ...] = ()  # Trained models as initial weights of the same methods.
    icp: int = 0  # Trials per object of the case study (`starling.learning.icp`); 0 omits it.
    judge: bool = False  # Judge drawn holes against the device's.
    judges: int = 1  # Number of judges, whose mean scores count.
    seed: int = 0

    def __post_init__(self) -> None:
        if self.icp:
            whole_number("icp", self.icp, 2, 10**6, "Give a number of trials, or 0.")
        refuse_judges(self.judges)


def evaluate_captures(
    captures: str,
    out: Path,
    plan: EvaluationPlan,
    *,
    simulations: Simulations | None = None,
    heldout_simulations: Simulations | None = None,
    force: bool = False,
    options: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Evaluate methods room by room. An interrupted evaluation continues when the call is repeated.

    Args:
        captures: capture set with the device's depth, and reference depth if known.
        out: output folder for models, probabilities, figures and pictures.
        plan: settings.
        simulations: for methods that use physics.
        heldout_simulations: of the scenes in `plan.heldout`; None takes `simulations`.
        force: delete earlier results in the folder.
        options: further arguments for the record.
        track: wraps long loops.

    Returns:
        Metrics of every method (see `starling.learning.evaluation.evaluate.figures`; with
        `plan.judge` also "judge", see `judge_captures.judge_methods`), "icp" (see
        `starling.learning.icp.case_study.figures`; empty if omitted), "out", "seconds".

    Raises:
        InputError: if captures, methods or the folder are invalid.
    """
    start_time = time.perf_counter()
    opened = capture.open_set(captures)
    output.refuse_own_input(out, opened.path)
    tested = opened if plan.heldout is None else _other_captures(plan.heldout, opened, out)
    rooms = _rooms(opened)
    held_out = plan.held or _rooms(tested)
    captured.check_rooms(tested, held_out)
    trained_models = [trained(folder) for folder in plan.models]
    for (_, predictor), folder in zip(trained_models, plan.models, strict=True):
        _refuse_other_size(predictor, folder, tested, held_out)
    names = (*plan.methods, *(name for name, _ in trained_models))
    methods, models = _methods(names, plan), dict(trained_models)
    training_rooms = {
        held: _training_rooms(rooms, held, plan) if plan.methods else () for held in held_out
    }
    if plan.icp:
        case_study.check_objects(scene for scene in tested.scenes if scene.room in held_out)
    on_physics = [name for name in names if name in registry.ON_PHYSICS]
    if on_physics and simulations is None:
        raise refuse("sensor", f"must be given for {on_physics[0]}", "none", "Give --sensor.")
    simulated = {
        held: captured.caching(simulations(held), out / PHYSICS)
        for held in held_out
        if on_physics and simulations
    }
    tested_by = heldout_simulations if plan.heldout else None
    simulated_tests = {
        held: captured.caching(tested_by(held), out / PHYSICS) if tested_by else simulation
        for held, simulation in simulated.items()
    }
    arguments = {
        "captures": captures,
        "plan": plan,
        "simulated_with": {
            held: captured.sensor_digest(simulation.sensor)
            for held, simulation in simulated.items()
        },
        **(options or {}),
    }
    with work_folder.opened(out, arguments, force=force):
        stored: dict[str, list[_Stored]] = {name: [] for name in names}
        for held in track(held_out, "rooms"):
            learning = _Part(opened, training_rooms[held], simulated.get(held), track)
            testing = _Part(tested, (held,), simulated_tests.get(held), track)
            for name in names:
                folder = out / FOLDS / file_name(held) / name
                fit = partial(methods[name].fit, folder=folder, seed=plan.seed, track=track)
                stored[name] += _predictions(learning, testing, folder, models.get(name), fit)
                if plan.heldout is not None and name in plan.methods and name not in models:
                    models[name] = methods[name].load(folder)  # All rooms learn from the same.
        predictions = {name: OnDemand(items, _Stored.read) for name, items in stored.items()}
        scores = {name: evaluate.scores(scenes) for name, scenes in predictions.items()}
        figures = evaluate.figures(scores, seed=plan.seed)
        if plan.judge:
            judged = judge_methods(
                predictions, tested, held_out, judges=plan.judges, seed=plan.seed, track=track
            )
            for name, score in judged.items():
                figures["methods"][name]["judge"] = score
        figures["icp"] = {}
        if plan.icp:
            outcomes = case_study.case_study(
                tested, predictions, trials=plan.icp, seed=plan.seed, track=track
            )
            figures["icp"] = case_study.figures(outcomes)
        output.write_file(out / "curves.png", pictures.curves(scores), force=True)
        output.write_file(out / "scenes.png", pictures.scenes(predictions), force=True)
        work_folder.end(out, "evaluate", arguments, figures)
    return {**figures, "out": str(out), "seconds": round(time.perf_counter() - start_time, 3)}


def _rooms(captures: CaptureSet) -> tuple[str, ...]:
    return tuple(dict.fromkeys(scene.room for scene in captures.scenes))


def _other_captures(path: str, training: CaptureSet, out: Path) -> CaptureSet:
    """Open the captures of the held-out rooms.

    Raises:
        InputError: if they are those of the training, or the output folder is theirs.
    """
    opened = capture.open_set(path)
    output.refuse_own_input(out, opened.path)
    if opened.path.resolve() == training.path.resolve():
        raise refuse("heldout", "must be other captures", path, "Leave it out, or give --rooms.")
    return opened


def _training_rooms(rooms: Sequence[str], held: str, plan: EvaluationPlan) -> tuple[str, ...]:
    if plan.heldout is None:
        return choose_training_rooms(rooms, held, plan.learn_from)
    wanted = len(rooms) if plan.learn_from is None else plan.learn_from
    errors.in_interval("rooms to learn from", wanted, 1, len(rooms))
    return tuple(rooms[:wanted])


def _refuse_other_size(
    predictor: Predictor, model: Path, captures: CaptureSet, rooms: Sequence[str]
) -> None:
    """Refuse scenes of another size than a model needs, before anything is simulated.

    Raises:
        InputError: if the sizes differ.
    """
    shape = getattr(predictor, "only_shape", None)
    for scene in captures.scenes:
        if shape is not None and scene.room in rooms and scene.info.shape != shape:
            rule = f"must be for the size of the scenes, {scene.info.width}x{scene.info.height}"
            got = f"{shape[1]}x{shape[0]} in {model}"
            raise refuse("model", rule, got, "Train it for this size, or take a network.")


@dataclass(frozen=True, eq=False)
class _Part:
    """Rooms of captures, to learn from or to predict."""

    captures: CaptureSet
    rooms: tuple[str, ...]
    simulation: Simulation | None
    track: progress.Progress

    @property
    def names(self) -> list[str]:
        """Names of the scenes."""
        return [scene.name for scene in self.captures.scenes if scene.room in self.rooms]

    @cached_property
    def examples(self) -> Sequence[Example]:
        """The scenes; reading them simulates them."""
        return captured.examples(
            self.captures, rooms=self.rooms, simulation=self.simulation, track=self.track
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Stored:
    """A held-out scene and the file of its prediction."""

    examples: Sequence[Example]
    number: int  # Among the examples.
    path: Path

    def read(self) -> HolePrediction:
        example = self.examples[self.number]
        return HolePrediction(example=example, probability=read_prediction(self.path))


def _methods(names: Sequence[str], plan: EvaluationPlan) -> dict[str, Method]:
    if not names:
        raise refuse("methods", "must be at least one", "none", "Give --methods or --models.")
    if len(set(names)) < len(names):
        raise refuse("methods", "must be different", ", ".join(names), "Name each once.")
    start = {trained_method(model): shipped.folder(model) for model in plan.start}
    for name in start:
        if name not in plan.methods:
            raise refuse(
                "start",
                "must be for a method that learns",
                name,
                "Add it to --methods, or drop it.",
            )
    return {name: registry.method(name, steps=plan.steps, start=start.get(name)) for name in names}


def _predictions(
    learning: _Part,
    testing: _Part,
    folder: Path,
    model: Predictor | None,
    fit: Callable[[Sequence[Example]], Predictor],
) -> list[_Stored]:
    """Predict the held-out scenes, unless the files of their predictions exist.

    Without a trained model, the method is trained on the fold's rooms.
    """
    paths = [folder / f"{name}.png" for name in testing.names]
    if not all(path.is_file() for path in paths):
        predictor = fit(learning.examples) if model is None else model
        for path, example in zip(paths, testing.examples, strict=True):
            code = probability_code(predictor.probability(example))
            output.write_file(path, png.encode(code), force=True)
    examples = testing.examples
    return [
        _Stored(examples=examples, number=number, path=path) for number, path in enumerate(paths)
    ]


def read_prediction(path: Path) -> Image:
    """Read a probability (h, w) that an evaluation stored in one of its folds.

    Raises:
        InputError: if it is missing or not such an image.
    """
    return probability_of_code(png.read(path, "probability"))
