"""Classification of holes by their surroundings."""

from __future__ import annotations

import cv2
import numpy as np

from starling.learning.data.example import Example, Mask
from starling.learning.features.visibility import seen_from
from starling.sim.arrays import filled
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.geometry.planes import fit_planes, incidence_cosine
from starling.sim.metrics import depth_edges

# A pixel belongs to the first kind that applies, in this order.
KINDS: dict[str, str] = {
    "near": "disparity above the search range of a D400, 126 px",
    "occluded": "hidden from the right imager, according to the reference depth",
    "edge": "within 9 px of a depth edge",
    "grazing": "seen at more than 70 degrees off the normal",
    "dark": "smoothed infrared image below half its median",
    "far": "disparity below 16 px",
    "other": "none of these",
}
_MOST_PX = 126  # Greatest disparity of a D400 [px].
_LEAST_PX = 16  # Least disparity that is not far [px].
_EDGE_PX = 6  # Added to the 3 px that `depth_edges` marks on either side [px].
_GRAZING = float(np.cos(np.radians(70)))
_DARK = 0.5  # Relative to the median.
_PLANE_RADIUS_PX = 3  # Radius of the windows for normals [px].


def hole_kinds(example: Example) -> dict[str, Mask]:
    """Classify all pixels into `KINDS`, each (h, w); every pixel has exactly one kind.

    Without an infrared image, no pixel is dark.

    Args:
        example: example with some known reference depth.
    """
    disparity = example.info.disparity_px(example.depth_m)
    known = np.isfinite(disparity)
    disparity = filled(disparity, known)
    window = np.ones((2 * _EDGE_PX + 1,) * 2, np.uint8)
    edges = cv2.dilate(depth_edges(disparity).astype(np.uint8), window)
    planes = fit_planes(disparity, known, _PLANE_RADIUS_PX)
    light = example.reflectance
    fits = {
        "near": disparity > _MOST_PX,
        "occluded": seen_from(disparity, 1.0).hidden,
        "edge": edges.astype(bool),
        "grazing": incidence_cosine(planes, Pinhole.from_camera(example.info)) < _GRAZING,
        "dark": np.zeros(known.shape, bool) if light is None else light < _DARK * np.median(light),
        "far": disparity < _LEAST_PX,
        "other": np.ones(known.shape, bool),
    }
    unclassified = np.ones(known.shape, bool)
    kinds = {}
    for name, mask in fits.items():
        kinds[name] = mask & unclassified
        unclassified &= ~mask
    return kinds
