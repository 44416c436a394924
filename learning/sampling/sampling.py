"""Sampling of no-depth pixels from their probability.

As C. Sweeney, G. Izatt and R. Tedrake, A Supervised Approach to Predicting Noise in Depth Images,
ICRA 2019, section III-C: pixels above a threshold have no depth in any frame; below it, correlated
noise decides. Noise does not have the shapes of a matcher's holes. If the scene is simulated, each
hole of one simulated frame is kept or removed as a whole instead. Only regions are added that
physics almost surely misses.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from starling.learning import registry
from starling.learning.data.example import Example, Image, Mask, Physics
from starling.learning.data.physics import missed_probability, physics_probability
from starling.learning.sampling import perlin
from starling.learning.sampling.perlin import Perlin
from starling.patterns import errors
from starling.sim.captures.info import CaptureInfo
from starling.sim.commands.simulate_captures import scene_seed

THRESHOLD = 0.5  # Value of the paper.


@dataclass(frozen=True, kw_only=True, slots=True)
class Sampling:
    """Settings of sampling.

    Args:
        noise: correlation of holes in the image and in time.
        threshold: Pixels above this probability always have no depth, 0 to 1. At 1 all pixels are
            sampled, and the expected share equals the probability everywhere. Below 1 the pixels
            above the threshold have more holes than their probability, and never flicker. With
            physics, it is the probability that physics misses a hole.

    Raises:
        InputError: if the threshold is outside 0 to 1.
    """

    noise: Perlin
    threshold: float = THRESHOLD

    def __post_init__(self) -> None:
        errors.in_interval("threshold", self.threshold, 0.0, 1.0)


# Pixels within a matching window of 9 px share their light.
TYPICAL = Sampling(noise=Perlin(correlation_px=9.0, correlation_frames=3.0))


def ndp(
    probability: Image,
    sampling: Sampling,
    *,
    seed: int,
    frame: float = 0.0,
    physics: Physics | None = None,
) -> Mask:
    """Sample the no-depth pixels (NDP) of one frame.

    Args:
        probability: (h, w), 0 to 1.
        sampling: settings.
        seed: seed of all frames of a sequence; other seeds give independent sequences.
        frame: time; holes of nearby frames are correlated (`Perlin`).
        physics: simulation of the scene. Where the probability equals that of physics, holes are
            those of its first draw. Where it is less, some of these are removed. Pixels are added
            where the probability of a missed hole is above the threshold.

    Returns:
        (h, w) True where there is no depth.

    Raises:
        InputError: if the probability is not an image in [0, 1], or of another size than the
            physics.
    """
    if probability.ndim != 2:
        raise errors.refuse(
            "probability", "must be an image (h, w)", probability.shape, "Give that of one scene."
        )
    if not bool(((probability >= 0) & (probability <= 1)).all()):
        low, high = float(np.min(probability)), float(np.max(probability))
        raise errors.refuse(
            "probability", "must be in [0, 1]", f"{low:g} to {high:g}", "NaN is outside."
        )
    height, width = probability.shape
    draw = perlin.uniform((height, width), sampling.noise, seed=seed, frame=frame)
    if physics is not None:
        return _amended(probability, draw, physics, sampling.threshold)
    return (probability > sampling.threshold) | (draw < probability)


def _amended(probability: Image, draw: Image, physics: Physics, threshold: float) -> Mask:
    """Keep or remove each hole of the first simulated draw, and add missed regions.

    A hole is kept with the ratio of the predicted to the simulated probability, summed over it. The
    noise at its first pixel decides, so that it stays or goes with its neighbours.
    """
    if draw.shape != physics.one_draw_ndp.shape:
        raise errors.refuse(
            "probability",
            "must have the size of the physics",
            draw.shape,
            "Give both of one scene.",
        )
    simulated = physics_probability(physics)
    count, labels = cv2.connectedComponents(physics.one_draw_ndp.astype(np.uint8), connectivity=8)
    label = np.asarray(labels, np.intp)
    flat = label.ravel()
    predicted, known = (np.bincount(flat, each.ravel(), count) for each in (probability, simulated))
    first = np.zeros(count, np.int64)
    first[flat[::-1]] = np.arange(flat.size)[::-1]  # The last assignment holds.
    kept = draw.ravel()[first] * known < predicted
    kept[0] = False  # Pixels with depth.
    return kept[label] | (missed_probability(probability, simulated) > threshold)


def depth_image(
    reference_m: Image, ndp: Mask, info: CaptureInfo, *, error_px: Image | None = None
) -> Image:
    """Return the depth image of a scene with holes, optionally with a simulator's errors.

    Args:
        reference_m: (h, w) z [m] without holes, NaN where unknown.
        ndp: (h, w) True where there is no depth.
        info: focal length and baseline.
        error_px: (h, w) simulated less true disparity [px]; NaN keeps the reference. None: no
            errors.

    Returns:
        (h, w) z [m], NaN where there is no depth.
    """
    depth = np.asarray(reference_m, np.float32)
    if error_px is not None:
        disparity = info.disparity_px(depth) + np.nan_to_num(error_px, nan=0.0)
        # The same function converts depth to disparity and disparity to depth.
        depth = np.where(np.isfinite(error_px), info.disparity_px(disparity), depth)
    return np.where(ndp, np.float32(np.nan), depth).astype(np.float32)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DrawnFrame:
    """A scene with the holes drawn by one method."""

    ndp: Mask  # (h, w)
    depth_m: Image  # (h, w) reference depth with these holes, NaN there.


def draw_frame(method: str, probability: Image, example: Example, *, seed: int) -> DrawnFrame:
    """Draw the holes of a method in a scene.

    Args:
        method: name of the method. For methods that use physics, the frame has the simulator's
            depth errors and the shapes of its holes.
        probability: (h, w) predicted by the method.
        example: the scene, with physics if the method uses it.
        seed: seed of the holes; they differ from scene to scene.
    """
    physics = example.physics if method in registry.ON_PHYSICS else None
    holes = ndp(probability, TYPICAL, seed=scene_seed(seed, example.scene), physics=physics)
    error_px = None if physics is None else example.simulated_error_px
    depth_m = depth_image(example.depth_m, holes, example.info, error_px=error_px)
    return DrawnFrame(ndp=holes, depth_m=depth_m)
