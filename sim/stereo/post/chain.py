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

LARGEST_CODE = 65535  # Largest code of the 16-bit depth image; 0 means no depth.


def process(
    raw: DepthMap,
    sensor: Sensor,
    *,
    causes: Mapping[Reason, NDArray[np.bool_]],
    past: History | None = None,
) -> DepthMap:
    """Apply the post-processing filters to the matcher's depth.

    The order is: range of the 16-bit code, decimation, threshold, spatial filter, temporal filter,
    hole filling. All filters work on disparities, and z = f b / d holds after each. With decimation
    the later filters run on the smaller image. Its pixels are wider, and so are both deltas. The
    result has the left imager's size: all pixels of a block share its value.

    Args:
        raw: depth from the matcher, (h, w).
        sensor: its geometry and `post`; with all filters off the result is `raw` itself.
        causes: masks (h, w) of known causes of missing depth. They set the reason of pixels that
            a filter removes.
        past: `history` of the previous depth map, for the temporal filter.

    Raises:
        InputError: if `past` has another size.
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
    """Reasons after the filters: filled pixels are valid, removed ones get their first cause."""
    reason = np.where(valid, np.uint32(Reason.VALID), raw.reason)
    lost = raw.valid & ~valid
    if lost.any():
        h, w = valid.shape
        outside_blocks = np.ones_like(valid)  # Pixels outside complete blocks.
        outside_blocks[: h // side * side, : w // side * side] = False
        filter_causes = {Reason.POST_FILTER: outside_blocks, Reason.OUT_OF_RANGE: lost}
        reason[lost] = first_cause(~lost, dict(causes) | filter_causes)[lost]
    return reason
