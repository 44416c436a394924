"""Infrared pairs of a scene in one view: the camera's left image, or the projector's field.

The right image is sampled where the left one sees the same surface point. In the projector's field
both are sampled along the directions of the projector, at the camera's angular pitch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.strata import Strata
from starling.diagnosis.where.coherence import registration
from starling.diagnosis.where.coherence.sampling import sample, sample_smooth, transfer
from starling.diagnosis.where.coherence.spectra import (
    COLUMN_FREQUENCY,
    ROW_FREQUENCY,
    WINDOW_PX,
    Plane,
    Spectra,
    by_frequency,
    cells_within,
    window_means,
    window_spectra,
)
from starling.sim.arrays import Image, Mask, filled

_LEAST_DN = 1.0  # Least level above black that images are divided by [DN].
_ROUNDS = 2  # Of the registration: the reference disparity changes along a shift.
_STEPS = 12  # Of the search for the pixel that sees a direction of the projector.
_NEAR_PX = 0.1  # Largest distance between a direction and what its pixel sees.

Pair = tuple[Image, Image]  # Left and right image, each in its own view.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SampledView:
    """Pixels of both imagers for each place of a view, and the places that are known."""

    left_x: Image  # (h, w) [px].
    left_y: Image
    right_x: Image
    right_y: Image
    known: Mask


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PairSpectra:
    """Spectra of the windows of a pair, corrected for the loss of interpolation."""

    left: Spectra
    right: Spectra
    # (rows, columns) factor on each own power spectrum: interpolation keeps more of the power than
    # of a cross spectrum.
    left_power: Plane
    right_power: Plane

    def less(self, base: PairSpectra, gain: NDArray[np.float64]) -> PairSpectra:
        """Subtract another pair, multiplied by a gain of each imager and band (2, bands)."""
        left, right = (by_frequency(each).astype(np.float32) for each in gain)
        return replace(
            self, left=self.left - left * base.left, right=self.right - right * base.right
        )


_EMPTY = np.empty((0, ROW_FREQUENCY.size, COLUMN_FREQUENCY.size), np.complex64)
_NEUTRAL = np.ones(_EMPTY.shape[1:])
NO_WINDOWS = PairSpectra(left=_EMPTY, right=_EMPTY, left_power=_NEUTRAL, right_power=_NEUTRAL)


def surface_pixels(strata: Strata) -> Mask:
    """Return the pixels far from depth edges that both imagers see (h, w).

    A point is hidden from the right imager if a point to its right lies further left there.
    """
    disparity_px = filled(strata.disparity_px, np.isfinite(strata.disparity_px))
    column = np.arange(disparity_px.shape[1], dtype=np.float32) - disparity_px
    right_of = np.minimum.accumulate(column[:, ::-1], axis=1)[:, ::-1]
    visible = np.ones(column.shape, bool)
    visible[:, :-1] = column[:, :-1] < right_of[:, 1:]
    return strata.interior & visible


def pixel_grid(shape: tuple[int, ...]) -> tuple[Image, Image]:
    """Return the column and the row of each pixel of an image."""
    rows, columns = np.indices(shape[:2], np.float32)
    return np.asarray(columns, np.float32), np.asarray(rows, np.float32)


def root_level(strata: Strata) -> Image:
    """Return the root of the expected local level (h, w); shot noise is proportional to it."""
    known = strata.counted.astype(np.float32)
    side = (WINDOW_PX, WINDOW_PX)
    level = cv2.blur(strata.expected * known, side) / np.maximum(cv2.blur(known, side), 1e-3)
    return np.sqrt(np.maximum(level, _LEAST_DN)).astype(np.float32)


def camera_view(pair: Pair, strata: Strata, surface: Mask, root: Image) -> SampledView:
    """Bring the right image onto the left one, registered by what both have in common.

    Args:
        pair: images [DN].
        strata: reference disparity of the scene.
        surface: pixels that count.
        root: as `root_level` returns it.
    """
    x, y = pixel_grid(surface.shape)
    disparity_px = filled(strata.disparity_px, np.isfinite(strata.disparity_px))
    cells = cells_within(surface)
    shift = np.zeros((*surface.shape, 2), np.float32)
    width = surface.shape[1]
    view = SampledView(left_x=x, left_y=y, right_x=x - disparity_px, right_y=y, known=surface)
    for _ in range(_ROUNDS if len(cells) else 0):
        spectra = pair_spectra(pair, view, root, cells)
        shifts = registration.window_shifts(spectra.left, spectra.right)
        shift = shift + registration.shift_map(shifts, cells, surface.shape)
        right_x = np.asarray(x - disparity_px + shift[..., 0], np.float32)
        view = SampledView(
            left_x=x,
            left_y=y,
            right_x=right_x,
            right_y=np.asarray(y + shift[..., 1], np.float32),
            known=surface & (right_x >= 0) & (right_x <= width - 1),
        )
    return view


def directions(strata: Strata, pattern_scale: float = 1.0) -> Image:
    """Return where the nominal pattern has each pixel's point (h, w, 2) [px], NaN if unknown.

    Args:
        strata: tangents of the points in the projector's frame.
        pattern_scale: direction cosines of the scene's pattern over those of the nominal one.
    """
    info = strata.info
    square = np.sum(strata.projector**2, axis=-1, keepdims=True)
    cosine_square = (1 + square) * pattern_scale**2 - square
    focal_px = np.array([info.fx_px, info.fy_px], np.float32)
    centre = np.array([info.cx_px, info.cy_px], np.float32)
    return np.asarray(strata.projector / np.sqrt(cosine_square) * focal_px + centre, np.float32)


def projector_view(view: SampledView, seen: Image, surface: Mask) -> SampledView:
    """Sample a camera view along the directions of the projector.

    Args:
        view: from `camera_view`.
        seen: from `directions`.
        surface: pixels that count.
    """
    known = np.isfinite(seen).all(axis=-1) & surface
    if not known.any():
        return SampledView(
            left_x=view.left_x,
            left_y=view.left_y,
            right_x=view.right_x,
            right_y=view.right_y,
            known=known,
        )
    x, y = pixel_grid(surface.shape)
    offset = np.stack([filled(seen[..., axis], known) for axis in (0, 1)], axis=-1)
    offset -= np.stack([x, y], axis=-1)
    left_x, left_y = x, y
    for _ in range(_STEPS):
        at_place = sample_smooth(offset, left_x, left_y)
        left_x, left_y = x - at_place[..., 0], y - at_place[..., 1]
    at_place = sample_smooth(offset, left_x, left_y)
    error = np.hypot(left_x + at_place[..., 0] - x, left_y + at_place[..., 1] - y)
    inside = (left_x >= 0) & (left_x <= x[0, -1]) & (left_y >= 0) & (left_y <= y[-1, 0])
    open_places = sample_smooth((known & view.known).astype(np.float32), left_x, left_y) >= 1
    return SampledView(
        left_x=left_x,
        left_y=left_y,
        right_x=sample_smooth(view.right_x, left_x, left_y),
        right_y=sample_smooth(view.right_y, left_x, left_y),
        known=open_places & inside & (error <= _NEAR_PX),
    )


def pair_spectra(
    pair: Pair, view: SampledView, root: Image, cells: NDArray[np.intp]
) -> PairSpectra:
    """Transform the windows of a pair, each divided by the root of its level.

    Args:
        pair: images [DN].
        view: where both are sampled.
        root: (h, w) divisor in the left image's own view.
        cells: grid cells with known windows.
    """
    divisor = window_means(sample_smooth(root, view.left_x, view.left_y), view.known, cells)
    scale = (1 / divisor[:, None, None]).astype(np.float32)
    spectra, factors = [], []
    places = ((view.left_x, view.left_y), (view.right_x, view.right_y))
    for image, (x, y) in zip(pair, places, strict=True):
        remaining = transfer(x, y, view.known)
        raw = window_spectra(sample(image, x, y), view.known, cells)
        spectra.append(raw * scale / remaining.amplitude.astype(np.float32))
        factors.append(remaining.amplitude**2 / remaining.power)
    return PairSpectra(
        left=spectra[0], right=spectra[1], left_power=factors[0], right_power=factors[1]
    )


def median_shift(view: SampledView, strata: Strata) -> tuple[float, float]:
    """Return the median shift of a camera view's right image, right and down [px]."""
    x, y = pixel_grid(view.known.shape)
    right = (view.right_x - x + strata.disparity_px)[view.known]
    down = (view.right_y - y)[view.known]
    return float(np.nanmedian(right)), float(np.median(down))
