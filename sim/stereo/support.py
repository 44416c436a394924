"""Matching cost, averaged over a support region that ends at steps of brightness.

Cross-based support: Zhang, Lu and Lafruit 2009 (IEEE TCSVT 19(7)); in AD-Census: Mei et al. 2011.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim.stereo.census import LEAST_PLANES, View
from starling.sim.stereo.lanes import (
    BYTES,
    WORDS,
    aligned_words,
    count_bits,
    equal,
    excess,
    greater,
    high_product,
    lesser,
    load_bytes,
    load_words,
    lower_words,
    read,
    splat_bytes,
    splat_words,
    store_low_bytes,
    store_words,
    upper_words,
)

COST_SCALE = 32  # Levels per bit in the averaged cost; the sub-pixel fit needs fractions of a bit.
ROW_SCALE = 16  # Levels per bit in the rows' means; a sum of 15 means fits 16 bits.
_RING = 16  # Running sums kept along a row: two arms of 7 px, their root, and the sum before.
_LAST = _RING - 1
_FAR = 65535  # Brightness outside the image, further from any pixel than the largest step.
_u8, _u16 = np.uint8, np.uint16
_LANES, _WIDE = WORDS.count, BYTES.count


def arms(level: NDArray[np.uint16], *, step: int, reach: int) -> NDArray[np.uint8]:
    """Return the lengths of every pixel's four arms, within which brightness differs by <= `step`.

    Args:
        level: (h, w) uint16 brightness, w >= 16.
        step: largest difference to the arm's root, in the levels of `level`.
        reach: longest arm [px]; arms also end at the image's border.

    Returns:
        (4, h, w) uint8: west, east, north, south.
    """
    h, w = level.shape
    margins = (reach, reach, reach, reach, cv2.BORDER_CONSTANT)
    padded = cv2.copyMakeBorder(level, *margins, value=_FAR)  # pyright: ignore[reportArgumentType]
    out = np.empty((4, h, w), np.uint8)
    _arms(padded.reshape(-1), h, w, _u16(step), reach, out.reshape(-1))
    return out


@nb.njit(nogil=True, cache=True)
def _arms(padded, h, w, step, reach, out):  # pragma: no cover - compiled
    stride = w + 2 * reach
    one, nothing, steps = splat_words(_u16(1)), splat_words(_u16(0)), splat_words(step)
    for way in range(4):
        towards = (-1, 1, -stride, stride)[way]
        for y in range(h):
            for start in range(0, w, _LANES):
                x = min(start, w - _LANES)  # The last vector overlaps the one before.
                place = (y + reach) * stride + reach + x
                root = load_words(padded, place)
                grows, lengths = one, nothing
                for length in range(1, reach + 1):
                    tip = load_words(padded, place + length * towards)
                    off = greater(root, tip) - lesser(root, tip)
                    grows = grows & equal(lesser(off, steps), off)
                    lengths = lengths + grows
                store_low_bytes(out, (way * h + y) * w + x, lengths)


def _shares(scale: int) -> NDArray[np.uint16]:
    """Return scale / n for each count n of means, repeated in all lanes.

    Returns:
        (2, 16, lanes): whole part and 1/65536 parts of the share.
    """
    share = [0] + [(scale << 16) // count for count in range(1, _RING)]
    parts = np.array([np.right_shift(share, 16), np.bitwise_and(share, 65535)], np.uint16)
    table = aligned_words(2, _RING, _LANES)
    table[:] = parts[:, :, None]
    return table


def difference_limits(weight: int, cap_dn: int) -> NDArray[np.uint8]:
    """Return the differences above each of which the cost rises by one more bit [DN].

    Args:
        weight: of the brightness difference [1/16 bit per DN].
        cap_dn: largest difference that counts [DN].
    """
    bits = range(1, (cap_dn * weight >> 4) + 1)
    return np.array([-(-16 * bit // weight) - 1 for bit in bits] or [255], np.uint8)


_ROW_SHARES = _shares(ROW_SCALE).reshape(-1)
_COLUMN_SHARES = _shares(COST_SCALE // ROW_SCALE).reshape(-1)


@dataclass(slots=True)
class SupportCost:
    """Cost of a pair, averaged along the horizontal arms, then along the vertical arms.

    Rows are computed in order; only those that the arms span are stored. Rows that follow the
    last ones continue their running sums. Running sums make the time independent of the arms'
    lengths.
    """

    left: View
    right: View  # Mirrored; padded by at least least_px + search_px, rounded up to 32.
    arm: NDArray[np.uint8]  # (4, h, w) from `arms`.
    reach: int  # Longest arm [px].
    least_px: int  # Smallest disparity [px].
    search_px: int  # Disparities, a multiple of 16.
    weight: int  # Weight of the brightness difference [1/16 bit per DN].
    cap_dn: int  # Largest difference that counts [DN].
    _sums: NDArray[np.uint16] = field(default_factory=lambda: np.empty(0, np.uint16), repr=False)
    _row: int = -1  # Row after the last one computed.
    _fill_band: Callable[..., None] = field(init=False, repr=False)  # `_fill` of this pair.

    def __post_init__(self) -> None:
        h, w = self.left.dn.shape
        self._fill_band = partial(
            _fill,
            self.left.bits.reshape(-1),
            self.left.dn.reshape(-1),
            self.right.bits.reshape(-1),
            self.right.dn.reshape(-1),
            self.arm.reshape(-1),
            (h, w, self.right.dn.shape[1], self.search_px, self.left.bits.shape[1]),
            self.reach,
            self.least_px,
            difference_limits(self.weight, self.cap_dn),
            (_ROW_SHARES, _COLUMN_SHARES),
        )

    def fill(self, start: int, out: NDArray[np.uint16]) -> None:
        """Fill `out` (rows, w, search) from image row `start` on; the cost has COST_SCALE a bit."""
        w = self.left.dn.shape[1]
        first = start + self.reach
        if start != self._row or not start:
            first = max(0, start - self.reach)
            self._sums = aligned_words((2 * self.reach + 2) * w * self.search_px)
            self._sums[:] = 0
        self._row = start + len(out)
        rows = (first, start, len(out))
        self._fill_band(self._sums, rows, out.reshape(-1))


def padding(search_px: int) -> int:
    """Return the columns that the right view needs beyond its smallest disparity."""
    return -(-search_px // _WIDE) * _WIDE


@nb.njit(inline="always")
def _mean(sums, last, before, shares, count):  # pragma: no cover - compiled
    """Return the difference of two running sums times a share; the sums may wrap around."""
    total = load_words(sums, last) - load_words(sums, before)
    # A share loaded here, not before the loop, multiplies with one instruction.
    whole, part = load_words(shares, count), load_words(shares, count + _RING * _LANES)
    return total * whole + high_product(total, part)


@nb.njit(nogil=True, cache=True)
def _fill(
    bits, dn, bits_r, dn_r, arm, sizes, reach, pad, limits, all_shares, sums, rows, out
):  # pragma: no cover - compiled
    h, w, span, search, planes = sizes
    first, start, count = rows
    row_shares, column_shares = all_shares
    stored, size = 2 * reach + 2, w * search
    width = -(-search // _WIDE) * _WIDE
    along = np.zeros(_RING * width, np.uint16)  # Running sums along one row, up to each column.
    for y in range(first, start + count + reach):
        done = y - reach
        row = done % stored
        above, current = (y - 1) % stored * size, y % stored * size
        for column in range(w + reach):
            x = column - reach
            if y < h:
                if column < w:
                    before, now = (column & _LAST) * width, (column + 1 & _LAST) * width
                    _add_cost(
                        bits, dn, bits_r, dn_r, y, column, w, span, width, planes, pad,
                        limits, along, before, now,
                    )  # fmt: skip
                if x >= 0:
                    place = y * w + x
                    west, east = np.int64(read(arm, place)), np.int64(read(arm, h * w + place))
                    before, last = (x - west & _LAST) * width, (x + east + 1 & _LAST) * width
                    share = (west + east + 1) * _LANES
                    for d in range(0, search, _LANES):
                        mean = _mean(along, last + d, before + d, row_shares, share)
                        at = x * search + d
                        store_words(sums, current + at, load_words(sums, above + at) + mean)
            if x >= 0 and done >= start:
                place = done * w + x
                north = np.int64(read(arm, 2 * h * w + place))
                south = np.int64(read(arm, 3 * h * w + place))
                before, last = row - north - 1, row + south
                before = (before + stored if before < 0 else before) * size + x * search
                last = (last - stored if last >= stored else last) * size + x * search
                share = (north + south + 1) * _LANES
                at = ((done - start) * w + x) * search
                for d in range(0, search, _LANES):
                    mean = _mean(sums, last + d, before + d, column_shares, share)
                    store_words(out, at + d, mean)
        along[:width] = 0


@nb.njit(inline="always")
def _add_cost(
    bits, dn, bits_r, dn_r, y, x, w, span, width, planes, pad, limits, along, before, now
):  # pragma: no cover - compiled
    """Add the cost of a pixel's disparities to the running sums: differing bits, brightness."""
    mine, theirs = y * planes * w + x, y * planes * span + w - 1 - x + pad
    a, b = splat_bytes(read(bits, mine)), splat_bytes(read(bits, mine + w))
    c, d = splat_bytes(read(bits, mine + 2 * w)), splat_bytes(read(bits, mine + 3 * w))
    e, level = splat_bytes(read(bits, mine + 4 * w)), splat_bytes(read(dn, y * w + x))
    level_at = y * span + w - 1 - x + pad
    one, limit = splat_bytes(_u8(1)), splat_bytes(limits[0])
    for start in range(0, width, _WIDE):
        at = theirs + start
        bits_a, bits_b = a ^ load_bytes(bits_r, at), b ^ load_bytes(bits_r, at + span)
        bits_c, bits_d = (
            c ^ load_bytes(bits_r, at + 2 * span),
            d ^ load_bytes(bits_r, at + 3 * span),
        )
        # Two full adders leave three planes to count, of which two count double.
        half, carry = bits_a ^ bits_b, bits_a & bits_b
        carry, bits_a = carry | (half & bits_c), half ^ bits_c
        bits_e = e ^ load_bytes(bits_r, at + 4 * span)
        half, second = bits_a ^ bits_d, bits_a & bits_d
        second = second | (half & bits_e)
        twice = count_bits(carry) + count_bits(second)
        level_r = load_bytes(dn_r, level_at + start)
        off = excess(level, level_r) | excess(level_r, level)
        differing = count_bits(half ^ bits_e) + twice + twice + lesser(excess(off, limit), one)
        _add_bytes(along, now + start, along, before + start, differing)
    for plane in range(LEAST_PLANES, planes):
        mask = splat_bytes(read(bits, mine + plane * w))
        for start in range(0, width, _WIDE):
            differing = count_bits(mask ^ load_bytes(bits_r, theirs + plane * span + start))
            _add_bytes(along, now + start, along, now + start, differing)
    for k in range(1, len(limits)):
        limit = splat_bytes(limits[k])
        for start in range(0, width, _WIDE):
            level_r = load_bytes(dn_r, level_at + start)
            off = excess(level, level_r) | excess(level_r, level)
            _add_bytes(along, now + start, along, now + start, lesser(excess(off, limit), one))


@nb.njit(inline="always")
def _add_bytes(out, at, words, place, summand):  # pragma: no cover - compiled
    """Write words plus bytes."""
    store_words(out, at, load_words(words, place) + lower_words(summand))
    upper = load_words(words, place + _LANES) + upper_words(summand)
    store_words(out, at + _LANES, upper)
