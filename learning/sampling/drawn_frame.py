"""Frames with the holes and the noise of a method."""

from __future__ import annotations

from dataclasses import dataclass

from starling.learning import registry
from starling.learning.data.example import Example, Image, Mask
from starling.learning.sampling import sampling
from starling.sim.commands.simulate_captures import scene_seed


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DrawnFrame:
    """A scene with the holes drawn by one method."""

    ndp: Mask  # (h, w)
    depth_m: Image  # (h, w) reference depth with these holes, NaN there.


def draw(method: str, probability: Image, example: Example, *, seed: int) -> DrawnFrame:
    """Draw the holes of a method in a scene.

    Args:
        method: name of the method. For methods that use physics, the frame has the simulator's
            depth errors and the shapes of its holes.
        probability: (h, w) predicted by the method.
        example: the scene, with physics if the method uses it.
        seed: seed of the holes; they differ from scene to scene.
    """
    physics = example.physics if method in registry.ON_PHYSICS else None
    ndp = sampling.ndp(
        probability,
        sampling.TYPICAL,
        seed=scene_seed(seed, example.scene),
        physics=physics,
    )
    depth_m = sampling.depth_image(
        example.depth_m,
        ndp,
        example.info,
        error_px=None if physics is None else example.simulated_error_px,
    )
    return DrawnFrame(ndp=ndp, depth_m=depth_m)
