"""The work of `starling train`: captures in, a method that has learnt out."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from starling.learning import registry, shipped
from starling.learning.commands import work_folder
from starling.learning.data import captured
from starling.learning.data.captured import Simulation
from starling.learning.method import Predictor
from starling.patterns.errors import refuse
from starling.sim.captures import capture
from starling.sim.console import progress
from starling.sim.console.output import RECORD, refuse_own_input

PHYSICS = "physics"  # Folder of what was simulated, in the output.


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
    asked: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Train a method; what was cut short is gone on with when asked for again.

    Args:
        method: of `starling.learning.registry.NAMES`.
        captures: capture set with reference depth and the device's own.
        out: folder for what was learnt, checkpoint and loss curve.
        simulation: for methods that build on physics; others do without.
        rooms: to learn from; None takes all.
        steps: of a network; None leaves its own number.
        start: trained model of the same method that training goes on from.
        seed: of everything drawn.
        force: drop what starling left in the folder.
        asked: more arguments for the record.
        track: wraps loops that take long.

    Returns:
        `{"method", "scenes", "ndp_rate", "out", "seconds"}`.

    Raises:
        InputError: whatever is wrong with the captures, the method or the folder.
    """
    begun = time.perf_counter()
    begun_from = None if start is None else trained_folder(start, method)
    chosen = registry.method(method, steps=steps, start=begun_from)
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
        **(asked or {}),
    }
    work_folder.begin(out, arguments, force=force)
    learnt_from = captured.examples(
        opened,
        rooms=rooms,
        simulation=simulation,
        track=track,
    )
    chosen.fit(learnt_from, folder=out, seed=seed, track=track)
    figures = {
        "method": method,
        "scenes": [example.scene for example in learnt_from],
        "ndp_rate": captured.ndp_rate(learnt_from),
    }
    work_folder.end(out, "train", arguments, figures)
    return {**figures, "out": str(out), "seconds": round(time.perf_counter() - begun, 3)}


def trained(model: Path) -> tuple[str, Predictor]:
    """Read what `train_captures` left: the method's name and what it has learnt.

    Args:
        model: its folder, or the name of a model that comes with the program.

    Raises:
        InputError: if it is neither, or damaged.
    """
    name = trained_method(model)
    return name, registry.method(name).load(shipped.folder(model))


def trained_method(model: Path) -> str:
    """Name of the method that a model was trained by.

    Raises:
        InputError: if it is no trained model.
    """
    try:
        content = json.loads((shipped.folder(model) / RECORD).read_text(encoding="utf-8"))
        return content["arguments"]["method"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise refuse(
            "model",
            "must be a folder that `starling train` has finished",
            model,
            f"Train it, name the right one, or one of {', '.join(shipped.NAMES)}.",
        ) from error


def trained_folder(model: Path, method: str) -> Path:
    """Folder of a model that a method can start from.

    Raises:
        InputError: if it is no trained model, or of another method.
    """
    name = trained_method(model)
    if name != method:
        raise refuse("start", f"must be a trained {method}", f"{model}, {name}", "Name another.")
    return shipped.folder(model)
