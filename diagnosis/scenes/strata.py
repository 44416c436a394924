"""Pixel strata of a scene: bins by depth, position, edges, incidence, brightness and dots."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.sim.arrays import filled
from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.geometry.planes import NORMAL_RADIUS_PX, fit_planes, incidence_cosine
from starling.sim.metrics import EDGE_JUMP_PX
from starling.sim.sensor.sensor import Sensor

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Pixels = NDArray[np.intp]  # Indices into a flattened image.

FAR_OFF_PX = 2.0  # Larger errors are wrong matches; their size carries no information.
AT_EDGE_PX, NEAR_EDGE_PX = 4, 12  # Half a matching window, and beyond the largest one.
_INCIDENCE_DEG = (40.0, 65.0)  # Limits between facing, slanted and grazing.
COVARIATES = [
    "depth",
    "radius",
    "x",
    "y",
    "level",
    "incidence",
    "expected",
    "edge",
    "dots",
    "fraction",
]
_THIRDS = (1 / 3, 2 / 3)
_QUARTERS = ("1/4", "2/4", "3/4", "4/4")
_LEVEL_PX = 31  # Side of the window of the mean level.
_DOT_SIGMA_PX = 1.0  # Sigma of the filter that removes structure finer than a dot.
_DOT, _BETWEEN = 0.5, -0.25  # Local standard deviations from the mean: limits of on and off dots.


@dataclass(frozen=True, slots=True, eq=False)
class Covariate:
    """A quantity by which a scene's pixels are binned."""

    name: str
    bins: tuple[str, ...]
    label: NDArray[np.int8]  # (h, w) index of the bin; -1: in no bin.
    value: Image | None = None  # (h, w) binned quantity; None if it is not a single number.
    unit: str = ""

    def mask(self, name: str) -> Mask:
        """Return the pixels of one bin (h, w)."""
        return np.asarray(self.label == self.bins.index(name))


@dataclass(frozen=True, slots=True, eq=False)
class Strata:
    """A scene's reference disparity, expected image, and pixel bins in the left view.

    Bins use the reference and the expected image only, so that they are independent of measured
    errors. If reflectance is estimated from a capture's image, the expected image follows it,
    smoothed.
    """

    info: CaptureInfo
    disparity_px: Image  # (h, w) reference; NaN where unknown.
    expected: Image  # (h, w) noiseless simulated left image above the black level [DN].
    counted: Mask  # (h, w) pixels with reference that lie inside the right image.
    body: NDArray[np.uint32]  # (h, w) number of the object, from 1; 0 for background.
    projector: Image  # (h, w, 2) x / z and y / z of each point in the projector's frame.
    covariates: dict[str, Covariate]
    _cache: dict[tuple[str, ...], list[tuple[str, Pixels]]] = field(
        default_factory=dict, repr=False
    )

    def __getstate__(self) -> list[Any]:
        """Leave out the cache, which is twice as large as the rest."""
        return [{} if each.name == "_cache" else getattr(self, each.name) for each in fields(self)]

    @property
    def interior(self) -> Mask:
        """Counted pixels far from depth edges (h, w)."""
        return self.counted & (self.covariates["edge"].label == 0)

    def all_pixels(self, *, interior: bool = False) -> list[tuple[str, Pixels]]:
        """List one bin of all counted pixels, or of those far from depth edges."""
        key = ("whole", "far" if interior else "all")
        if key not in self._cache:
            mask = self.interior if interior else self.counted
            self._cache[key] = [("all", np.flatnonzero(mask))]
        return self._cache[key]

    def bins(self, *names: str, interior: bool = False) -> list[tuple[str, Pixels]]:
        """List the bins `covariate.bin` of some covariates with their pixels.

        Args:
            names: covariates.
            interior: exclude pixels near depth edges.
        """
        key = ("far" if interior else "all", *names)
        if key not in self._cache:
            within = self.interior if interior else self.counted
            self._cache[key] = [
                (f"{name}.{label}", np.flatnonzero(self.covariates[name].mask(label) & within))
                for name in names
                for label in self.covariates[name].bins
            ]
        return self._cache[key]

    def crossed_bins(self, first: str, second: str) -> list[tuple[str, Pixels]]:
        """List the intersections of the bins of two covariates."""
        key = ("crossed", first, second)
        if key not in self._cache:
            a, b = self.covariates[first], self.covariates[second]
            self._cache[key] = [
                (
                    f"{first}.{a_label}.{second}.{b_label}",
                    np.flatnonzero(a.mask(a_label) & b.mask(b_label)),
                )
                for a_label in a.bins
                for b_label in b.bins
            ]
        return self._cache[key]


