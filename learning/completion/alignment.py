"""Scale and shift that convert a prediction without unit to metres.

Networks that see one image predict depth, or inverse depth, up to a scale and a shift. There are
three ways to determine these:

- least squares against the ground truth, the usual evaluation, which a robot cannot do;
- least squares against the camera's own depth, which a robot can do;
- the numbers that normalise the camera's own depth for the network ("sensor depth scale" in
  Cuaran et al., Enhancing stereo depth maps through RGBD-conditioned generative models,
  section 4.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.method import Image, Mask
from starling.patterns.errors import InputError, one_of, positive, refuse

Target = Literal["none", "sensor", "truth"]
TARGETS: tuple[Target, ...] = ("none", "sensor", "truth")
_LEAST = 2  # Pixels needed to determine two numbers.
_TRIMMED_PCT = 2.0  # Marigold's value: single outliers do not stretch the range.
_NARROWEST = 0.01  # Least width of the range, relative to depth, for a wall seen head-on.


@dataclass(frozen=True, kw_only=True, slots=True)
class ScaleShift:
    """`scale * prediction + shift`."""

    scale: float
    shift: float

    def __call__(self, prediction: NDArray[np.floating]) -> Image:
        """Apply scale and shift to an array of any shape."""
        return (self.scale * prediction + self.shift).astype(np.float32)


def least_squares(
    prediction: NDArray[np.floating], target: NDArray[np.floating], where: Mask
) -> ScaleShift:
    """Fit scale and shift of a prediction to a target in closed form.

    Args:
        prediction: (h, w), any unit.
        target: (h, w) reference depth or the camera's own [m], or the inverse of either [1/m].
        where: (h, w) pixels to fit; pixels where either is not finite never count.

    Raises:
        InputError: if shapes differ, fewer than two pixels count, or the prediction is constant
            over them, so that its scale is undefined.
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
    # A smaller spread is rounding of a constant in single precision.
    if spread <= x.size * (np.finfo(np.float32).eps * np.abs(x).max()) ** 2:
        raise refuse("prediction", "must vary where it is aligned", x_mean, "Leave the image out.")
    scale = float(((x - x_mean) * (y - y_mean)).sum() / spread)
    return ScaleShift(scale=scale, shift=float(y_mean - scale * x_mean))


def align_depth(prediction: NDArray[np.floating], depth_m: Image, where: Mask) -> Image:
    """Align a prediction of depth to metres by least squares.

    Args:
        prediction: (h, w), increasing with depth.
        depth_m: (h, w) ground truth, or the camera's own depth [m].
        where: (h, w) pixels to fit.

    Returns:
        (h, w) [m]; NaN where the result is not above zero.

    Raises:
        InputError: see `least_squares`.
    """
    fitted = least_squares(prediction, depth_m, where)(prediction)
    return np.where(fitted > 0, fitted, np.float32(np.nan))


def align_to_target(target: Target, depth_m: Image, *, sensor_m: Image, truth_m: Image) -> Image:
    """Align depth to the evaluation's target, or return it unchanged.

    Args:
        target: `truth`, the paper's "least squares"; `sensor`, which a robot can do; or `none`.
        depth_m: (h, w) completed depth [m], NaN where missing.
        sensor_m: (h, w) the camera's own depth [m], NaN where missing.
        truth_m: (h, w) [m], NaN where unknown.

    Returns:
        (h, w) [m]. NaN everywhere if the depth cannot be aligned: it is constant, or shares fewer
        than two pixels with the target.

    Raises:
        InputError: if the target is unknown.
    """
    one_of("align", target, TARGETS)
    if target == "none":
        return depth_m
    goal = truth_m if target == "truth" else sensor_m
    try:
        return align_depth(depth_m, goal, np.isfinite(goal))
    except InputError:
        return np.full_like(depth_m, np.nan)


def align_inverse_depth(
    prediction: NDArray[np.floating], depth_m: Image, where: Mask, *, farthest_m: float
) -> Image:
    """Align a prediction of inverse depth to metres by least squares in inverse depth.

    As in Ranftl et al., Towards robust monocular depth estimation, TPAMI 2022, section 5.

    Args:
        prediction: (h, w), decreasing with depth.
        depth_m: (h, w) ground truth, or the camera's own depth [m], above zero where it counts.
        where: (h, w) pixels to fit.
        farthest_m: greatest depth of the result; replaces depth beyond it or behind the camera.

    Raises:
        InputError: see `least_squares`; or if `farthest_m` is not above zero.
    """
    positive("farthest_m", farthest_m)
    inverse = np.full(depth_m.shape, np.nan)
    np.divide(1.0, depth_m, out=inverse, where=where & (depth_m > 0))
    fitted = least_squares(prediction, inverse, where)(prediction)
    return (1 / np.maximum(fitted, np.float32(1 / farthest_m))).astype(np.float32)


@dataclass(frozen=True, kw_only=True, slots=True)
class Normalisation:
    """Maps depth from `low_m`..`high_m` linearly to -1..1; depth outside is extrapolated.

    As in Ke et al., Repurposing diffusion-based image generators for monocular depth estimation,
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
        """Convert -1..1, any shape, to depth [m]."""
        return (self.low_m + (prediction + 1) / 2 * (self.high_m - self.low_m)).astype(np.float32)


def normalisation(depth_m: Image, valid: Mask) -> Normalisation:
    """Estimate the normalisation of a camera's depth, which also converts a prediction to metres.

    The range is the 2nd to the 98th percentile, and at least 1 % of the nearer end wide.

    Args:
        depth_m: (h, w) the camera's own depth [m].
        valid: (h, w) True where it is known.

    Raises:
        InputError: if no pixel is valid.
    """
    known = depth_m[valid]
    if not known.size:
        raise refuse("depth", "must be valid somewhere", "no pixel", "Leave the image out.")
    trimmed = (_TRIMMED_PCT, 100 - _TRIMMED_PCT)
    low, high = np.percentile(known.astype(np.float64), trimmed).tolist()
    return Normalisation(low_m=low, high_m=max(high, low * (1 + _NARROWEST)))
