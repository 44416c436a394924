"""Items of public data sets as pairs of image and depth.

The camera's depth is that of the data set's depth camera (NYUv2), or the result of our matcher on
the stereo pair (IRS, Virtual KITTI 2).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.data.pairs import Pair
from starling.learning.completion.data.readers.item import Item, ItemSource
from starling.learning.completion.data.readers.stereo_depth import stereo_depth
from starling.learning.completion.frame import Image, Mask
from starling.sim.reason import Reason


def read_source(source: ItemSource) -> Pair:
    """Read one image as a pair with frame number 0.

    Holes of a matched pair have the matcher's reasons; those of a depth camera are unknown.

    Raises:
        InputError: see the source's `load` and `stereo_depth`.
    """
    item = source.load()
    depth_m, reason = _measured(item)
    return Pair(
        scene=source.name,
        room=source.room,
        number=0,
        camera=item.camera,
        focal_baseline_px_m=item.camera.fx_px * item.baseline_m,
        image=item.rgb,
        depth_m=depth_m,
        truth_m=item.truth_m,
        causes=partial(_causes, reason),
    )


def _measured(item: Item) -> tuple[Image, NDArray[np.uint32]]:
    """Return depth (h, w) [m], NaN where missing, and the reason of each pixel (h, w)."""
    if item.sensor_m is None:
        matched = stereo_depth(item)
        return matched.depth_m, matched.reason
    reason = np.where(np.isfinite(item.sensor_m), Reason.VALID, Reason.UNKNOWN)
    return item.sensor_m, reason.astype(np.uint32)


def _causes(reason: NDArray[np.uint32]) -> Mapping[str, Mask]:
    return {Reason(code).name.lower(): reason == code for code in np.unique(reason) if code}
