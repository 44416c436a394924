"""One frame as a method would have it: holes drawn, and the noise of those who simulate."""

from __future__ import annotations

from dataclasses import dataclass

from starling.learning import registry
from starling.learning.data.example import Example, Image, Mask
from starling.learning.sampling import sampling
from starling.sim.commands.simulate_captures import scene_seed


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DrawnFrame:
    """A scene with the holes that one method draws."""

    ndp: Mask  # (h, w)
    depth_m: Image  # (h, w) the reference with these holes, NaN there.


def draw(method: str, probability: Image, example: Example, *, seed: int) -> DrawnFrame:
    """Draw a method's holes in a scene.

    Args:
        method: its name. The frames of methods that build on physics have the simulator's errors
            where they have depth, and holes of its shapes.
        probability: (h, w) what the method tells.
        example: the scene, with physics where the method builds on it.
        seed: of the holes; each scene has its own.
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
