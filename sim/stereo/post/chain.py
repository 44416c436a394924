"""The post-processing chain: librealsense's filters in the order its documentation gives."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from starling.sim.reason import Reason, first_cause
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import LARGEST_CODE, DepthMap, depth_from_disparity
from starling.sim.stereo.post import (
    codes,
    decimation,
    disparity_transform,
    hole_filling,
    spatial,
    temporal,
    threshold,
)
from starling.sim.stereo.post.temporal import History


def process(
    raw: DepthMap,
    sensor: Sensor,
    *,
    causes: Mapping[Reason, NDArray[np.bool_]],
    past: History | None = None,
) -> DepthMap:
    """Apply the post-processing filters to the matcher's depth.

    The order is: range of the 16-bit code, decimation, threshold, spatial filter, temporal filter,
    hole filling. Filters act on 16-bit codes, as in librealsense, so filtered depth is in whole
    depth units. Without filters, depth stays unrounded. z = f b / d holds in either case.

    With decimation the later filters run on the smaller image, and deltas are in its pixels. The
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
    post = sensor.post
    geometry = {"focal_px": sensor.fx_px, "baseline_m": sensor.baseline_m}
    if post.filters:
        code, history = _filtered(codes.encode(raw.depth_m, post.depth_unit_m), sensor, past)
        disparity_px, depth_m = codes.decode(code, sensor)
    else:
        history, unit_m = None, post.depth_unit_m
        disparity_px = threshold.limit(
            raw.disparity_px, **geometry, near_m=unit_m, far_m=LARGEST_CODE * unit_m
        )
        disparity_px = threshold.limit(
            disparity_px, **geometry, near_m=post.near_m, far_m=post.far_m
        )
        if disparity_px is raw.disparity_px:
            return raw
        depth_m = depth_from_disparity(disparity_px, **geometry)
    valid = np.isfinite(disparity_px)
    return DepthMap(
        disparity_px=disparity_px,
        depth_m=depth_m,
        valid=valid,
        reason=_reasons(raw, valid, post.decimation, causes),
        history=history,
    )


def _filtered(
    code: NDArray[np.uint16], sensor: Sensor, past: History | None
) -> tuple[NDArray[np.uint16], History | None]:
    """Run the filters on depth codes (h, w)."""
    post, side, shape = sensor.post, sensor.post.decimation, code.shape
    code = decimation.decimate(code, side)
    code = threshold.limit_codes(
        code, unit_m=post.depth_unit_m, near_m=post.near_m, far_m=post.far_m
    )
    product = disparity_transform.product(sensor, side)
    disparity_px = spatial.smooth(
        disparity_transform.to_disparity(code, product),
        alpha=post.spatial_alpha,
        delta_px=post.spatial_delta_px,
        iterations=post.spatial_iterations,
        holes=post.spatial_holes,
    )
    disparity_px, history = temporal.smooth(
        disparity_px,
        past,
        alpha=post.temporal_alpha,
        delta_px=post.temporal_delta_px,
        persistence=post.temporal_persistence,
    )
    code = disparity_transform.to_code(disparity_px, product)
    code = hole_filling.fill(code, post.hole_filling)
    return decimation.enlarge(code, side, shape), history


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
