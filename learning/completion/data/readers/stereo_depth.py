"""Depth of a rendered stereo pair by our own matcher.

Cuaran et al. (Enhancing stereo depth maps through RGBD-conditioned generative models, section 4.2)
compute the camera's depth of IRS and Virtual KITTI in the same way. These have stereo pairs but no
depth camera. There is no projector: holes of passive stereo are mostly surfaces without
texture, unlike those of an active camera.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np

from starling.learning.completion.data.readers.item import Colour, Item
from starling.patterns.errors import refuse
from starling.sim.captures.png import GreyImage
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.sensor.matcher import D4XX, Matcher
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import DepthMap
from starling.sim.stereo.measurement import measure


def stereo_depth(item: Item, matcher: Matcher = D4XX) -> DepthMap:
    """Match the stereo pair of an item.

    Args:
        item: item with a right image.
        matcher: see `starling.sim.sensor.matcher`. The least depth is focal length x baseline / its
            greatest disparity.

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
        matcher=matcher,
        **dataclasses.asdict(Pinhole.from_camera(item.camera)),
    )
    return measure(_grey(item.rgb), _grey(item.right), camera, causes={})


def _grey(image: Colour) -> GreyImage:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
