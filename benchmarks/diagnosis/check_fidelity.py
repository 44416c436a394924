"""Whether the check's second camera does to images what the effects' pages say: a wrong law in it
would pass for a wrong diagnosis.

Each effect on images is put in by the check, at the middle of the strengths that are drawn and near
their end, and simulated by the table at some strengths beside that. Told is which of these is most
likely, what it leaves of the gap, and which features are then farthest off. Scenes have to be of
development alone; every feature has a vote.

Usage:
    python -m starling.diagnosis.validation.adapters.light_sets LIGHT clutter:7100 clutter:7101 clutter:7102 \
        --width 424 --height 240
    python benchmarks/diagnosis/check_fidelity.py LIGHT
"""

from __future__ import annotations

import argparse
import math
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from starling.diagnosis.scenes.scene_model import Subject, retaken, subject
from starling.diagnosis.validation.camera import nominal
from starling.diagnosis.validation.camera.catalogue import ROWS, Row
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import limits, shoot
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.which import null
from starling.diagnosis.which import table as bench
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.likelihood import Likelihood, total
from starling.diagnosis.which.null import Base
from starling.diagnosis.which.predicted import Made
from starling.diagnosis.which.table import Bench
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene
from starling.sim.sensor import presets

_SEED, _FRAMES = 5, 2
_NEAR_THE_END = 0.9  # Of the range.
_FACTORS = (0.8, 0.9, 1.0, 1.1, 1.25)  # Of a departure.
_WORST = 3  # Features that are told.


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("light", type=Path)
    light = parser.parse_args().light
    camera, sensor = nominal.read(light / nominal.FILE), presets.load(str(light / "sensor.toml"))
    with tempfile.TemporaryDirectory() as folder:
        subjects = [subject(one, sensor) for one in taken(light, {}, Path(folder) / "base")]
        table = bench.bench(subjects, Arm.IMAGE)
        base = null.base(table)
        for row, sign, departure in drawn(camera):
            value = row.value(camera, departure, sign)
            scenes = taken(light, {row.name: value}, Path(folder) / "case")
            case = table.of(again(subjects, scenes))
            print(
                told(case, base, row, [row.value(camera, departure * by, sign) for by in _FACTORS])
            )


def drawn(camera: Nominal) -> Iterator[tuple[Row, int, float]]:
    """Effects on images, to which side, and by how much."""
    known = limits.read()
    for row in ROWS.values():
        if row.kind != "image" or row.scale == "choice" or not row.acts(camera):
            continue
        for sign in row.signs:
            most, least = row.reach(camera, sign), known.least(row, sign)
            if least < most:
                yield row, sign, math.sqrt(least * most)
                yield row, sign, _NEAR_THE_END * most


def taken(light: Path, settings: dict[str, float], out: Path) -> Sequence[CapturedScene]:
    """Captures of the check's camera, read before the next are taken."""
    shutil.rmtree(out, ignore_errors=True)
    case = Case(number=0, kind="single" if settings else "null", settings=settings, seed=_SEED)
    shoot.shoot(light, case, out, _FRAMES)
    return capture.open_set(out).scenes


def again(subjects: Sequence[Subject], scenes: Sequence[CapturedScene]) -> list[Subject]:
    """The same scenes, captured with an effect."""
    return [retaken(one, scene, against=None) for one, scene in zip(subjects, scenes, strict=True)]


def told(case: Bench, base: Base, row: Row, values: Sequence[float]) -> str:
    """One effect in a line."""
    ones = np.ones(len(case.names))
    likelihood = base.likelihood(case.real(), ones)
    found = [(by, made) for by, value in zip(_FACTORS, values, strict=True)
             if (made := simulated(case, row.name, value)) is not None]  # fmt: skip
    cost = [float(likelihood.cost(made).sum()) for _, made in found]
    by, best = found[int(np.argmin(cost))]
    before = likelihood.size(likelihood.nothing)
    return (
        f"{row.name} {values[_FACTORS.index(1.0)]:.4g} {row.unit}: most likely {by:g} of it; "
        f"{before:.2f} before, {likelihood.size(best):.2f} left, "
        f"{total(likelihood.beyond(best), ones):.2f} beyond; {worst(case, likelihood, best)}"
    )


def simulated(case: Bench, name: str, value: float) -> Made | None:
    """What the table's effect makes; None where the sensor cannot have it."""
    change, scatter = case.change({name: value}), case.scatter({name: value})
    if change is None:
        return None
    return Made(change) if scatter is None else Made(change, scatter**2)


def worst(case: Bench, likelihood: Likelihood, made: Made) -> str:
    """Features that are farthest off in the mean of all scenes, in deviations."""
    off = np.nan_to_num(likelihood.beyond(made).mean(axis=0))
    return ", ".join(
        f"{case.names[number]} {off[number]:+.1f}" for number in np.argsort(-np.abs(off))[:_WORST]
    )


if __name__ == "__main__":
    main()
