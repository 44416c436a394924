"""Items of public data sets as pairs of image and depth.

The camera's depth is that of the data set's depth camera (NYUv2), or the result of our matcher on
the stereo pair (IRS, Virtual KITTI 2). Cuaran et al. (Enhancing stereo depth maps through
RGBD-conditioned generative models, section 4.2) compute the depth of IRS and Virtual KITTI in the
same way. There is no projector: holes of passive stereo are mostly surfaces without texture, unlike
those of an active camera.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.data.pairs import Pair
from starling.learning.completion.data.readers.item import Colour, Item, ItemSource
from starling.learning.completion.method import Image, Mask
from starling.patterns.errors import refuse
from starling.sim.captures.png import GreyImage
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.reason import Reason
from starling.sim.sensor.matcher import D4XX
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import DepthMap
from starling.sim.stereo.measurement import measure


def stereo_depth(item: Item) -> DepthMap:
    """Match the stereo pair of an item.

    The least depth is focal length x baseline / the greatest disparity of the matcher `D4XX`.

    Args:
        item: item with a right image.

    Returns:
        Depth in the left image, with a reason for each hole.

    Raises:
        InputError: if there is no right image; see also `starling.sim.stereo.measurement.measure`.
    """
    if item.right is None:
        advice = "Use the camera's own depth, sensor_m."
        raise refuse("item", "must have a right image to be matched", "none", advice)
    camera = Sensor(
        name="stereo pair",
        baseline_m=item.baseline_m,
        matcher=D4XX,
        **dataclasses.asdict(Pinhole.from_camera(item.camera)),
    )
    return measure(_grey(item.rgb), _grey(item.right), camera, causes={})


def _grey(image: Colour) -> GreyImage:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


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