def stratify(
    disparity_px: Image,
    expected: Image,
    info: CaptureInfo,
    *,
    body: NDArray[np.uint32],
    projector: Image,
) -> Strata:
    """Bin a scene's pixels by depth, position, edges, incidence, level and dots.

    Args:
        disparity_px: (h, w) reference, NaN where unknown.
        expected: (h, w) simulated left image above the black level [DN], as
            `starling.sim.imaging.noiseless` computes it.
        info: intrinsics.
        body: (h, w) number of the object at each pixel.
        projector: (h, w, 2) tangents of each point in the projector's frame.

    Raises:
        InputError: if the reference is unknown everywhere.
    """
    known = np.isfinite(disparity_px)
    full = filled(np.asarray(disparity_px, np.float32), known)
    height, width = known.shape
    y, x = np.indices(known.shape, np.float32)
    counted = known & (x - full >= 0)
    pinhole = Pinhole.from_camera(info)
    planes = fit_planes(full, known, NORMAL_RADIUS_PX)
    angle = np.degrees(np.arccos(np.clip(incidence_cosine(planes, pinhole), 0, 1)))
    radius = np.hypot(x - info.cx_px, y - info.cy_px) / pinhole.half_diagonal_px
    level = np.asarray(cv2.blur(expected, (_LEVEL_PX, _LEVEL_PX)), np.float32)
    within = partial(_bin, counted=counted)
    depths, levels = _quantiles(full, counted, 3), _quantiles(level, counted, 3)
    quarters, eighths = _quantiles(expected, counted, 4), tuple(np.arange(1, 8) / 8)
    covariates = [
        within("depth", ("far", "middle", "near"), full, depths, unit="px of disparity"),
        within("radius", ("centre", "ring", "corner"), radius, _THIRDS, unit="half diagonals"),
        within("x", ("left", "centre", "right"), x / width, _THIRDS, unit="widths"),
        within("y", ("top", "middle", "bottom"), y / height, _THIRDS, unit="heights"),
        within("level", ("dark", "medium", "bright"), level, levels, unit="DN"),
        within("incidence", ("facing", "slanted", "grazing"), angle, _INCIDENCE_DEG, unit="deg"),
        within("expected", _QUARTERS, expected, quarters, unit="DN"),
        _edges(full, counted),
        _dots(expected, counted),
        within("fraction", tuple(f"{k}/8" for k in range(8)), full % 1, eighths, unit="px"),
    ]
    return Strata(
        info=info,
        disparity_px=np.asarray(disparity_px, np.float32),
        expected=np.asarray(expected, np.float32),
        counted=counted,
        body=body,
        projector=projector,
        covariates={covariate.name: covariate for covariate in covariates},
    )


def _bin(
    name: str,
    bins: tuple[str, ...],
    value: NDArray,
    limits: tuple[float, ...],
    *,
    counted: Mask,
    unit: str,
) -> Covariate:
    """Bin counted pixels by a value at given limits."""
    label = np.searchsorted(np.asarray(limits, np.float64), value, side="right").astype(np.int8)
    inside = np.where(counted, label, np.int8(-1))
    return Covariate(name, bins, inside, value=np.asarray(value, np.float32), unit=unit)


