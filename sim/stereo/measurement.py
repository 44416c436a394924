"""What a device makes of its infrared images: depth, with a reason where there is none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.reason import Reason, first_cause
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import DepthMap, depth_from_disparity

if TYPE_CHECKING:  # Loads compilers.
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
        ir_left: (h, w) uint8, or uint16 of as many bits as the left imager's matched ones.
        ir_right: likewise, rectified; None for structured light, which has a stored reference.
        sensor: its matcher, geometry and post-processing.
        causes: masks (h, w) of what else is known to keep a pixel from having depth. They name
            the reason where there is none; they remove nothing.
        past: `history` of the depth map before, which the temporal filter goes on from.
        memory: as `starling.sim.stereo.matching.match`.

    Raises:
        InputError: if the pair cannot be matched or `past` is of another size.
    """
    from starling.sim.stereo.post import chain  # Loads a compiler, like all that matches.

    found = _matched(ir_left, ir_right, sensor, memory)
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


def _matched(
    ir_left: NDArray, ir_right: NDArray | None, sensor: Sensor, memory: Memory | None
) -> DisparityMap:
    if sensor.kind == "structured_light":
        from starling.sim.stereo import structured_light

        return structured_light.matched(ir_left, sensor)
    if ir_right is None:
        raise errors.refuse(
            "ir_right", "must be given", "None", "Only structured light matches one image."
        )
    from starling.sim.stereo.matching import match, readable

    bits = sensor.left.matched_bits
    left, right = readable(ir_left, bits), readable(ir_right, bits)
    return match(left, right, sensor.matcher, memory=memory)
