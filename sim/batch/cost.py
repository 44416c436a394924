"""Kernels of the matching cost: census, and its mean over a support that ends at edges.

Images have the shape (n, h, w). Volumes are flat, with the index ((e h + y) w + x) search + d. All
arithmetic is that of `starling.sim.stereo.census` and `support`, in whole numbers.
"""
# pyright: reportInvalidTypeForm=false

from __future__ import annotations

from typing import Any

from starling.sim.batch import handoff
from starling.sim.stereo.census import SUBLEVELS

wp: Any = handoff.import_warp()  # Annotations of kernels are values, not types.

wp.set_module_options({"enable_backward": False})

_LEVEL_BITS = wp.constant(SUBLEVELS.bit_length() - 1)  # Levels per DN are a power of two.
_WORD = wp.constant(wp.uint32(0xFFFF))  # Running sums wrap around at 16 bits.
_HALF = wp.constant(wp.uint32(16))


@wp.struct
class Search:
    """Sizes of the search, and of the window."""

    least: int  # Smallest disparity [px].
    search: int  # Number of disparities.
    tolerance: int  # Least difference for a neighbour to count as darker [levels].
    arm_step: int  # The support ends at larger differences [levels].
    arm: int  # Longest arm [px].


@wp.kernel
def smooth_rows(
    codes: wp.array3d(dtype=wp.uint16),
    weights: wp.array(dtype=float),
    scale: float,
    smoothed: wp.array3d(dtype=float),
):  # pragma: no cover - compiled
    """Convert codes (n, h, w) to the matcher's levels, smoothed along rows; the border is repeated.

    Args:
        codes: (n, h, w) infrared image.
        weights: (2 reach + 1,) of a Gaussian.
        scale: levels per code.
        smoothed: (n, h, w) is filled.
    """
    e, y, x = wp.tid()
    w = codes.shape[2]
    reach = weights.shape[0] // 2
    total = wp.float32(0.0)
    for k in range(2 * reach + 1):
        total += weights[k] * (scale * float(codes[e, y, wp.clamp(x + k - reach, 0, w - 1)]))
    smoothed[e, y, x] = total


@wp.kernel
def smooth_columns(
    smoothed: wp.array3d(dtype=float),
    weights: wp.array(dtype=float),
    level: wp.array3d(dtype=wp.uint16),
):  # pragma: no cover - compiled
    """Smooth along columns and round to levels (n, h, w)."""
    e, y, x = wp.tid()
    h = smoothed.shape[1]
    reach = weights.shape[0] // 2
    total = weights[reach] * smoothed[e, y, x]
    for k in range(1, reach + 1):
        before = smoothed[e, wp.max(y - k, 0), x]
        after = smoothed[e, wp.min(y + k, h - 1), x]
        total += weights[reach + k] * (after + before)
    level[e, y, x] = wp.uint16(int(wp.rint(total)))


@wp.kernel
def compare(
    level: wp.array3d(dtype=wp.uint16),
    offsets: wp.array(dtype=wp.vec2i),
    setting: Search,
    bits: wp.array3d(dtype=wp.uint64),
):  # pragma: no cover - compiled
    """Set a bit of the census (n, h, w) for each neighbour (dy, dx) darker than the centre."""
    e, y, x = wp.tid()
    h = level.shape[1]
    w = level.shape[2]
    centre = int(level[e, y, x]) - setting.tolerance
    word = wp.uint64(0)
    for k in range(offsets.shape[0]):
        row = wp.clamp(y + offsets[k][0], 0, h - 1)
        column = wp.clamp(x + offsets[k][1], 0, w - 1)
        word = word << wp.uint64(1)
        if centre > int(level[e, row, column]):
            word = word | wp.uint64(1)
    bits[e, y, x] = word


@wp.func
def _arm(
    level: wp.array3d(dtype=wp.uint16), setting: Search, e: int, y: int, x: int, dy: int, dx: int
) -> int:  # pragma: no cover - compiled
    root = int(level[e, y, x])
    length = wp.int32(0)
    grows = wp.bool(True)
    while grows and length < setting.arm:
        row = y + (length + 1) * dy
        column = x + (length + 1) * dx
        grows = row >= 0 and row < level.shape[1] and column >= 0 and column < level.shape[2]
        if grows:
            grows = wp.abs(int(level[e, row, column]) - root) <= setting.arm_step
        if grows:
            length += 1
    return length


