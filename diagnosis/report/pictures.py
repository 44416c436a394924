"""The pictures of a diagnosis's page, as PNG bytes; no library that draws is needed."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.report.pictures import fitting
from starling.diagnosis.scenes.strata import Ground, Image
from starling.diagnosis.where.maps import Map
from starling.sim.captures import png

Colours = NDArray[np.uint8]  # (h, w, 3) red, green, blue.

ERROR_LIMIT_PX = 1.0  # Disparity error that is drawn fully red or blue.
UNKNOWN = (184, 188, 194)  # Grey, of no scale below.
HOLE = (30, 33, 38)
_CELL_PX = 20
_ZOOM, _PART = 3, 5  # A zoomed picture shows one fifth of the width, each pixel thrice,
_LEAST_PX = 96  # and at least so many pixels of it.
_SHOWN = 98.0  # Percentile of sizes that a scale of colours reaches.
_PLACES = np.linspace(-1, 1, 5)
_ANCHORS = np.array(  # From blue over white to red, ColorBrewer's RdBu.
    [(33, 102, 172), (146, 197, 222), (247, 247, 247), (244, 165, 130), (178, 24, 43)], float
)


def limit(maps: Sequence[Map], *, least: float) -> float:
    """Size that a symmetric scale common to some maps reaches.

    Args:
        maps: of one quantity.
        least: smallest limit, in the quantity's unit.
    """
    sizes = np.concatenate([np.abs(one.mean[np.isfinite(one.mean)]) for one in maps])
    return max(least, float(np.percentile(sizes, _SHOWN))) if sizes.size else least


def heat(mean: NDArray[np.float64], limit: float, *, aspect: float) -> bytes:
    """Draw a map's mean; cells that are not known are grey.

    Args:
        mean: (rows, columns) of the map, or a part of it.
        limit: value drawn fully red, its negative blue.
        aspect: height of a cell over its width.
    """
    tall = max(1, round(_CELL_PX * aspect))
    return png.encode_colour(_diverging(mean / limit).repeat(tall, axis=0).repeat(_CELL_PX, axis=1))


def scale() -> bytes:
    """Draw the scale of `heat` and `errors`, from the negative limit to the positive one."""
    return png.encode_colour(_diverging(np.linspace(-1, 1, 256)[None].repeat(8, axis=0)))


def levels(images: Sequence[NDArray]) -> tuple[float, float]:
    """Levels [DN] drawn black and white, common to some images: dots show, highlights may burn."""
    low, high = np.percentile(np.concatenate([one.ravel() for one in images]), (0.5, 99.7))
    return float(low), float(max(high, low + 1))


def infrared(image: NDArray, limits: tuple[float, float], *, zoomed: bool = False) -> bytes:
    """Draw an infrared image, brightened by a square root so that dark surfaces show.

    Args:
        image: (h, w) [DN].
        limits: levels drawn black and white.
        zoomed: its middle alone, pixel by pixel.
    """
    low, high = limits
    share = np.clip((image.astype(np.float64) - low) / (high - low), 0, 1)
    grey = np.rint(255 * np.sqrt(share)).astype(np.uint8)
    if zoomed:
        return png.encode(_middle(grey).repeat(_ZOOM, axis=0).repeat(_ZOOM, axis=1))
    return png.encode(fitting(grey, cv2.INTER_AREA))


def errors(disparity_px: Image, ground: Ground) -> bytes:
    """Draw a disparity's error against the reference (h, w); holes are dark, unknown is grey."""
    error = (disparity_px - ground.disparity_px) / ERROR_LIMIT_PX
    colours = _diverging(error)
    colours[~np.isfinite(disparity_px) & ground.counted] = HOLE
    colours[~ground.counted] = UNKNOWN
    return png.encode_colour(fitting(colours, cv2.INTER_NEAREST))


def _diverging(share: NDArray) -> Colours:
    """Colours of -1 to 1 (h, w, 3); NaN is grey."""
    known = np.isfinite(share)
    inside = np.clip(np.where(known, share, 0.0), -1, 1)
    channels = [np.interp(inside, _PLACES, channel) for channel in _ANCHORS.T]
    colours = np.rint(np.stack(channels, axis=-1)).astype(np.uint8)
    colours[~known] = UNKNOWN
    return colours


def _middle(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    height, width = grey.shape
    across = max(width // _PART, min(_LEAST_PX, width))
    down = max(height * across // width, 1)
    top, left = (height - down) // 2, (width - across) // 2
    return grey[top : top + down, left : left + across]
