"""Pixels of a scene by material."""

from __future__ import annotations

from starling.diagnosis.scenes.strata import Mask, Strata
from starling.sim.scene.scene import Scene


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
