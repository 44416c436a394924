"""Captured and simulated readings of one scene, shown as an example in the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from starling.diagnosis.scenes.observation import SceneObservation
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.scenes.strata import Strata
from starling.sim.effects.effect import Value

_SEED = 0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SceneImages:
    """Readings of one scene."""

    scene: str
    real: SceneObservation
    before: (
        SceneObservation  # Simulated with the base, or the capture that `real` is compared with.
    )
    after: SceneObservation | None  # Simulated with effects; None without any.
    strata: Strata


def scene_images(scene_model: SceneModel, settings: Mapping[str, Value]) -> SceneImages:
    """Simulate a scene before and after with common noise.

    Nothing is simulated if two captures are compared.

    Args:
        scene_model: the scene.
        settings: value by effect; if empty, `after` is None.
    """
    if scene_model.against is not None:
        before, after = scene_model.against, None
    else:
        before = scene_model.observe(scene_model.request({}, seed=_SEED))
        effects = scene_model.request(settings, seed=_SEED)
        after = scene_model.observe(effects) if settings else None
    return SceneImages(
        scene=scene_model.name,
        real=scene_model.real,
        before=before,
        after=after,
        strata=scene_model.strata,
    )
