"""Holes: area, perimeter, run length and flicker, and their classification by surroundings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.learning.data.example import Example, Mask
from starling.learning.features.geometry import seen_from
from starling.patterns import errors
from starling.sim.arrays import filled
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.geometry.planes import fit_planes, incidence_cosine
from starling.sim.metrics import depth_edges

Sizes = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Holes:
    """Holes of one or more images. A hole is an 8-connected set of no-depth pixels."""

    share: float  # No-depth pixels over counted pixels.
    area_px: Sizes  # (n,) area of each hole.
    perimeter_px: Sizes  # (n,) number of outer pixel sides; a square of side n has 4 n.
    run_px: Sizes  # (m,) lengths of the runs of no-depth pixels along rows.

    @property
    def area_of_pixel_px(self) -> Sizes:
        """Area of the hole of each no-depth pixel, so that holes are weighted by area."""
        return np.repeat(self.area_px, self.area_px)


@dataclass(frozen=True, kw_only=True, slots=True)
class Distance:
    """Distances of two samples from one distribution; NaN where a sample is empty."""

    kolmogorov_smirnov: float  # Greatest difference of the cumulative distributions, 0 to 1.
    wasserstein_log: float  # Wasserstein distance of natural logarithms: 0.7 is a factor of two.


def measure(ndp: Mask, counted: Mask | None = None) -> Holes:
    """Measure the holes of one image.

    Args:
        ndp: (h, w) True where there is no depth.
        counted: (h, w) pixels that count; other pixels are not holes. None: all.

    Raises:
        InputError: if the masks differ in shape, or no pixel counts.
    """
    if counted is None:
        counted = np.ones_like(ndp)
    if ndp.ndim != 2 or ndp.shape != counted.shape:
        raise errors.refuse(
            "ndp and counted",
            "must be images of one shape",
            f"{ndp.shape} and {counted.shape}",
            "Give both of one view.",
        )
    if not counted.any():
        raise errors.refuse("counted", "must hold a pixel", 0, "Is there any reference depth?")
    hole = np.pad(ndp & counted, 1)
    number, label, box, _ = cv2.connectedComponentsWithStats(hole.astype(np.uint8), connectivity=8)
    sides = np.zeros(hole.shape, np.int64)
    for axis in (0, 1):
        for step in (-1, 1):
            sides += hole & ~np.roll(hole, step, axis)
    perimeter = np.bincount(label.ravel(), weights=sides.ravel(), minlength=number)
    change = np.diff(hole.astype(np.int8), axis=1)
    start, end = np.nonzero(change == 1)[1], np.nonzero(change == -1)[1]
    return Holes(
        share=np.count_nonzero(hole) / np.count_nonzero(counted),
        area_px=box[1:, cv2.CC_STAT_AREA].astype(np.int64),
        perimeter_px=np.rint(perimeter[1:]).astype(np.int64),
        run_px=(end - start).astype(np.int64),
    )


def pool(images: Sequence[Holes]) -> Holes:
    """Pool the holes of several images; each image has the same weight in the share.

    Raises:
        InputError: if there is no image.
    """
    if not images:
        raise errors.refuse("images", "must not be empty", 0, "Measure at least one.")
    return Holes(
        share=float(np.mean([image.share for image in images])),
        area_px=np.concatenate([image.area_px for image in images]),
        perimeter_px=np.concatenate([image.perimeter_px for image in images]),
        run_px=np.concatenate([image.run_px for image in images]),
    )


def flicker_rate(repeats: NDArray[np.bool_], counted: Mask | None = None) -> float:
    """Share of counted pixels that change from one frame to the next, mean over frames.

    Args:
        repeats: (n, h, w) True where there is no depth, frames of a static scene in order.
        counted: (h, w) pixels that count; None: all.

    Raises:
        InputError: if there are fewer than two frames, or no pixel counts.
    """
    if repeats.ndim != 3 or len(repeats) < 2:
        raise errors.refuse(
            "repeats", "must be two frames or more (n, h, w)", repeats.shape, "Take more frames."
        )
    if counted is not None and not counted.any():
        raise errors.refuse("counted", "must hold a pixel", 0, "Is there any reference depth?")
    change = repeats[1:] != repeats[:-1]
    return float(change.mean() if counted is None else change[:, counted].mean())


def distance(first: NDArray[np.integer], second: NDArray[np.integer]) -> Distance:
    """Distance of two samples of sizes >= 1, such as the areas of real and of sampled holes."""
    if not (first.size and second.size):
        return Distance(kolmogorov_smirnov=float("nan"), wasserstein_log=float("nan"))
    both = np.concatenate([first, second])
    first_share = np.searchsorted(np.sort(first), both, side="right") / first.size
    second_share = np.searchsorted(np.sort(second), both, side="right") / second.size
    return Distance(
        kolmogorov_smirnov=float(np.abs(first_share - second_share).max()),
        wasserstein_log=float(stats.wasserstein_distance(np.log(first), np.log(second))),
    )


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
