"""The virtual camera under its scenes: what it sees of a scene that is believed to be another.

`camera.toml` is one unit as it really is, `effects.toml` the settings under which it looks at the
world and how they differ from capture to capture. Both were set from the effect table's text by
someone who had not seen the sensors that train on it (README.md beside them).
"""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping
from importlib import resources
from typing import Any

import numpy as np

from starling.sim import randomness, simulate
from starling.sim.effects import setting as setting
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene.scene import Body, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot

_STAGE = "virtual camera"
_FACTOR = "body.reflectance_factor"
_DYE = "body.reflectance"
_MATT = ("diffuse", "glossy")  # Kinds whose reflectance is a dye's; others are Fresnel's.
_PLACES = ("wall", "table", "floor", "back")  # Bodies that nobody dyes.
_DARKEST, _BRIGHTEST = 0.02, 0.9


def camera() -> Sensor:
    """The unit as it really is."""
    return presets.from_table(_read("camera.toml"))


def conditions(believed: Scene, seed: int) -> tuple[Sensor, Scene]:
    """Draw one capture's conditions.

    Args:
        believed: the scene as its model says; true reflectances differ body by body.
        seed: of the capture.

    Returns:
        The unit in this capture's state, and the scene as it truly is.
    """
    table = _read("effects.toml")
    settings = _drawn(table, randomness.generator(seed, 0, _STAGE, "settings"))
    dyed = _dyed(believed, table["vary"], randomness.generator(seed, 0, _STAGE, "dyes"))
    return setting.apply(camera(), dyed, settings)


def capture(believed: Scene, seed: int, *, samples: int = 16) -> Shot:
    """Let the unit look at a scene under one capture's conditions.

    Args:
        believed: as in `conditions`.
        seed: of the capture: its conditions and its noise.
        samples: paths a coarse pixel of indirect light.
    """
    sensor, scene = conditions(believed, seed)
    return simulate.simulate(Stage(scene), sensor, seed=seed, samples=samples)


def _read(name: str) -> dict[str, Any]:
    return tomllib.loads((resources.files("starling.learning.data.virtual") / name).read_text())


def _drawn(table: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Settings of one capture; those of a group share one random number."""
    settings = setting.parse(table["effect"])
    shared: dict[str, float] = {}
    for row in table["vary"]:
        if row.get("scope") == "body":
            continue
        share, chance = rng.random(2)
        if "group" in row:
            share = shared.setdefault(row["group"], share)
        if chance < row.get("probability", 1.0):
            settings |= setting.parse([f"{row['effect']}={_between(row, share):.6g}"])
    return settings


def _between(row: Mapping[str, Any], share: float) -> float:
    low, high = row["low"], row["high"]
    if row["law"] == "log_uniform":
        return float(low * (high / low) ** share)
    return float(low + share * (high - low))


def _dyed(scene: Scene, rows: list[dict[str, Any]], rng: np.random.Generator) -> Scene:
    """Give every matt body a reflectance that its model does not know."""
    factor, dye = (next(row for row in rows if row["effect"] == name) for name in (_FACTOR, _DYE))

    def true(body: Body) -> Body:
        share, chance, other = rng.random(3)
        material = body.material
        if material.kind not in _MATT:
            return body
        if chance < dye["probability"] and body.name not in _PLACES:
            reflectance = _between(dye, other)
        else:
            changed = material.reflectance * _between(factor, share)
            reflectance = float(np.clip(changed, _DARKEST, _BRIGHTEST))
        material = dataclasses.replace(material, reflectance=reflectance)
        return dataclasses.replace(body, material=material)

    return dataclasses.replace(scene, bodies=tuple(true(body) for body in scene.bodies))
