"""Items of public data sets as pairs of image and depth, as captures have them.

The camera's depth is a depth camera's own where the data set has one (NYUv2), else what our matcher
makes of the stereo pair (IRS, Virtual KITTI 2).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.data.pairs import Pair
from starling.learning.completion.data.readers.item import Item, Source
from starling.learning.completion.data.readers.stereo_depth import stereo_depth
from starling.learning.completion.frame import Image, Mask
from starling.sim.reason import Reason


def reading(source: Source) -> Pair:
    """Read one image; its name is the pair's scene, of one frame, 0.

    Holes of a matched pair have the matcher's reasons; of a depth camera's, nobody knows.

    Raises:
        InputError: as the source's `load`, or as `stereo_depth`.
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
    """The camera's depth (h, w) [m], NaN = none, and why (h, w), codes of `starling.sim.reason`."""
    if item.sensor_m is None:
        matched = stereo_depth(item)
        return matched.depth_m, matched.reason
    reason = np.where(np.isfinite(item.sensor_m), Reason.VALID, Reason.UNKNOWN)
    return item.sensor_m, reason.astype(np.uint32)


def _causes(reason: NDArray[np.uint32]) -> Mapping[str, Mask]:
    return {Reason(code).name.lower(): reason == code for code in np.unique(reason) if code}
