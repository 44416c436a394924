"""From disparity to depth with a reason for every missing pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from patterns import errors
from sim.reason import Reason, first_cause
from sim.sensor import Sensor

if TYPE_CHECKING:  # Loads compilers.
    from sim.matching.disparity import DisparityMap
    from sim.post.temporal import History


@dataclass(frozen=True, kw_only=True, slots=True)
class DepthMap:
    """Depth in the left imager's frame; each (h, w). Missing is NaN plus a reason."""

    disparity_px: NDArray[np.float32]  # x_left - x_right.
    depth_m: NDArray[np.float32]  # z along the optical axis.
    valid: NDArray[np.bool_]
    reason: NDArray[np.uint32]  # Codes of `sim.reason.Reason`; 0 exactly where valid.
    history: History | None = None  # For the temporal filter at the next frame; None without it.


def depth_from_disparity(
    disparity_px: NDArray[np.floating], *, focal_px: float, baseline_m: float
) -> NDArray[np.float32]:
    """Triangulate rectified disparity to depth along the optical axis: z = f b / d.

    Args:
        disparity_px: x_left - x_right [px], any shape, NaN where there is none.
        focal_px: focal length of the rectified pair [px], > 0.
        baseline_m: distance between the rectified centres [m], > 0.

    Returns:
        Depth [m], NaN where the input is NaN or <= 0 (at or beyond infinity).

    Raises:
        InputError: if focal_px or baseline_m is not finite and positive.

    Source: Szeliski, Computer Vision, 2nd ed., sec. 12.1.

    Example:
        >>> depth_from_disparity(np.array([[35.2]]), focal_px=640.0, baseline_m=0.055)
        array([[1.]], dtype=float32)
    """
    errors.positive("focal_px", focal_px)
    errors.positive("baseline_m", baseline_m)
    disparity = np.asarray(disparity_px, np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.asarray(np.float32(focal_px * baseline_m) / disparity)
    np.putmask(depth, ~(disparity > 0), np.nan)  # In place: fresh memory is what costs here.
    return depth


def disparity_from_depth(
    depth_m: NDArray[np.floating], *, focal_px: float, baseline_m: float
) -> NDArray[np.float32]:
    """Turn depth [m] into disparity [px]; the two are each other's inverse (see above)."""
    return depth_from_disparity(depth_m, focal_px=focal_px, baseline_m=baseline_m)


def to_code(depth_m: NDArray[np.floating], depth_unit_m: float) -> NDArray[np.uint16]:
    """Write depth as the 16-bit code users know: depth / depth_unit_m, 0 = no depth."""
    errors.positive("depth_unit_m", depth_unit_m)
    code = np.rint(np.nan_to_num(np.asarray(depth_m, np.float64), nan=0.0) / depth_unit_m)
    return np.where((code >= 0) & (code <= 65535), code, 0).astype(np.uint16)


def from_code(code: NDArray[np.uint16], depth_unit_m: float) -> NDArray[np.float32]:
    """Read the 16-bit code as depth [m], NaN where it is 0."""
    errors.positive("depth_unit_m", depth_unit_m)
    depth = code.astype(np.float32) * np.float32(depth_unit_m)
    return np.where(code > 0, depth, np.float32(np.nan))


def _matched(ir_left: NDArray, ir_right: NDArray | None, sensor: Sensor) -> DisparityMap:
    if sensor.kind == "structured_light":
        from sim import reference

        return reference.matched(ir_left, sensor)
    if ir_right is None:
        raise errors.refuse(
            "ir_right", "must be given", "None", "Only structured light matches one image."
        )
    from sim.matching import match, readable

    bits = sensor.left.bit_depth
    return match(readable(ir_left, bits), readable(ir_right, bits), sensor.matcher)


def measure(
    ir_left: NDArray,
    ir_right: NDArray | None,
    sensor: Sensor,
    *,
    causes: dict[Reason, NDArray[np.bool_]],
    past: History | None = None,
) -> DepthMap:
    """Match an infrared pair, triangulate and post-process.

    Args:
        ir_left: (h, w) uint8, or uint16 of as many bits as the sensor's left imager has.
        ir_right: likewise, rectified; None for structured light, which has a stored reference.
        sensor: its matcher, geometry and post-processing.
        causes: masks (h, w) of what else is known to keep a pixel from having depth. They name
            the reason where there is none; they remove nothing.
        past: `history` of the depth map before, which the temporal filter goes on from.

    Raises:
        InputError: if the pair cannot be matched or `past` is of another size.
    """
    from sim.post import chain  # Loads a compiler, like all that matches.

    found = _matched(ir_left, ir_right, sensor)
    own = {Reason(code): found.reason == code for code in np.unique(found.reason) if code}
    # What is known of the scene goes before what the matcher supposes of it.
    reason = first_cause(found.valid, own | causes)
    unexplained = reason == Reason.UNKNOWN
    reason[unexplained] = found.reason[unexplained]
    disparity = np.where(found.valid, found.disparity_px, np.float32(np.nan))
    raw = DepthMap(
        disparity_px=disparity,
        depth_m=depth_from_disparity(
            disparity, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m
        ),
        valid=found.valid,
        reason=reason,
    )
    return chain.process(raw, sensor, causes=causes, past=past)
