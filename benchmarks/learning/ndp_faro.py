"""Shared code of the benchmarks on `d415-faro`: scenes, with physics by a sensor for each room."""

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

from starling.learning.commands.verbs import ROOM
from starling.learning.data import captured
from starling.learning.data.captured import Simulation
from starling.learning.data.example import Example
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene
from starling.sim.console import progress
from starling.sim.sensor import resolve


def parser(doc: str) -> argparse.ArgumentParser:
    """Build a parser with the flags of `simulation`; `doc` is the docstring of the benchmark."""
    built = argparse.ArgumentParser(description=doc.splitlines()[0])
    built.add_argument("--sensor", required=True, help="see `starling evaluate`")
    built.add_argument("--cache", type=Path, help="see `starling evaluate`")
    return built


def captures() -> Path:
    """Return the path of the captures."""
    return Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"


def simulation(options: argparse.Namespace, room: str, path: Path) -> Simulation:
    """Return the simulation of a room's scenes."""
    sensor = resolve.load(options.sensor.replace(ROOM, room), captures=str(path))
    return Simulation(sensor=sensor, cache=options.cache)


def scenes(
    options: argparse.Namespace, path: Path, track: progress.Progress
) -> Iterator[tuple[CapturedScene, Example]]:
    """Yield every scene and its example, simulated with its room's sensor."""
    for scene in track(capture.open_set(path).scenes, "scenes"):
        yield scene, captured.example(scene, simulation=simulation(options, scene.room, path))