def _quantiles(value: Image, counted: Mask, bins: int) -> tuple[float, ...]:
    """Compute limits of bins with equal numbers of counted pixels."""
    if not counted.any():
        return (0.0,) * (bins - 1)
    return tuple(np.quantile(value[counted], np.arange(1, bins) / bins).tolist())


def _edges(full_px: Image, counted: Mask) -> Covariate:
    """Bin by distance to depth edges, and by side of the edge."""
    step_x, step_y = np.zeros(full_px.shape, bool), np.zeros(full_px.shape, bool)
    step_x[:, 1:] = np.abs(np.diff(full_px, axis=1)) > EDGE_JUMP_PX
    step_y[1:] = np.abs(np.diff(full_px, axis=0)) > EDGE_JUMP_PX
    edge = step_x | step_y
    distance = np.full(full_px.shape, np.inf)
    if edge.any():
        distance = np.asarray(ndimage.distance_transform_edt(~edge), np.float64)
    side = 2 * AT_EDGE_PX + 1
    nearest = cv2.dilate(full_px, np.ones((side, side), np.uint8))
    to_right = cv2.dilate(full_px, np.ones((1, AT_EDGE_PX + 1), np.uint8), anchor=(0, 0))
    behind = nearest - full_px > EDGE_JUMP_PX
    hidden = behind & (to_right - full_px > EDGE_JUMP_PX)  # Occluded in the right view.
    label = np.select(
        [distance > NEAR_EDGE_PX, distance > AT_EDGE_PX, hidden, behind], [0, 1, 2, 3], default=4
    ).astype(np.int8)
    bins = ("open", "near an edge", "left of a nearer thing", "beside a nearer thing", "on its rim")
    inside = np.where(counted, label, np.int8(-1))
    farthest = np.float32(max(full_px.shape))
    distance = np.minimum(distance, farthest).astype(np.float32)
    return Covariate("edge", bins, inside, value=distance, unit="px")


def _dots(expected: Image, counted: Mask) -> Covariate:
    """Bin into projected dots and the space between them."""
    fine = cv2.GaussianBlur(expected, (0, 0), _DOT_SIGMA_PX)
    mean = cv2.blur(fine, (_LEVEL_PX, _LEVEL_PX))
    variance = cv2.blur((fine - mean) ** 2, (_LEVEL_PX, _LEVEL_PX))
    relative = (fine - mean) / np.sqrt(np.maximum(variance, 1e-12))
    label = np.select([relative > _DOT, relative < _BETWEEN], [0, 1], default=-1).astype(np.int8)
    return Covariate("dots", ("on dots", "between"), np.where(counted, label, np.int8(-1)))


def projector_tangents(
    depth_m: NDArray, sensor: Sensor, *, right: bool = False
) -> NDArray[np.float32]:
    """Compute x / z and y / z of each pixel's point in the projector's frame.

    Args:
        depth_m: (h, w) depth along the imager's optical axis.
        sensor: intrinsics of the imagers and pose of the projector.
        right: True if `depth_m` belongs to the right imager.

    Returns:
        (h, w, 2); NaN where depth is unknown.
    """
    y, x = np.indices(depth_m.shape, np.float64)
    ray = np.stack(
        [(x - sensor.cx_px) / sensor.fx_px, (y - sensor.cy_px) / sensor.fy_px, np.ones_like(x)],
        axis=-1,
    )
    point = ray * depth_m[..., None]
    if right:
        point = point + np.array([sensor.true_baseline_m, 0.0, 0.0])
    part = sensor.projector
    local = (point - np.array(part.position_m)) @ frames.rotation(part.rotation_deg)
    with np.errstate(invalid="ignore", divide="ignore"):
        return (local[..., :2] / local[..., 2:]).astype(np.float32)
