"""From infrared images to depth: matching, triangulation, post-processing, reasons."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.reason import Reason, first_cause
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import DepthMap, depth_from_disparity

if TYPE_CHECKING:  # The imports load numba.
    from starling.sim.stereo.disparity import DisparityMap
    from starling.sim.stereo.memory import Memory
    from starling.sim.stereo.post.temporal import History


def measure(
    ir_left: NDArray,
    ir_right: NDArray | None,
    sensor: Sensor,
    *,
    causes: dict[Reason, NDArray[np.bool_]],
    past: History | None = None,
    memory: Memory | None = None,
) -> DepthMap:
    """Match an infrared pair, triangulate and post-process.

    Args:
        ir_left: (h, w) uint8, or uint16 with the left imager's `matched_bits`.
        ir_right: right image of the rectified pair, of the same type. None for structured light,
            which has a stored reference.
        sensor: its matcher, geometry and post-processing.
        causes: masks (h, w) of known causes of missing depth. They set the reason of missing
            pixels; they remove no depth.
        past: `history` of the previous depth map, for the temporal filter.
        memory: see `starling.sim.stereo.matching.match`.

    Raises:
        InputError: if the pair cannot be matched or `past` has another size.
    """
    from starling.sim.stereo.post import chain  # The import loads numba.

    match = _matched(ir_left, ir_right, sensor, memory)
    codes = np.flatnonzero(np.bincount(match.reason.ravel(), minlength=len(Reason)))
    matcher_causes = {Reason(code): match.reason == code for code in codes if code}
    # Causes known from the scene take precedence over the matcher's reasons.
    reason = first_cause(match.valid, matcher_causes | causes)
    unexplained = reason == Reason.UNKNOWN
    reason[unexplained] = match.reason[unexplained]
    disparity = np.where(match.valid, match.disparity_px, np.float32(np.nan))
    raw = DepthMap(
        disparity_px=disparity,
        depth_m=depth_from_disparity(
            disparity, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m
        ),
        valid=match.valid,
        reason=reason,
    )
    return chain.process(raw, sensor, causes=causes, past=past)


def _matched(
    ir_left: NDArray, ir_right: NDArray | None, sensor: Sensor, memory: Memory | None
) -> DisparityMap:
    if sensor.kind == "structured_light":
        from starling.sim.stereo import structured_light

        return structured_light.match_reference(ir_left, sensor)
    if ir_right is None:
        raise errors.refuse(
            "ir_right", "must be given", "None", "Only structured light matches one image."
        )
    from starling.sim.stereo.matching import darkness, match, readable

    bits = sensor.left.matched_bits
    left, right = readable(ir_left, bits), readable(ir_right, bits)
    dark = darkness(left, sensor.left)
    return match(left, right, sensor.matcher, dark=dark, memory=memory)
