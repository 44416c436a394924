"""Compare the second camera of the validation to the simulator, effect by effect.

A wrong law in the second camera would look like a wrong diagnosis. The second camera applies each
image effect at a medium and at a large strength. The simulator applies the same effect at several
strengths. The script prints the most likely strength, the remaining gap, and the features with the
largest residuals. Use development scenes only; all features have equal weight.

Usage:
    python -m starling.diagnosis.validation.adapters light_sets LIGHT \
        clutter:7100 clutter:7101 clutter:7102 --width 424 --height 240
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

from starling.diagnosis.scenes.request import CAPTURED
from starling.diagnosis.scenes.scene_model import SceneModel, load_scene_model, with_capture
from starling.diagnosis.validation.camera import nominal
from starling.diagnosis.validation.camera.catalogue import ROWS, EffectRow
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import limits, shoot
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.which import null
from starling.diagnosis.which import table as bench
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.likelihood import Likelihood, total_size
from starling.diagnosis.which.null import BaseSamples
from starling.diagnosis.which.response import PredictedChange
from starling.diagnosis.which.table import FeatureTable
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene
from starling.sim.sensor import presets

_SEED, _FRAMES = 5, 2
_NEAR_THE_END = 0.9  # Large strength as a fraction of the range.
_FACTORS = (0.8, 0.9, 1.0, 1.1, 1.25)  # Simulated departures over the true departure.
_WORST = 3  # Number of features to print.


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("light", type=Path)
    light = parser.parse_args().light
    camera, sensor = nominal.read(light / nominal.FILE), presets.load(str(light / "sensor.toml"))
    with tempfile.TemporaryDirectory() as folder:
        scene_models = [
            load_scene_model(scene, sensor)
            for scene in capture_scenes(light, {}, Path(folder) / "base")
        ]
        table = bench.build_feature_table(scene_models, Segment.IMAGE)
        base = null.simulate_base(table)
        for row, sign, departure in strengths(camera):
            value = row.value(camera, departure, sign)
            scenes = capture_scenes(light, {row.name: value}, Path(folder) / "case")
            case = table.with_captures(recaptured(scene_models, scenes))
            values = [row.value(camera, departure * factor, sign) for factor in _FACTORS]
            print(compare(case, base, row, values))


def strengths(camera: Nominal) -> Iterator[tuple[EffectRow, int, float]]:
    """Yield image effects with the sign and the departure of each strength."""
    detection_limits = limits.read()
    for row in ROWS.values():
        if row.kind != "image" or row.scale == "choice" or not row.applies_to(camera):
            continue
        for sign in row.signs:
            most, least = row.reach(camera, sign), detection_limits.least(row, sign)
            if least < most:
                yield row, sign, math.sqrt(least * most)
                yield row, sign, _NEAR_THE_END * most


def capture_scenes(light: Path, settings: dict[str, float], out: Path) -> Sequence[CapturedScene]:
    """Capture all scenes with the second camera. Each call overwrites the captures in `out`."""
    shutil.rmtree(out, ignore_errors=True)
    case = Case(number=0, kind="single" if settings else "null", settings=settings, seed=_SEED)
    shoot.shoot(light, case, out, _FRAMES)
    return capture.open_set(out).scenes


def recaptured(
    scene_models: Sequence[SceneModel], scenes: Sequence[CapturedScene]
) -> list[SceneModel]:
    """Return the scene models with the captures of an effect."""
    return [
        with_capture(model, scene, against=None)
        for model, scene in zip(scene_models, scenes, strict=True)
    ]


def compare(case: FeatureTable, base: BaseSamples, row: EffectRow, values: Sequence[float]) -> str:
    """Format the comparison of one effect as a line."""
    ones = np.ones(len(case.names))
    likelihood = base.likelihood(case.rows(CAPTURED), ones)
    predictions = [
        (factor, change)
        for factor, value in zip(_FACTORS, values, strict=True)
        if (change := simulate(case, row.name, value)) is not None
    ]
    cost = [float(likelihood.cost(change).sum()) for _, change in predictions]
    factor, best = predictions[int(np.argmin(cost))]
    before, after = likelihood.size(likelihood.no_change), likelihood.size(best)
    unexplained = total_size(likelihood.unexplained(best), ones)
    return (
        f"{row.name} {values[_FACTORS.index(1.0)]:.4g} {row.unit}: most likely factor {factor:g}; "
        f"gap {before:.2f} before, {after:.2f} after, {unexplained:.2f} unexplained; "
        f"{worst(case, likelihood, best)}"
    )


def simulate(case: FeatureTable, name: str, value: float) -> PredictedChange | None:
    """Return the simulated change, or None if the sensor cannot have the effect."""
    change, scatter = case.change({name: value}), case.scatter({name: value})
    if change is None:
        return None
    return PredictedChange(change) if scatter is None else PredictedChange(change, scatter**2)


def worst(case: FeatureTable, likelihood: Likelihood, change: PredictedChange) -> str:
    """List the features with the largest mean residual over scenes, in standard deviations."""
    residual = np.nan_to_num(likelihood.unexplained(change).mean(axis=0))
    order = np.argsort(-np.abs(residual))[:_WORST]
    return ", ".join(f"{case.names[number]} {residual[number]:+.1f}" for number in order)


if __name__ == "__main__":
    main()
