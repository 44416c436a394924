"""How often should physics be hidden from a hybrid that learns? Asked of rooms held out within.

A hybrid learns with physics hidden from a share of its crops (`learning/training/samples.py`). For
each room named, all other rooms are learnt from, and the log loss in that room is printed after
every so many steps. Name few rooms: those named are no longer fit to be judged.

    STARLING_CAPTURES=... python benchmarks/ndp_hidden.py OUT --sensor TEMPLATE --rooms 0742 e
"""

import argparse
import csv
import dataclasses
import itertools
import os
from pathlib import Path

import numpy as np

from learning import captured
from learning.captured import Simulation
from learning.methods.hybrid import Hybrid
from learning.training import loop
from learning.training import samples as drawing
from learning.training.samples import Sample
from learning.training.settings import Settings
from sim import asked_sensor, capture, progress

SHOWN = (100, 200, 300, 400, 500, 600)  # Steps.


def main() -> None:
    """Print the held-out room's loss by share and step."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--sensor", required=True, help="as `starling evaluate` takes it")
    parser.add_argument("--cache", type=Path, help="likewise")
    parser.add_argument("--rooms", nargs="+", required=True)
    parser.add_argument("--shares", type=float, nargs="*", default=[0.0, 0.5, 0.75, 0.9])
    asked = parser.parse_args()
    path = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    opened = capture.open_set(path)
    print(f"{'room':>6}{'hidden':>8}" + "".join(f"{step:>9}" for step in SHOWN))
    with progress.on_stderr() as tell:
        for room in asked.rooms:
            sensor = asked_sensor.load(asked.sensor.replace("{room}", room), captures=str(path))
            examples = captured.examples(
                opened, simulation=Simulation(sensor=sensor, cache=asked.cache)
            )
            for share in asked.shares:
                folder = asked.out / f"{room}-{share:g}"
                how = Hybrid(settings=dataclasses.replace(Settings(), hidden=share))
                how.fit(examples, folder=folder, seed=_holding_out(room, examples), tell=tell)
                with (folder / loop.CURVE).open() as file:
                    losses = {int(row["step"]) + 1: row["held_out"] for row in csv.DictReader(file)}
                cells = "".join(f"{float(losses[step]):9.4f}" for step in SHOWN)
                print(f"{room:>6}{share:8g}{cells}", flush=True)


def _holding_out(room, examples):
    """A seed that holds this room out."""
    none = np.empty(0)
    samples = [
        Sample(scene=one.scene, room=one.room, seen=none, odd=(), target=none, counted=none)
        for one in examples
    ]
    for seed in itertools.count():
        if drawing.split(samples, seed)[1][0].room == room:
            return seed


if __name__ == "__main__":
    main()
