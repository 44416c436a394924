"""Captures of simulated cameras that differ from their assumed parameters, each in another way.

The errors of physics differ from camera to camera but are of few kinds. Holes widen along edges,
dark surfaces vanish, a matcher is more or less strict. A residual trained on many simulated
departures starts nearer to a real one (domain randomisation: Tobin et al., IROS 2017).

Departures follow one rule for all rows of the effect table. A few rows are drawn. Each is moved
from its base by up to half the distance to an end of its range, on the range's own scale.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning.data import simulated_captures
from starling.patterns.errors import InputError
from starling.sim import effects, simulate
from starling.sim.console import progress
from starling.sim.effects import setting
from starling.sim.effects.effect import Effect, Parameter, Stage, Value
from starling.sim.randomness import generator
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot

# Number of changed rows, by whether they are of matcher and post-processing.
ROWS = {False: 6, True: 4}
BLIND = 0.2  # Share of no-depth pixels above which a camera is rejected.
ATTEMPTS = 20  # Greatest number of cameras drawn for a scene.
_REACH = 0.5  # Greatest share of the distance to a range's end.
_WIDE = 4.0  # Ranges with a greater ratio of their ends use a logarithmic scale.
_LATE = (Stage.MATCHER, Stage.POST)
# Families that move the camera or the model relative to the reference, need several frames, or
# change the image's size. They do not cause no-depth pixels.
_LEFT_OUT = frozenset(
    {
        "motion",
        "rolling_shutter",
        "model_pose",
        "scale",
        "temporal_filter",
        "decimation",
        "registration",
        "depth_unit",
        "hole_filling",
        "search_range",
        "range",
    }
)


def write(
    out: Path,
    names: Sequence[str],
    assumed: Sensor,
    *,
    seed: int = 0,
    samples: int = 4,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Simulate each builtin scene with another camera, and write a capture set.

    Args:
        out: output folder.
        names: builtin scenes, each once.
        assumed: assumed sensor of all cameras.
        seed: seed of the set.
        samples: paths per coarse pixel of indirect light.
        track: wraps the loop over scenes.

    Returns:
        Share of no-depth pixels by scene.

    Raises:
        InputError: see `starling.learning.data.simulated_captures.write`.
    """
    return simulated_captures.write(
        out,
        names,
        assumed,
        partial(_capture, sensor=assumed, samples=samples),
        verb="varied",
        seed=seed,
        arguments={"samples": samples},
        track=track,
    )


def _capture(scene: Scene, seed: int, *, sensor: Sensor, samples: int) -> Shot:
    """Draw cameras until one has enough depth; after `ATTEMPTS` the last one is used."""

    def shoot(attempt: int) -> Shot:
        camera, seen = setting.apply(sensor, scene, departures(sensor, scene, seed + attempt))
        return simulate.simulate(MitsubaScene(seen), camera, seed=seed, samples=samples)

    for attempt in range(ATTEMPTS - 1):
        shot = shoot(attempt)
        if 1 - shot.depth.valid.mean() <= BLIND:
            return shot
    return shoot(ATTEMPTS - 1)


def departures(sensor: Sensor, scene: Scene, seed: int) -> dict[str, Value]:
    """Draw the differences of a camera and its scene from their assumed parameters.

    Args:
        sensor: assumed sensor.
        scene: assumed scene.
        seed: random seed.

    Returns:
        Value by name of effect, as `starling.sim.effects.setting.apply` takes them.
    """
    rng = generator(seed, 0, "varied camera", "departures")
    changes: dict[str, Value] = {}
    for late, count in ROWS.items():
        rows = [row for row in effects.table() if (row.stage in _LATE) == late and _fits(row)]
        moved = 0
        for number in rng.permutation(len(rows)):
            parameter = rows[number].parameters[0]
            base = setting.value(parameter, sensor, scene)
            value = None if base is None else _moved(parameter, base, rng)
            if value is None or not _admitted(sensor, scene, changes | {rows[number].name: value}):
                continue
            changes[rows[number].name] = value
            moved += 1
            if moved == count:
                break
    return changes


def _fits(row: Effect) -> bool:
    return row.family not in _LEFT_OUT


def _admitted(sensor: Sensor, scene: Scene, settings: dict[str, Value]) -> bool:
    """Return whether the settings are valid together."""
    try:
        setting.apply(sensor, scene, settings)
    except InputError:
        return False
    return True


def _moved(parameter: Parameter, base: Value, rng: np.random.Generator) -> Value | None:
    """Move the base towards an end of the range; None if there is no alternative."""
    if parameter.choices:
        alternatives = [choice for choice in parameter.choices if choice != base]
        return alternatives[rng.integers(len(alternatives))] if alternatives else None
    low, high, share = parameter.low, parameter.high, _REACH * rng.random()
    assert low is not None and high is not None and not isinstance(base, str)
    if base == 0 and low > 0:  # The base is off: start at the weakest value of the range.
        return low * (high / low) ** share
    end = high if rng.random() < (0.5 if low < base < high else base <= low) else low
    if low > 0 and high / low > _WIDE and base > 0:
        return math.exp((1 - share) * math.log(base) + share * math.log(end))
    return (1 - share) * base + share * end
