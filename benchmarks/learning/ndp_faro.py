"""What the benchmarks on `d415-faro` share: its scenes, with physics by a sensor for each room."""

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
    """Flags that `simulation` reads; `doc` is the benchmark's own text."""
    made = argparse.ArgumentParser(description=doc.splitlines()[0])
    made.add_argument("--sensor", required=True, help="as `starling evaluate` takes it")
    made.add_argument("--cache", type=Path, help="likewise")
    return made


def captures() -> Path:
    """Where the captures lie."""
    return Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"


def simulation(asked: argparse.Namespace, room: str, path: Path) -> Simulation:
    """How a room's scenes are simulated."""
    sensor = resolve.load(asked.sensor.replace(ROOM, room), captures=str(path))
    return Simulation(sensor=sensor, cache=asked.cache)


def scenes(
    asked: argparse.Namespace, path: Path, track: progress.Progress
) -> Iterator[tuple[CapturedScene, Example]]:
    """Every scene, and the example it makes with its room's sensor."""
    for scene in track(capture.open_set(path).scenes, "scenes"):
        yield scene, captured.example(scene, simulation=simulation(asked, scene.room, path))
