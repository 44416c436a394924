"""What is known of a scene before a camera is asked: where its pixels lie, and on what."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.geometry.planes import NORMAL_RADIUS_PX, fit_planes, incidence_cosine
from starling.sim.metrics import EDGE_JUMP_PX
from starling.sim.stereo.filled import filled

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Pixels = NDArray[np.intp]  # Places in a flattened image.

FAR_OFF_PX = 2.0  # Errors beyond are a wrong match's: how far they reach tells nothing.
AT_EDGE_PX, NEAR_EDGE_PX = 4, 12  # Half a matching window, and beyond all windows.
_DEGREES = (40.0, 65.0)  # Facing, slanted, grazing.
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
_LEVEL_PX = 31  # Window of the mean level.
_DOT_SIGMA_PX = 1.0  # Below which a dot is no structure of the scene.
_DOT, _BETWEEN = 0.5, -0.25  # Local deviations above and below the mean.


@dataclass(frozen=True, slots=True, eq=False)
class Covariate:
    """A way to part a scene's pixels into bins."""

    name: str
    bins: tuple[str, ...]
    label: NDArray[np.int8]  # (h, w) number of the bin; -1: in none.
    value: Image | None = None  # (h, w) what the bins part; None where it is no single number.
    unit: str = ""

    def where(self, name: str) -> Mask:
        """Pixels of one bin."""
        return np.asarray(self.label == self.bins.index(name))


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """A scene's reference and the image that the simulator expects of it, in the left view.

    Bins are made from these alone, never from what is measured: where a real camera has no depth,
    or is dark, is what is asked for. Where reflectance is estimated from a capture's own image the
    expected one follows that, smoothed.
    """

    info: CaptureInfo
    disparity_px: Image  # (h, w) of the reference; NaN where unknown.
    expected: Image  # (h, w) what the simulated left imager expects above its black level [DN].
    counted: Mask  # (h, w) known, and inside the right image.
    body: NDArray[np.uint32]  # (h, w) number of the object, from 1; 0 where there is none.
    projector: Image  # (h, w, 2) x / z and y / z of each point in the projector's frame.
    covariates: dict[str, Covariate]
    _kept: dict[tuple[str, ...], list[tuple[str, Pixels]]] = field(default_factory=dict, repr=False)

    @property
    def open(self) -> Mask:
        """Counted pixels far from depth edges (h, w)."""
        return self.counted & (self.covariates["edge"].label == 0)

    def whole(self, *, far: bool = False) -> list[tuple[str, Pixels]]:
        """All counted pixels; `far`: from edges alone."""
        key = ("whole", "far" if far else "all")
        if key not in self._kept:
            self._kept[key] = [("all", np.flatnonzero(self.open if far else self.counted))]
        return self._kept[key]

    def each(self, *names: str, far: bool = False) -> list[tuple[str, Pixels]]:
        """Bins of some covariates, `covariate.bin`, and their pixels; `far`: from edges alone."""
        key = ("far" if far else "all", *names)
        if key not in self._kept:
            within = self.open if far else self.counted
            self._kept[key] = [
                (f"{name}.{word}", np.flatnonzero(self.covariates[name].where(word) & within))
                for name in names
                for word in self.covariates[name].bins
            ]
        return self._kept[key]

    def crossed(self, one: str, other: str) -> list[tuple[str, Pixels]]:
        """Bins of two covariates at once."""
        key = ("crossed", one, other)
        if key not in self._kept:
            first, second = self.covariates[one], self.covariates[other]
            self._kept[key] = [
                (f"{one}.{a}.{other}.{b}", np.flatnonzero(first.where(a) & second.where(b)))
                for a in first.bins
                for b in second.bins
            ]
        return self._kept[key]


