"""Census transform: one bit per neighbour of a pixel."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.stereo.lanes import WORDS, above, load_words, read, splat_words, store_low_bytes

SUBLEVELS = 64  # Levels per DN of the 8-bit scale; smoothing then resolves fractions of a DN.
LEAST_PLANES = 5  # Planes of a 9x9 census, the usual size; smaller ones have empty planes.
_u16, _LANES = np.uint16, WORDS.count


class View(NamedTuple):
    """What the cost compares of an image, in rows that may be mirrored and padded."""

    bits: NDArray[np.uint8]  # (h, planes, w): bit k % 8 of plane k // 8 belongs to offset k.
    dn: NDArray[np.uint8]  # (h, w) brightness [DN of 8 bits].


def levels(image: NDArray, *, presmooth_px: float) -> NDArray[np.uint16]:
    """Convert an image to the matcher's fixed-point brightness, lightly smoothed.

    Smoothing before rounding gives an 8-bit image levels between its DN, which dark areas need.

    Args:
        image: (h, w) uint8, or uint16 with 10 bits.
        presmooth_px: standard deviation of the Gaussian [px]; 0 disables it.

    Returns:
        (h, w) uint16, SUBLEVELS per DN of the 8-bit scale.
    """
    scale = SUBLEVELS if image.dtype == np.uint8 else SUBLEVELS / 4
    scaled = image.astype(np.float32) * np.float32(scale)
    if presmooth_px > 0:
        scaled = cv2.GaussianBlur(scaled, (0, 0), presmooth_px, borderType=cv2.BORDER_REPLICATE)
    return np.rint(scaled).astype(np.uint16)


def offsets(census_px: int) -> NDArray[np.int64]:
    """Return the offsets that a census compares with its centre: a chequerboard, at most 64.

    Half the pixels of a 9x9 window preserve its reach and fit one machine word. Dense windows with
    as many pixels have less reach and agree less with the device (docs/design/matcher.md).

    Returns:
        (n, 2) offsets (dy, dx), in the order of the bits.
    """
    reach = census_px // 2
    grid = [(y, x) for y in range(-reach, reach + 1) for x in range(-reach, reach + 1)]
    return np.array([(y, x) for y, x in grid if (y + x) % 2 == 0 and (y, x) != (0, 0)])


def census(level: NDArray[np.uint16], *, census_px: int, tolerance: int) -> View:
    """Compute one bit per compared neighbour: darker than the centre by more than `tolerance`.

    With tolerance 0 the bits are invariant under any strictly increasing change of brightness.

    Args:
        level: (h, w) brightness, w >= 16; the border is replicated.
        census_px: side of the window, odd, up to 11 [px].
        tolerance: in the levels of `level`, >= 0.
    """
    return _view(level, offsets(census_px), tolerance, 0)


def mirrored_census(level: NDArray[np.uint16], *, census_px: int, tolerance: int, pad: int) -> View:
    """Compute the census of the right image, with mirrored rows (arguments as `census`).

    In mirrored rows, pixels of increasing disparity are contiguous in memory. The left column, now
    the last, is repeated `pad` times. The padding gives disparities that point left of the image an
    ordinary cost, which avoids border artefacts.
    """
    return _view(level[:, ::-1], offsets(census_px) * (1, -1), tolerance, pad)


def _view(level: NDArray[np.uint16], taps: NDArray, tolerance: int, pad: int) -> View:
    h, w = level.shape
    reach = int(taps.max())
    padded = cv2.copyMakeBorder(
        np.ascontiguousarray(level), reach, reach, reach, reach, cv2.BORDER_REPLICATE
    )
    places = (taps + reach) @ (padded.shape[1], 1)
    planes = max(LEAST_PLANES, -(-len(taps) // 8))
    bits, dn = np.zeros((h, planes, w + pad), np.uint8), np.empty((h, w + pad), np.uint8)
    flat = (padded.reshape(-1), places, bits.reshape(-1), dn.reshape(-1))
    _census(*flat, h, w, pad, reach, _u16(tolerance))
    return View(bits, dn)


@nb.njit(nogil=True, cache=True)
def _census(padded, places, bits, dn, h, w, pad, reach, tolerance):  # pragma: no cover - compiled
    stride, span = w + 2 * reach, w + pad
    planes = len(bits) // (h * span)
    level_shift = splat_words(_u16(6))  # SUBLEVELS is 2^6.
    for y in range(h):
        for start in range(0, w, _LANES):
            x = min(start, w - _LANES)  # The last vector overlaps the one before.
            corner = y * stride + x
            centre = load_words(padded, corner + reach * stride + reach)
            store_low_bytes(dn, y * span + x, centre >> level_shift)
            centre = centre - splat_words(tolerance)
            for plane in range((len(places) + 7) // 8):
                word = splat_words(_u16(0))
                for k in range(min(8 * plane + 8, len(places)) - 1, 8 * plane - 1, -1):
                    darker = above(centre, load_words(padded, corner + read(places, k)))
                    word = word + word - darker  # A set mask is -1.
                store_low_bytes(bits, (y * planes + plane) * span + x, word)
        for row in range(planes):
            at = (y * planes + row) * span + w
            bits[at : at + pad] = bits[at - 1]
        dn[y * span + w : (y + 1) * span] = dn[y * span + w - 1]
