"""The post-processing chain: librealsense's filters in the order its documentation gives."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from starling.sim.reason import Reason, first_cause
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import DepthMap, depth_from_disparity
from starling.sim.stereo.post import decimation, hole_filling, spatial, temporal, threshold
from starling.sim.stereo.post.temporal import History

LARGEST_CODE = 65535  # Of the 16-bit depth image; 0 means no depth.


def process(
    raw: DepthMap,
    sensor: Sensor,
    *,
    causes: Mapping[Reason, NDArray[np.bool_]],
    past: History | None = None,
) -> DepthMap:
    """Turn the matcher's depth into the depth that leaves the device.

    In this order: what the 16-bit code cannot hold is dropped, decimation, threshold, spatial
    filter, temporal filter, hole filling. All work on disparities, of which depth is the inverse:
    z = f b / d holds after each. With decimation the filters run on the small image, where
    disparities (and so both deltas) are in its own, wider pixels; at the end all pixels of a block
    share its value, as the map keeps the left imager's size.

    Args:
        raw: from the matcher, (h, w).
        sensor: its geometry and `post`; a sensor whose filters are off returns `raw` itself.
        causes: masks (h, w) of what else is known to keep a pixel from having depth; they name the
            reason where a filter took depth away.
        past: `history` of the depth map before, for the temporal filter.

    Raises:
        InputError: if `past` is of another size.
    """
    post, side = sensor.post, sensor.post.decimation
    geometry = {"focal_px": sensor.fx_px, "baseline_m": sensor.baseline_m}
    disparity = raw.disparity_px
    unit_m = post.depth_unit_m
    disparity = threshold.limit(disparity, **geometry, near_m=unit_m, far_m=LARGEST_CODE * unit_m)
    disparity = decimation.decimate(disparity, side)
    disparity = threshold.limit(disparity, **geometry, near_m=post.near_m, far_m=post.far_m)
    disparity = spatial.smooth(
        disparity,
        alpha=post.spatial_alpha,
        delta_px=post.spatial_delta_px * side,
        iterations=post.spatial_iterations,
    )
    disparity, history = temporal.smooth(
        disparity,
        past,
        alpha=post.temporal_alpha,
        delta_px=post.temporal_delta_px * side,
        persistence=post.temporal_persistence,
    )
    disparity = hole_filling.fill(disparity, post.hole_filling)
    disparity = decimation.enlarge(disparity, side, raw.disparity_px.shape)
    if disparity is raw.disparity_px and history is None:
        return raw
    valid = np.isfinite(disparity)
    return DepthMap(
        disparity_px=disparity,
        depth_m=depth_from_disparity(disparity, **geometry),
        valid=valid,
        reason=_reasons(raw, valid, side, causes),
        history=history,
    )


def _reasons(
    raw: DepthMap,
    valid: NDArray[np.bool_],
    side: int,
    causes: Mapping[Reason, NDArray[np.bool_]],
) -> NDArray[np.uint32]:
    """Reasons after the filters: what they filled has none, what they took gets its first cause."""
    reason = np.where(valid, np.uint32(Reason.VALID), raw.reason)
    lost = raw.valid & ~valid
    if lost.any():
        h, w = valid.shape
        left_over = np.ones_like(valid)  # Makes no whole block.
        left_over[: h // side * side, : w // side * side] = False
        own = {Reason.POST_FILTER: left_over, Reason.OUT_OF_RANGE: lost}
        reason[lost] = first_cause(~lost, dict(causes) | own)[lost]
    return reason