def ground(
    disparity_px: Image,
    expected: Image,
    info: CaptureInfo,
    *,
    body: NDArray[np.uint32],
    projector: Image,
) -> Ground:
    """Part a scene's pixels by depth, place, edges, incidence, level, and dots.

    Args:
        disparity_px: (h, w) of the reference, NaN where unknown.
        expected: (h, w) simulated left image above the black level [DN] (`starling.sim.imaging.noiseless`).
        info: intrinsics.
        body: (h, w) number of the object that each pixel sees.
        projector: (h, w, 2) tangents of each point in the projector's frame.

    Raises:
        InputError: if nothing is known of the reference.
    """
    known = np.isfinite(disparity_px)
    whole = filled(np.asarray(disparity_px, np.float32), known)
    height, width = known.shape
    y, x = np.indices(known.shape, np.float32)
    counted = known & (x - whole >= 0)
    pinhole = Pinhole.of(info)
    planes = fit_planes(whole, known, NORMAL_RADIUS_PX)
    angle = np.degrees(np.arccos(np.clip(incidence_cosine(planes, pinhole), 0, 1)))
    radius = np.hypot(x - info.cx_px, y - info.cy_px) / pinhole.half_diagonal_px
    level = np.asarray(cv2.blur(expected, (_LEVEL_PX, _LEVEL_PX)), np.float32)
    within = partial(_binned, counted=counted)
    depths, levels = _shares(whole, counted, 3), _shares(level, counted, 3)
    quarters, eighths = _shares(expected, counted, 4), tuple(np.arange(1, 8) / 8)
    covariates = [
        within("depth", ("far", "middle", "near"), whole, depths, unit="px of disparity"),
        within("radius", ("centre", "ring", "corner"), radius, _THIRDS, unit="half diagonals"),
        within("x", ("left", "centre", "right"), x / width, _THIRDS, unit="widths"),
        within("y", ("top", "middle", "bottom"), y / height, _THIRDS, unit="heights"),
        within("level", ("dark", "medium", "bright"), level, levels, unit="DN"),
        within("incidence", ("facing", "slanted", "grazing"), angle, _DEGREES, unit="deg"),
        within("expected", _QUARTERS, expected, quarters, unit="DN"),
        _edges(whole, counted),
        _dots(expected, counted),
        within("fraction", tuple(f"{k}/8" for k in range(8)), whole % 1, eighths, unit="px"),
    ]
    return Ground(
        info=info,
        disparity_px=np.asarray(disparity_px, np.float32),
        expected=np.asarray(expected, np.float32),
        counted=counted,
        body=body,
        projector=projector,
        covariates={one.name: one for one in covariates},
    )


def _binned(
    name: str,
    bins: tuple[str, ...],
    value: NDArray,
    limits: tuple[float, ...],
    *,
    counted: Mask,
    unit: str,
) -> Covariate:
    label = np.searchsorted(np.asarray(limits, np.float64), value, side="right").astype(np.int8)
    inside = np.where(counted, label, np.int8(-1))
    return Covariate(name, bins, inside, value=np.asarray(value, np.float32), unit=unit)


def _shares(value: Image, counted: Mask, parts: int) -> tuple[float, ...]:
    """Limits of equal shares of the counted pixels."""
    if not counted.any():
        return (0.0,) * (parts - 1)
    return tuple(np.quantile(value[counted], np.arange(1, parts) / parts).tolist())


def _edges(whole: Image, counted: Mask) -> Covariate:
    """By distance to a depth edge, and on which side of it."""
    step_x, step_y = np.zeros(whole.shape, bool), np.zeros(whole.shape, bool)
    step_x[:, 1:] = np.abs(np.diff(whole, axis=1)) > EDGE_JUMP_PX
    step_y[1:] = np.abs(np.diff(whole, axis=0)) > EDGE_JUMP_PX
    edge = step_x | step_y
    away = np.full(whole.shape, np.inf)
    if edge.any():
        away = np.asarray(ndimage.distance_transform_edt(~edge), np.float64)
    side = 2 * AT_EDGE_PX + 1
    nearest = cv2.dilate(whole, np.ones((side, side), np.uint8))
    to_right = cv2.dilate(whole, np.ones((1, AT_EDGE_PX + 1), np.uint8), anchor=(0, 0))
    behind = nearest - whole > EDGE_JUMP_PX
    hidden = behind & (to_right - whole > EDGE_JUMP_PX)  # A nearer thing hides it from the right.
    label = np.select(
        [away > NEAR_EDGE_PX, away > AT_EDGE_PX, hidden, behind], [0, 1, 2, 3], default=4
    ).astype(np.int8)
    bins = ("open", "near an edge", "left of a nearer thing", "beside a nearer thing", "on its rim")
    inside = np.where(counted, label, np.int8(-1))
    farthest = np.float32(max(whole.shape))
    away = np.minimum(away, farthest).astype(np.float32)
    return Covariate("edge", bins, inside, value=away, unit="px")


def _dots(expected: Image, counted: Mask) -> Covariate:
    """Dots of the projector and what lies between them."""
    fine = cv2.GaussianBlur(expected, (0, 0), _DOT_SIGMA_PX)
    mean = cv2.blur(fine, (_LEVEL_PX, _LEVEL_PX))
    variance = cv2.blur((fine - mean) ** 2, (_LEVEL_PX, _LEVEL_PX))
    relative = (fine - mean) / np.sqrt(np.maximum(variance, 1e-12))
    label = np.select([relative > _DOT, relative < _BETWEEN], [0, 1], default=-1).astype(np.int8)
    return Covariate("dots", ("on dots", "between"), np.where(counted, label, np.int8(-1)))
