"""Holes sorted by their surroundings: where to look for those that a method misses."""

from __future__ import annotations

import cv2
import numpy as np

from starling.learning.data.example import Example, Mask
from starling.learning.features.visibility import seen_from
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.geometry.planes import fit_planes, incidence_cosine
from starling.sim.metrics import depth_edges
from starling.sim.stereo.filled import filled

# In the order in which they are given: a pixel is of the first kind that fits.
KINDS: dict[str, str] = {
    "near": "disparity above the 126 px that a D400 searches",
    "occluded": "hidden from the right imager, by the reference depth",
    "edge": "within 9 px of a depth edge",
    "grazing": "seen at more than 70 degrees off the normal",
    "dark": "smoothed infrared below half its median",
    "far": "disparity below 16 px",
    "other": "none of these",
}
_MOST_PX = 126
_LEAST_PX = 16
_EDGE_PX = 6  # Beyond the 3 px that `depth_edges` takes on either side.
_GRAZING = float(np.cos(np.radians(70)))
_DARK = 0.5
_PLANE_RADIUS_PX = 3


def hole_kinds(example: Example) -> dict[str, Mask]:
    """Sort all pixels into `KINDS`, each (h, w); every pixel is of one kind.

    Where no infrared is known, nothing is dark.

    Args:
        example: with a reference that is known somewhere.
    """
    disparity = example.info.disparity_px(example.depth_m)
    known = np.isfinite(disparity)
    disparity = filled(disparity, known)
    around = np.ones((2 * _EDGE_PX + 1,) * 2, np.uint8)
    edges = cv2.dilate(depth_edges(disparity).astype(np.uint8), around)
    planes = fit_planes(disparity, known, _PLANE_RADIUS_PX)
    light = example.reflectance
    fits = {
        "near": disparity > _MOST_PX,
        "occluded": seen_from(disparity, 1.0).hidden,
        "edge": edges.astype(bool),
        "grazing": incidence_cosine(planes, Pinhole.of(example.info)) < _GRAZING,
        "dark": np.zeros(known.shape, bool) if light is None else light < _DARK * np.median(light),
        "far": disparity < _LEAST_PX,
        "other": np.ones(known.shape, bool),
    }
    left = np.ones(known.shape, bool)
    kinds = {}
    for name, mask in fits.items():
        kinds[name] = mask & left
        left &= ~mask
    return kinds
