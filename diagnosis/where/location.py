"""Where the gap lies: pipeline segments, maps, objects, bins of covariates, and rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from starling.diagnosis.scenes.observation import SceneObservation
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.scenes.shelf import Derived, select, shelve
from starling.diagnosis.scenes.strata import Mask, Strata
from starling.diagnosis.where import covariates, maps, rules, swap
from starling.diagnosis.where.coherence.split import CoherenceSplit, coherence_split
from starling.diagnosis.where.covariates import BinGap
from starling.diagnosis.where.levels import level_ratios
from starling.diagnosis.where.maps import BodyGap, GapMap
from starling.diagnosis.where.rules import GapRule
from starling.diagnosis.where.swap import StageFigures
from starling.sim.scene.scene import Scene

WRONG_PX = 1.0  # Disparity error above which a pixel counts as wrong.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class GapLocation:
    """Answers to the question where the gap lies."""

    parts: dict[str, StageFigures]  # By figure.
    maps: tuple[GapMap, ...]
    bodies: tuple[BodyGap, ...]
    hole_bins: tuple[BinGap, ...]  # Gap in pixels without depth.
    error_bins: tuple[BinGap, ...]  # Gap in pixels wrong by more than `WRONG_PX`.
    rules: tuple[GapRule, ...]
    levels: dict[str, float]  # By room: median ratio of captured to base level, before any effect.
    coherence: CoherenceSplit  # Parts of image and disparity by what they move with.


def _without_depth(observations: Sequence[SceneObservation]) -> Sequence[Mask]:
    """Return the mask (h, w) of pixels without depth of each scene."""
    return Derived(len(observations), lambda scene: ~np.isfinite(observations[scene].depth_px[0]))


def _with_wrong_depth(
    observations: Sequence[SceneObservation], scene_strata: Sequence[Strata]
) -> Sequence[Mask]:
    """Return the mask (h, w) of pixels with wrong depth of each scene."""

    def mask(scene: int) -> Mask:
        error_px = observations[scene].depth_px[0] - scene_strata[scene].disparity_px
        return np.asarray(np.abs(error_px) > WRONG_PX)

    return Derived(len(observations), mask)


def locate_gap(scene_models: Sequence[SceneModel]) -> GapLocation:
    """Compare captures with the simulated base, or with other captures.

    Holes are those of the device's own depth. Without it, our matcher's on the real images count.

    Args:
        scene_models: at least one.
    """
    base = shelve(
        scene_model.against or scene_model.observe(scene_model.request({}, seed=0))
        for scene_model in scene_models
    )
    rooms = [scene_model.room for scene_model in scene_models]
    count = len(scene_models)
    real = Derived(count, lambda scene: scene_models[scene].real)
    scene_strata = Derived(count, lambda scene: scene_models[scene].strata)
    first, second = (_without_depth(observations) for observations in (base, real))
    wrong = [_with_wrong_depth(observations, scene_strata) for observations in (base, real)]
    masks = Derived(
        count, lambda scene: material_masks(scene_models[scene].scene, scene_strata[scene])
    )
    several = len(set(rooms)) > 1
    # An estimated scene is a single body, so it has no separate objects.
    separable = [
        number for number, scene_model in enumerate(scene_models) if not scene_model.estimates
    ]

    named_scenes = Derived(
        count, lambda scene: (scene_models[scene].name, scene_models[scene].scene)
    )
    scales = Derived(count, lambda scene: scene_models[scene].sensor.projector.pattern_scale)
    return GapLocation(
        parts=swap.stage_figures(base, real, scene_strata, rooms),
        maps=tuple(maps.gap_maps(base, real, scene_strata, rooms)) if several else (),
        bodies=tuple(
            maps.body_gaps(
                select(named_scenes, separable),
                select(base, separable),
                select(real, separable),
                select(scene_strata, separable),
            )
        ),
        hole_bins=tuple(covariates.bin_gaps(first, second, scene_strata, rooms, masks)),
        error_bins=tuple(covariates.bin_gaps(wrong[0], wrong[1], scene_strata, rooms, masks)),
        rules=tuple(rules.find_rules(first, second, scene_strata, rooms)),
        levels=level_ratios(scene_models, base),
        coherence=coherence_split(base, real, scene_strata, rooms, scales),
    )


def material_masks(scene: Scene, strata: Strata) -> dict[str, Mask]:
    """Return the counted pixels (h, w) by material; empty for a scene of one material.

    Args:
        scene: scene whose bodies have materials.
        strata: pixel strata of the scene.
    """
    masks: dict[str, Mask] = {}
    for number, body in enumerate(scene.bodies, 1):
        where = strata.counted & (strata.body == number)
        name = body.material.name
        if where.any():
            masks[name] = masks[name] | where if name in masks else where
    return masks if len(masks) > 1 else {}
