"""From a probability of no depth to the pixels without depth of a frame.

As C. Sweeney, G. Izatt and R. Tedrake, A Supervised Approach to Predicting Noise in Depth Images,
ICRA 2019, section III-C: pixels above a threshold have no depth in any frame; below it they are
drawn by correlated noise. Where the scene is simulated, a simulated frame's own holes are kept,
dropped and added to instead: their shapes are a matcher's, which no noise has.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from starling.learning.data.example import Image, Mask, Physics
from starling.learning.data.physics_probability import physics_probability
from starling.learning.sampling import perlin
from starling.learning.sampling.perlin import Perlin
from starling.patterns import errors
from starling.sim.captures.info import CaptureInfo

THRESHOLD = 0.5  # The paper's.


@dataclass(frozen=True, kw_only=True, slots=True)
class Sampling:
    """How no-depth pixels are drawn.

    Args:
        noise: how far holes reach in the image and in time.
        threshold: Pixels above this probability always have no depth, 0 to 1. At 1 everything is
            drawn and the expected share is the probability everywhere; below 1 the pixels above it
            have more holes than their probability says, and never flicker.

    Raises:
        InputError: if the threshold is outside.
    """

    noise: Perlin
    threshold: float = THRESHOLD

    def __post_init__(self) -> None:
        errors.in_interval("threshold", self.threshold, 0.0, 1.0)


# Pixels in one window of a matcher, 9 px, are matched by the same light.
TYPICAL = Sampling(noise=Perlin(correlation_px=9.0, correlation_frames=3.0))


def ndp(
    probability: Image,
    sampling: Sampling,
    *,
    seed: int,
    frame: float = 0.0,
    physics: Physics | None = None,
) -> Mask:
    """Draw the no-depth pixels (NDP) of one frame.

    Args:
        probability: (h, w), 0 to 1.
        sampling: how.
        seed: fixes all frames of a sequence; another seed is an independent sequence.
        frame: when; holes of near frames are alike (`flicker`).
        physics: of the scene. Where the probability is what physics tells, holes are those of its
            first draw; where it is less some of them go, where it is more others come.

    Returns:
        (h, w) True where there is no depth.

    Raises:
        InputError: if the probability is no image, not in [0, 1] throughout, or of another size
            than the physics.
    """
    if probability.ndim != 2:
        raise errors.refuse(
            "probability", "must be an image (h, w)", probability.shape, "Give one scene's."
        )
    if not bool(((probability >= 0) & (probability <= 1)).all()):
        low, high = float(np.min(probability)), float(np.max(probability))
        raise errors.refuse(
            "probability", "must be in [0, 1]", f"{low:g} to {high:g}", "NaN counts as outside."
        )
    height, width = probability.shape
    draw = perlin.uniform((height, width), sampling.noise, seed=seed, frame=frame)
    if physics is not None:
        draw = _as_drawn(draw, physics)
    return (probability > sampling.threshold) | (draw < probability)


def _as_drawn(draw: Image, physics: Physics) -> Image:
    """Uniform noise whose pixels below what physics tells are its first draw's holes.

    Uniform still, as the share of holes among draws is what physics tells.
    """
    if draw.shape != physics.one_draw_ndp.shape:
        raise errors.refuse(
            "probability", "must have the size of the physics", draw.shape, "Take one scene's."
        )
    told = physics_probability(physics)
    return np.where(physics.one_draw_ndp, told * draw, told + (1 - told) * draw)


def depth_image(
    reference_m: Image, ndp: Mask, info: CaptureInfo, *, error_px: Image | None = None
) -> Image:
    """Depth image of a scene with holes, and with a simulator's errors where it has depth.

    Args:
        reference_m: (h, w) z [m] without holes, NaN where unknown.
        ndp: (h, w) True where there is no depth.
        info: focal length and baseline.
        error_px: (h, w) simulated less true disparity [px]; where it is NaN the reference stands.
            None: no errors.

    Returns:
        (h, w) z [m], NaN where there is no depth.
    """
    depth = np.asarray(reference_m, np.float32)
    if error_px is not None:
        disparity = info.disparity_px(depth) + np.nan_to_num(error_px, nan=0.0)
        # Disparity and depth are each other's inverse: the same function turns it back.
        depth = np.where(np.isfinite(error_px), info.disparity_px(disparity), depth)
    return np.where(ndp, np.float32(np.nan), depth).astype(np.float32)


def flicker(probability: NDArray[np.floating], sampling: Sampling, frames: float) -> Image:
    """Probability that a pixel has changed between depth and no depth some frames later.

    In closed form for normal noise, which gradient noise nearly is: 2 (p - P(both below)), with
    the orthant probability of two normal values of correlation rho. Measured rates are
    within 12 % of it.

    Args:
        probability: any shape, 0 to 1.
        sampling: how frames are drawn.
        frames: how much later.
    """
    rho = sampling.noise.correlation_in_time(frames)
    p = np.clip(np.asarray(probability, np.float64), 1e-12, 1 - 1e-12)
    limit = special.ndtri(p)
    both = p if math.isclose(rho, 1.0) else _both_below(limit, rho)
    steady = (probability > sampling.threshold) | (probability <= 0) | (probability >= 1)
    return np.where(steady, 0.0, 2 * (p - both)).astype(np.float32)


def _both_below(limit: NDArray[np.float64], rho: float) -> NDArray[np.float64]:
    """Probability that two normal values of correlation rho are both below a limit.

    By Owen's T (Annals of Mathematical Statistics 27, 1956) for equal limits.
    """
    slope = math.sqrt((1 - rho) / (1 + rho))
    return stats.norm.cdf(limit) - 2 * special.owens_t(limit, slope)