@wp.kernel
def grow_arms(
    level: wp.array3d(dtype=wp.uint16), setting: Search, arms: wp.array3d(dtype=wp.vec4ub)
):  # pragma: no cover - compiled
    """Measure every pixel's arms (n, h, w): west, east, north, south [px]."""
    e, y, x = wp.tid()
    arms[e, y, x] = wp.vec4ub(
        wp.uint8(_arm(level, setting, e, y, x, 0, -1)),
        wp.uint8(_arm(level, setting, e, y, x, 0, 1)),
        wp.uint8(_arm(level, setting, e, y, x, -1, 0)),
        wp.uint8(_arm(level, setting, e, y, x, 1, 0)),
    )


@wp.kernel
def sum_cost_along_rows(
    bits: wp.array3d(dtype=wp.uint64),
    level: wp.array3d(dtype=wp.uint16),
    bits_r: wp.array3d(dtype=wp.uint64),
    level_r: wp.array3d(dtype=wp.uint16),
    limits: wp.array(dtype=int),
    setting: Search,
    sums: wp.array(dtype=wp.uint16),
):  # pragma: no cover - compiled
    """Fill a volume with running sums along rows of the cost; a thread has one row and disparity.

    Args:
        bits, level: (n, h, w) of the left image.
        bits_r, level_r: (n, h, w) of the right image.
        limits: the cost rises by one bit above each of these differences of brightness [DN].
        setting: sizes.
        sums: flat volume [bit].
    """
    e, y, d = wp.tid()
    h = bits.shape[1]
    w = bits.shape[2]
    total = wp.uint32(0)
    for x in range(w):
        partner = wp.max(x - d - setting.least, 0)
        cost = int(wp.bit_count(bits[e, y, x] ^ bits_r[e, y, partner]))
        dn = int(level[e, y, x]) >> _LEVEL_BITS
        off = wp.abs(dn - (int(level_r[e, y, partner]) >> _LEVEL_BITS))
        for k in range(limits.shape[0]):
            if off > limits[k]:
                cost += 1
        total += wp.uint32(cost)
        sums[((e * h + y) * w + x) * setting.search + d] = wp.uint16(total & _WORD)


@wp.func
def _mean(
    last: wp.uint16, before: wp.uint16, share: wp.uint32
) -> wp.uint32:  # pragma: no cover - compiled
    """Return the difference of two running sums times a share [1/65536]; the sums wrap around."""
    total = (wp.uint32(last) - wp.uint32(before)) & _WORD
    return (total * share) >> _HALF


@wp.kernel
def sum_means_along_columns(
    sums: wp.array(dtype=wp.uint16),
    arms: wp.array3d(dtype=wp.vec4ub),
    shares: wp.array(dtype=wp.uint32),
    setting: Search,
    down: wp.array(dtype=wp.uint16),
):  # pragma: no cover - compiled
    """Fill a volume with running sums along columns of the rows' means.

    Args:
        sums: flat volume of `sum_cost_along_rows`.
        arms: (n, h, w) of `grow_arms`.
        shares: (16,) share of each count of pixels [1/65536].
        setting: sizes.
        down: flat volume.
    """
    e, x, d = wp.tid()
    h = arms.shape[1]
    w = arms.shape[2]
    total = wp.uint32(0)
    for y in range(h):
        arm = arms[e, y, x]
        west = int(arm[0])
        east = int(arm[1])
        row = (e * h + y) * w
        before = wp.uint16(0)
        if x - west > 0:
            before = sums[(row + x - west - 1) * setting.search + d]
        last = sums[(row + x + east) * setting.search + d]
        total += _mean(last, before, shares[west + east + 1])
        down[(row + x) * setting.search + d] = wp.uint16(total & _WORD)


@wp.kernel
def average_columns(
    down: wp.array(dtype=wp.uint16),
    arms: wp.array3d(dtype=wp.vec4ub),
    shares: wp.array(dtype=wp.uint32),
    setting: Search,
    cost: wp.array(dtype=wp.uint16),
):  # pragma: no cover - compiled
    """Fill the cost volume, with `support.COST_SCALE` levels per bit.

    Args:
        down: flat volume of `sum_means_along_columns`.
        arms: (n, h, w) of `grow_arms`.
        shares: (16,) share of each count of rows [1/65536].
        setting: sizes.
        cost: flat volume.
    """
    e, y, x, d = wp.tid()
    h = arms.shape[1]
    w = arms.shape[2]
    arm = arms[e, y, x]
    north = int(arm[2])
    south = int(arm[3])
    before = wp.uint16(0)
    if y - north > 0:
        before = down[((e * h + y - north - 1) * w + x) * setting.search + d]
    last = down[((e * h + y + south) * w + x) * setting.search + d]
    mean = _mean(last, before, shares[north + south + 1])
    cost[((e * h + y) * w + x) * setting.search + d] = wp.uint16(mean & _WORD)
