"""Scale and shift that turn a prediction without a unit into metres.

Networks that see one image tell depth, or its inverse, up to a scale and a shift. Three ways to
find these:

- least squares against the truth, as such networks are commonly judged: no robot can do it;
- least squares against the camera's own depth where it has some: a robot can;
- by the numbers that the camera's own depth was normalised with before the network saw it
  ("sensor depth scale" in Cuaran et al., Enhancing stereo depth maps through RGBD-conditioned
  generative models, section 4.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.frame import Image, Mask
from starling.patterns.errors import InputError, one_of, positive, refuse

Target = Literal["none", "sensor", "truth"]
TARGETS: tuple[Target, ...] = ("none", "sensor", "truth")
_LEAST = 2  # Pixels that tell two numbers.
_TRIMMED_PCT = 2.0  # Marigold's: single wrong pixels do not stretch the span.
_NARROWEST = 0.01  # Of the depth: a wall seen head-on has a span too.


@dataclass(frozen=True, kw_only=True, slots=True)
class Alignment:
    """`scale * prediction + shift`."""

    scale: float
    shift: float

    def __call__(self, prediction: NDArray[np.floating]) -> Image:
        """Apply it, any shape."""
        return (self.scale * prediction + self.shift).astype(np.float32)


def least_squares(
    prediction: NDArray[np.floating], target: NDArray[np.floating], where: Mask
) -> Alignment:
    """Find scale and shift that bring a prediction nearest to a target, in closed form.

    Args:
        prediction: (h, w), any unit.
        target: (h, w): truth, or the camera's own depth [m], or the inverse of either [1/m].
        where: (h, w) pixels that count; those where either is not finite never do.

    Raises:
        InputError: if shapes differ, fewer than two pixels count, or the prediction is one number
            all over them, so that its scale could be any.
    """
    if not prediction.shape == target.shape == where.shape:
        got = f"{prediction.shape}, {target.shape} and {where.shape}"
        rule = "must share one shape"
        raise refuse("prediction, target and where", rule, got, "Resize the prediction.")
    counted = where & np.isfinite(prediction) & np.isfinite(target)
    x, y = prediction[counted].astype(np.float64), target[counted].astype(np.float64)
    if x.size < _LEAST:
        rule = f"must have {_LEAST} pixels in common, or more"
        raise refuse("prediction and target", rule, x.size, "Leave the image out.")
    x_mean, y_mean = x.mean(), y.mean()
    spread = ((x - x_mean) ** 2).sum()
    # Below that, the spread is what rounding in single precision leaves of a constant.
    if spread <= x.size * (np.finfo(np.float32).eps * np.abs(x).max()) ** 2:
        raise refuse("prediction", "must vary where it is aligned", x_mean, "Leave the image out.")
    scale = float(((x - x_mean) * (y - y_mean)).sum() / spread)
    return Alignment(scale=scale, shift=float(y_mean - scale * x_mean))


def aligned(prediction: NDArray[np.floating], depth_m: Image, where: Mask) -> Image:
    """Bring a prediction of depth to metres by least squares.

    Args:
        prediction: (h, w) that rises with depth.
        depth_m: (h, w) truth or the camera's own [m].
        where: (h, w) where that counts.

    Returns:
        (h, w) [m]; NaN where that is not above zero, which is no depth.

    Raises:
        InputError: as `least_squares`.
    """
    found = least_squares(prediction, depth_m, where)(prediction)
    return np.where(found > 0, found, np.float32(np.nan))


def judged_as(target: Target, depth_m: Image, *, sensor_m: Image, truth_m: Image) -> Image:
    """Bring depth to what it is judged against, or leave it as it is.

    Args:
        target: `truth`, as the paper's "least squares"; `sensor`, as a robot can; `none`.
        depth_m: (h, w) what a method says [m], NaN where it has none.
        sensor_m: (h, w) the camera's own [m], NaN = none.
        truth_m: (h, w) [m], NaN where unknown.

    Returns:
        (h, w) [m]. What cannot be aligned, as it is one number all over or shares no two pixels
        with the target, is NaN everywhere: missing.

    Raises:
        InputError: if the target is unknown.
    """
    one_of("align", target, TARGETS)
    if target == "none":
        return depth_m
    goal = truth_m if target == "truth" else sensor_m
    try:
        return aligned(depth_m, goal, np.isfinite(goal))
    except InputError:
        return np.full_like(depth_m, np.nan)


def aligned_inverse(
    prediction: NDArray[np.floating], depth_m: Image, where: Mask, *, farthest_m: float
) -> Image:
    """Bring a prediction of inverse depth to metres by least squares in inverse depth.

    As in Ranftl et al., Towards robust monocular depth estimation, TPAMI 2022, section 5.

    Args:
        prediction: (h, w) that falls with depth.
        depth_m: (h, w) truth or the camera's own [m], above zero where it counts.
        where: (h, w) where that counts.
        farthest_m: what is farther, or behind the camera, is put there.

    Raises:
        InputError: as `least_squares`, or if `farthest_m` is not above zero.
    """
    positive("farthest_m", farthest_m)
    inverse = np.full(depth_m.shape, np.nan)
    np.divide(1.0, depth_m, out=inverse, where=where & (depth_m > 0))
    found = least_squares(prediction, inverse, where)(prediction)
    return (1 / np.maximum(found, np.float32(1 / farthest_m))).astype(np.float32)


@dataclass(frozen=True, kw_only=True, slots=True)
class Normalisation:
    """Depth from `low_m` to `high_m` as -1 to 1; what is outside goes on beyond.

    As Ke et al., Repurposing diffusion-based image generators for monocular depth estimation,
    CVPR 2024, section 3.2, with the 2nd and 98th percentile.
    """

    low_m: float
    high_m: float

    def __post_init__(self) -> None:
        if not self.high_m > self.low_m:
            got = f"{self.low_m:g} to {self.high_m:g} m"
            raise refuse("depth", "must vary to be normalised", got, "Leave the image out.")

    def __call__(self, depth_m: NDArray[np.floating]) -> Image:
        """Normalise depth [m], any shape."""
        return (2 * (depth_m - self.low_m) / (self.high_m - self.low_m) - 1).astype(np.float32)

    def denormalise(self, prediction: NDArray[np.floating]) -> Image:
        """Turn -1 to 1, any shape, into depth [m]."""
        return (self.low_m + (prediction + 1) / 2 * (self.high_m - self.low_m)).astype(np.float32)


def normalisation(depth_m: Image, valid: Mask) -> Normalisation:
    """Find the numbers that normalise a camera's depth, which then turn a prediction into metres.

    Of its 2nd and 98th percentile; further apart, where need be, by 1 % of the nearer.

    Args:
        depth_m: (h, w) the camera's own [m].
        valid: (h, w) where it has some.

    Raises:
        InputError: if no pixel is valid.
    """
    known = depth_m[valid]
    if not known.size:
        raise refuse("depth", "must be valid somewhere", "no pixel", "Leave the image out.")
    trimmed = (_TRIMMED_PCT, 100 - _TRIMMED_PCT)
    low, high = np.percentile(known.astype(np.float64), trimmed).tolist()
    return Normalisation(low_m=low, high_m=max(high, low * (1 + _NARROWEST)))
