"""Scenes of a plan, loaded and set up once for the views that follow each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from starling.sim.datasets import mesh_pile
from starling.sim.datasets.mesh_pile import Lying
from starling.sim.datasets.source import Heap, Setting
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene import sources
from starling.sim.sensor import presets


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Set:
    """A scene in Mitsuba, and where what was dropped into it lies."""

    stage: Stage
    lying: tuple[Lying, ...] = ()


@lru_cache(maxsize=2)  # The views of one scene may have two presets.
def of(setting: Setting, preset: str) -> Set:
    """A scene, as a preset would see it.

    Args:
        setting: what it is made of.
        preset: name, or sensor file.

    Raises:
        InputError: if a file is missing or damaged.
    """
    sensor = presets.load(preset)
    if isinstance(setting, Heap):
        scene, lying = mesh_pile.scene(setting, sensor)
        return Set(stage=Stage(scene), lying=lying)
    return Set(stage=Stage(sources.load(setting.text, sensor)))
