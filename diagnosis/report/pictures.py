"""Pictures of a diagnosis page as PNG bytes."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.strata import Image, Strata
from starling.diagnosis.where.maps import GapMap
from starling.sim.captures import png
from starling.sim.report.pictures import enlarged, fitting, grey_codes

Colours = NDArray[np.uint8]  # (h, w, 3) red, green, blue.

ERROR_LIMIT_PX = 1.0  # Disparity error drawn fully red or blue.
UNKNOWN = (184, 188, 194)  # Grey of unknown values; it occurs in no colour scale.
HOLE = (30, 33, 38)
_CELL_PX = 20  # Width of a drawn cell [px].
_PART = 5  # A zoomed picture shows one fifth of the width.
_LEAST_PX = 96  # Least width that a zoomed picture shows [px].
_SHOWN = 98.0  # Percentile of absolute values at which a colour scale saturates.
_PLACES = np.linspace(-1, 1, 5)
_ANCHORS = np.array(  # ColorBrewer RdBu: blue, white, red.
    [(33, 102, 172), (146, 197, 222), (247, 247, 247), (244, 165, 130), (178, 24, 43)], float
)


def limit(maps: Sequence[GapMap], *, least: float) -> float:
    """Return the limit of a symmetric colour scale common to several maps.

    Args:
        maps: maps of one quantity.
        least: smallest limit, in the unit of the quantity.
    """
    sizes = np.concatenate([np.abs(each.mean[np.isfinite(each.mean)]) for each in maps])
    return max(least, float(np.percentile(sizes, _SHOWN))) if sizes.size else least


def heat(mean: NDArray[np.float64], limit: float, *, aspect: float) -> bytes:
    """Draw the mean of a map; unknown cells are grey.

    Args:
        mean: (rows, columns) mean of the map or a part of it.
        limit: value drawn fully red; its negative is fully blue.
        aspect: height of a cell over its width.
    """
    tall = max(1, round(_CELL_PX * aspect))
    return png.encode_colour(_diverging(mean / limit).repeat(tall, axis=0).repeat(_CELL_PX, axis=1))


def scale() -> bytes:
    """Draw the colour scale of `heat` and `errors` from the negative to the positive limit."""
    return png.encode_colour(_diverging(np.linspace(-1, 1, 256)[None].repeat(8, axis=0)))


def infrared(image: NDArray, limits: tuple[float, float], *, zoomed: bool = False) -> bytes:
    """Draw an infrared image with a square-root curve, so that dark surfaces show.

    Args:
        image: (h, w) [DN].
        limits: levels drawn black and white.
        zoomed: draw only its middle, enlarged.
    """
    grey = grey_codes(image, limits)
    return png.encode(enlarged(_middle(grey)) if zoomed else fitting(grey, cv2.INTER_AREA))


def errors(disparity_px: Image, strata: Strata) -> bytes:
    """Draw the disparity error against the reference (h, w); holes are dark, unknown is grey."""
    error = (disparity_px - strata.disparity_px) / ERROR_LIMIT_PX
    colours = _diverging(error)
    colours[~np.isfinite(disparity_px) & strata.counted] = HOLE
    colours[~strata.counted] = UNKNOWN
    return png.encode_colour(fitting(colours, cv2.INTER_NEAREST))


def _diverging(share: NDArray) -> Colours:
    """Return colours (h, w, 3) of values from -1 to 1; NaN is grey."""
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
    first_row, first_column = (height - down) // 2, (width - across) // 2
    return grey[first_row : first_row + down, first_column : first_column + across]
