"""Captures by cameras that are not what they are believed to be, each in another way.

What physics misses is different in every camera, but not of every kind: holes widen along edges,
dark surfaces go, a matcher trusts more or less. A residual that has learnt from many simulated
departures starts nearer to a real one (domain randomisation: Tobin et al., IROS 2017).

Departures follow one rule for all rows of the effect table: a few rows are drawn, and each is moved
from its base by up to half the way to an end of its range, on the range's own scale.
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
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Effect, Parameter, Stage, Value
from starling.sim.randomness import generator
from starling.sim.render.mitsuba_scene import Stage as SceneStage
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot

ROWS = {False: 6, True: 4}  # Rows moved: of light and imagers, of matcher and post-processing.
BLIND = 0.2  # Share of no-depth pixels above which a camera does not work.
ATTEMPTS = 20
_REACH = 0.5  # Share of the way to a range's end that is gone at most.
_WIDE = 4.0  # Ranges of a greater ratio are walked by factors.
_LATE = (Stage.MATCHER, Stage.POST)
# Families that move the camera or the model against the reference, need several frames, or change
# the image's size: no such thing is a no-depth pixel's doing.
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
    believed: Sensor,
    *,
    seed: int = 0,
    samples: int = 4,
    force: bool = False,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Let a camera of its own look at each builtin scene, and write a capture set.

    Args:
        out: folder to make.
        names: builtin scenes, each once.
        believed: what all cameras are taken for.
        seed: of the set.
        samples: paths a coarse pixel of indirect light.
        force: replace a set made before.
        track: wraps the loop over scenes.

    Returns:
        Share of no-depth pixels by scene.

    Raises:
        InputError: as `starling.learning.data.simulated_captures.write`.
    """
    return simulated_captures.write(
        out,
        names,
        believed,
        partial(_capture, sensor=believed, samples=samples),
        verb="varied",
        seed=seed,
        arguments={"samples": samples},
        force=force,
        track=track,
    )


def _capture(scene: Scene, seed: int, *, sensor: Sensor, samples: int) -> Shot:
    """Draw cameras until one works: nobody keeps one that is blind. In a scene that blinds all of
    `ATTEMPTS` the last is taken."""

    def taken(attempt: int) -> Shot:
        camera, seen = setting.apply(sensor, scene, departures(sensor, scene, seed + attempt))
        return simulate.simulate(SceneStage(seen), camera, seed=seed, samples=samples)

    for attempt in range(ATTEMPTS - 1):
        shot = taken(attempt)
        if 1 - shot.depth.valid.mean() <= BLIND:
            return shot
    return taken(ATTEMPTS - 1)


def departures(sensor: Sensor, scene: Scene, seed: int) -> dict[str, Value]:
    """Draw how one camera and its scene differ from what they are believed to be.

    Args:
        sensor: as it is believed to be.
        scene: likewise.
        seed: fixes the draw.

    Returns:
        Value by effect's name, as `starling.sim.effects.setting.apply` takes them.
    """
    rng = generator(seed, 0, "varied camera", "departures")
    found: dict[str, Value] = {}
    for late, count in ROWS.items():
        rows = [row for row in effects.table() if (row.stage in _LATE) == late and _fits(row)]
        moved = 0
        for number in rng.permutation(len(rows)):
            parameter = rows[number].parameters[0]
            base = setting.value(parameter, sensor, scene)
            value = None if base is None else _moved(parameter, base, rng)
            if value is None or not _admitted(sensor, scene, found | {rows[number].name: value}):
                continue
            found[rows[number].name] = value
            moved += 1
            if moved == count:
                break
    return found


def _fits(row: Effect) -> bool:
    return row.family not in _LEFT_OUT


def _admitted(sensor: Sensor, scene: Scene, settings: dict[str, Value]) -> bool:
    """Whether sensor and scene take these settings together."""
    try:
        setting.apply(sensor, scene, settings)
    except InputError:
        return False
    return True


def _moved(parameter: Parameter, base: Value, rng: np.random.Generator) -> Value | None:
    """Go some of the way from the base to an end of the range; None where there is no way."""
    if parameter.choices:
        others = [choice for choice in parameter.choices if choice != base]
        return others[rng.integers(len(others))] if others else None
    low, high, share = parameter.low, parameter.high, _REACH * rng.random()
    assert low is not None and high is not None and not isinstance(base, str)
    if base == 0 and low > 0:  # From nothing: the weakest worth trying is the way's beginning.
        return low * (high / low) ** share
    end = high if rng.random() < (0.5 if low < base < high else base <= low) else low
    if low > 0 and high / low > _WIDE and base > 0:
        return math.exp((1 - share) * math.log(base) + share * math.log(end))
    return (1 - share) * base + share * end
