"""Loading of a plan's scenes; consecutive views of one scene share the loaded scene."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from starling.sim.datasets import mesh_pile
from starling.sim.datasets.mesh_pile import RestingMesh
from starling.sim.datasets.source import Pile, Setting
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import sources
from starling.sim.sensor import presets


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LoadedScene:
    """A scene in Mitsuba, and the meshes that were dropped into it."""

    stage: MitsubaScene
    resting: tuple[RestingMesh, ...] = ()


@lru_cache(maxsize=2)  # The views of one scene can have two presets.
def load(setting: Setting, preset: str) -> LoadedScene:
    """Load a scene for a preset.

    Args:
        setting: scene specifier or pile of meshes.
        preset: preset name or sensor file.

    Raises:
        InputError: if a file is missing or damaged.
    """
    sensor = presets.load(preset)
    if isinstance(setting, Pile):
        scene, resting = mesh_pile.scene(setting, sensor)
        return LoadedScene(stage=MitsubaScene(scene), resting=resting)
    return LoadedScene(stage=MitsubaScene(sources.load(setting.text, sensor)))
