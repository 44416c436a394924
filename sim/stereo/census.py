"""Census transform and matching cost: differing census bits plus absolute difference."""

from __future__ import annotations

import cv2
import numba as nb
import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

SUBLEVELS = 64  # Levels per DN of the 8-bit scale; smoothing then resolves fractions of a DN.
_u8, _u16, _u64 = np.uint8, np.uint16, np.uint64


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


def census(level: NDArray[np.uint16], *, census_px: int, tolerance: int) -> NDArray[np.uint64]:
    """Return one bit per compared neighbour: darker than the centre by more than `tolerance`.

    With tolerance 0 the result is invariant under any strictly increasing change of brightness.

    Args:
        level: (h, w) brightness; the border is replicated.
        census_px: side of the window, odd, up to 11 [px].
        tolerance: in the levels of `level`, >= 0.

    Returns:
        (h, w) uint64; bit k belongs to offset k of `offsets`.
    """
    reach = census_px // 2
    padded = cv2.copyMakeBorder(level, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    return _census(padded, offsets(census_px) + reach, reach, np.int32(tolerance))


@nb.njit(cache=True)
def _census(padded, taps, reach, tolerance):  # pragma: no cover - compiled
    h, w = padded.shape[0] - 2 * reach, padded.shape[1] - 2 * reach
    out = np.zeros((h, w), np.uint64)
    for y in range(h):
        for k in range(len(taps)):
            row = padded[y + taps[k, 0], taps[k, 1] : taps[k, 1] + w]
            centre = padded[y + reach, reach : reach + w]
            bit = _u64(_u64(1) << _u64(k))
            for x in range(w):
                darker = np.int32(row[x]) + tolerance < np.int32(centre[x])
                out[y, x] |= bit if darker else _u64(0)
    return out


@intrinsic
def _popcount(typing_context, word):
    """Count the set bits of a uint64 with the processor's instruction."""
    if word != types.uint64:
        return None

    def generate(context, builder, signature, arguments):
        return builder.ctpop(arguments[0])

    return types.uint64(types.uint64), generate


@nb.njit(inline="always")
def cost_row(bits, bits_r, dn, dn_r, pad, weight, cap, out):  # pragma: no cover - compiled
    """Fill the cost of every disparity in one row; the right row is mirrored, padded by `pad`."""
    w, search = out.shape
    for x in range(w):
        start = w - 1 - x + pad
        mine, level = bits[x], dn[x]
        theirs, levels_r = bits_r[start : start + search], dn_r[start : start + search]
        row = out[x]
        for d in range(search):  # Separate loops: 64-bit words would halve the SIMD use of bytes.
            row[d] = _u8(_popcount(mine ^ theirs[d]))  # pyright: ignore[reportCallIssue]
        for d in range(search):
            step = _u8(max(level, levels_r[d]) - min(level, levels_r[d]))
            step = min(step, _u8(cap))
            row[d] = _u8(row[d] + _u8(_u16(_u16(step) * weight) >> _u16(4)))


def mirrored(rows: NDArray, *, pad: int) -> NDArray:
    """Mirror the right image's rows and repeat its left column, now the last, `pad` times.

    In mirrored rows, pixels of increasing disparity are contiguous in memory. The padding gives
    disparities that point left of the image an ordinary cost, which avoids border artefacts.
    """
    flipped = rows[:, ::-1]
    return np.ascontiguousarray(np.pad(flipped, ((0, 0), (0, pad)), mode="edge"))
