"""The virtual camera: simulates assumed scenes under its true conditions.

`camera.toml` is the true unit. `effects.toml` holds its true settings and their variation from
capture to capture. Both were chosen from the effect table's text by a person who did not know the
training sensors (README.md in this folder).
"""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping, Sequence
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning.data import simulated_captures
from starling.sim import randomness, simulate
from starling.sim.console import progress
from starling.sim.effects import setting
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.scene import Body, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot

_STAGE = "virtual camera"
_FACTOR = "body.reflectance_factor"  # Row: factor of the assumed reflectance.
_DYE = "body.reflectance"  # Row: independent reflectance of a dyed body.
_MATT = ("diffuse", "glossy")  # Kinds with a free reflectance; others follow Fresnel's equations.
_PLACES = ("wall", "table", "floor", "back")  # Bodies that are not dyed.
_DARKEST, _BRIGHTEST = 0.02, 0.9  # Range of true reflectances.


def camera() -> Sensor:
    """Return the true unit."""
    return presets.from_table(_read("camera.toml"))


def conditions(assumed: Scene, seed: int) -> tuple[Sensor, Scene]:
    """Draw the conditions of one capture.

    Args:
        assumed: the assumed scene; true reflectances differ body by body.
        seed: seed of the capture.

    Returns:
        The unit under these conditions, and the true scene.
    """
    table = _read("effects.toml")
    settings = _draw_settings(table, randomness.generator(seed, 0, _STAGE, "settings"))
    dyed = _draw_reflectances(assumed, table["vary"], randomness.generator(seed, 0, _STAGE, "dyes"))
    return setting.apply(camera(), dyed, settings)


def capture(assumed: Scene, seed: int, *, samples: int = 16) -> Shot:
    """Simulate the unit in a scene under the conditions of one capture.

    Args:
        assumed: the assumed scene, see `conditions`.
        seed: seed of the conditions and of the noise.
        samples: paths per coarse pixel of indirect light.
    """
    sensor, scene = conditions(assumed, seed)
    return simulate.simulate(MitsubaScene(scene), sensor, seed=seed, samples=samples)


def _read(name: str) -> dict[str, Any]:
    return tomllib.loads((resources.files("starling.learning.data.virtual") / name).read_text())


def _draw_settings(table: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Draw the settings of one capture; those of a group share one random number."""
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


def _draw_reflectances(scene: Scene, rows: list[dict[str, Any]], rng: np.random.Generator) -> Scene:
    """Draw a true reflectance for every matt body."""
    factor, dye = (next(row for row in rows if row["effect"] == name) for name in (_FACTOR, _DYE))

    def true(body: Body) -> Body:
        share, chance, dye_share = rng.random(3)
        material = body.material
        if material.kind not in _MATT:
            return body
        if chance < dye["probability"] and body.name not in _PLACES:
            reflectance = _between(dye, dye_share)
        else:
            changed = material.reflectance * _between(factor, share)
            reflectance = float(np.clip(changed, _DARKEST, _BRIGHTEST))
        material = dataclasses.replace(material, reflectance=reflectance)
        return dataclasses.replace(body, material=material)

    return dataclasses.replace(scene, bodies=tuple(true(body) for body in scene.bodies))


def write(
    out: Path,
    names: Sequence[str],
    *,
    seed: int = 0,
    samples: int = 16,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Simulate builtin scenes with the virtual camera, each a room, and write a capture set.

    `capture.toml` holds the geometry of the data sheet and `scene.toml` the assumed scenes. The
    unit's true geometry, reflectances and light are not written. Reference depth is the true one in
    the true camera's view.

    Args:
        out: output folder.
        names: builtin scenes, each once.
        seed: seed of the set; each capture's conditions follow from it and the scene's name.
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
        camera(),
        partial(capture, samples=samples),
        verb="virtual",
        seed=seed,
        arguments={"samples": samples},
        track=track,
    )
