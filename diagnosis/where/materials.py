"""Pixels of a scene by what they are made of."""

from __future__ import annotations

from starling.diagnosis.scenes.strata import Ground, Mask
from starling.sim.scene.scene import Scene


def materials(scene: Scene, ground: Ground) -> dict[str, Mask]:
    """Counted pixels (h, w) by the material's name; none of a scene that is all of one.

    Args:
        scene: whose bodies have materials.
        ground: of the scene.
    """
    found: dict[str, Mask] = {}
    for number, body in enumerate(scene.bodies, 1):
        where = ground.counted & (ground.body == number)
        name = body.material.name
        if where.any():
            found[name] = found[name] | where if name in found else where
    return found if len(found) > 1 else {}
