"""Implementation of `starling train`: trains a method on captures."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from starling.learning import registry, shipped
from starling.learning.commands import work_folder
from starling.learning.data import captured
from starling.learning.data.captured import Simulation
from starling.learning.method import Predictor
from starling.patterns.errors import InputError, one_of, refuse, whole_number
from starling.sim import files
from starling.sim.captures import capture
from starling.sim.console import progress
from starling.sim.console.output import RECORD, refuse_own_input

PHYSICS = "physics"  # Folder of cached simulations in the output.


def train_captures(
    method: str,
    captures: str,
    out: Path,
    *,
    simulation: Simulation | None = None,
    rooms: Sequence[str] | None = None,
    steps: int | None = None,
    start: Path | None = None,
    seed: int = 0,
    force: bool = False,
    options: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Train a method. Interrupted training continues when the same call is repeated.

    Args:
        method: one of `starling.learning.registry.NAMES`.
        captures: capture set with the device's depth, and reference depth if known.
        out: output folder for model, checkpoint and loss curve.
        simulation: for methods that use physics; ignored by others.
        rooms: training rooms; None uses all.
        steps: training steps of a network; None uses its default.
        start: trained model of the same method, as initial weights.
        seed: seed of all random draws.
        force: delete earlier results in the folder.
        options: further arguments for the record.
        track: wraps long loops.

    Returns:
        `{"method", "scenes", "ndp_rate", "out", "seconds"}`.

    Raises:
        InputError: if captures, method or folder are invalid.
    """
    start_time = time.perf_counter()
    whole_number("seed", seed, 0, 2**63 - 1)
    initial_model = None if start is None else trained_folder(start, method)
    untrained_method = registry.method(method, steps=steps, start=initial_model)
    if method not in registry.ON_PHYSICS:
        simulation = None
    elif simulation is None:
        raise refuse("sensor", f"must be given for {method}", "none", "Give --sensor.")
    else:
        simulation = captured.caching(simulation, out / PHYSICS)
    opened = capture.open_set(captures)
    refuse_own_input(out, opened.path)
    captured.check_rooms(opened, rooms or ())
    arguments = {
        "method": method,
        "captures": captures,
        "rooms": rooms,
        "steps": steps,
        "start": start,
        "seed": seed,
        "simulated_with": simulation and captured.sensor_digest(simulation.sensor),
        **(options or {}),
    }
    with work_folder.opened(out, arguments, force=force):
        examples = captured.examples(
            opened,
            rooms=rooms,
            simulation=simulation,
            track=track,
        )
        untrained_method.fit(examples, folder=out, seed=seed, track=track)
        figures = {
            "method": method,
            "scenes": [scene.name for scene in captured.scenes_in(opened, rooms)],
            "ndp_rate": captured.ndp_rate(examples),
        }
        work_folder.end(out, "train", arguments, figures)
    return {**figures, "out": str(out), "seconds": round(time.perf_counter() - start_time, 3)}


def trained(model: Path) -> tuple[str, Predictor]:
    """Load the result of `train_captures`: the method's name and the predictor.

    Args:
        model: its folder, or the name of a shipped model.

    Raises:
        InputError: if it is neither, or damaged.
    """
    name = trained_method(model)
    return name, registry.method(name).load(shipped.folder(model))


def trained_method(model: Path) -> str:
    """Return the name of a trained model's method.

    Raises:
        InputError: if it is not a trained model.
    """
    try:
        path = shipped.folder(model) / RECORD
        method = files.parse_json(files.read_bytes(path), path)["arguments"]["method"]
    except (InputError, KeyError, TypeError) as error:
        raise refuse(
            "model",
            "must be a folder that `starling train` has finished",
            model,
            f"Train it, name the right one, or one of {', '.join(shipped.NAMES)}.",
        ) from error
    one_of("method", method, registry.NAMES)
    return method


def trained_folder(model: Path, method: str) -> Path:
    """Return the folder of a model that a method can start from.

    Raises:
        InputError: if it is not a trained model, or of another method.
    """
    name = trained_method(model)
    if name != method:
        raise refuse("start", f"must be a trained {method}", f"{model}, {name}", "Name another.")
    return shipped.folder(model)
