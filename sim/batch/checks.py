"""Kernels that reject matches.

Images have the shape (n, h, w). `starling.sim.stereo.checks` is the reference. Codes of reasons are
those of `starling.Reason`.
"""
# pyright: reportInvalidTypeForm=false

from __future__ import annotations

from typing import Any

from starling.sim.batch import handoff
from starling.sim.batch.refinement import rounded
from starling.sim.reason import Reason
from starling.sim.stereo.checks import LEAST_DARK, SUPPORT_PX, TEXTURE_PX
from starling.sim.stereo.matching import CONSISTENT_PX, LEAST_WEIGHT

wp: Any = handoff.import_warp()  # Annotations of kernels are values, not types.

wp.set_module_options({"enable_backward": False})

_TEXTURE = wp.constant(TEXTURE_PX)
_LEAST_DARK = wp.constant(LEAST_DARK)
_LEAST_WEIGHT = wp.constant(float(LEAST_WEIGHT))
_CONSISTENT = wp.constant(float(CONSISTENT_PX))
_REACH = wp.constant(SUPPORT_PX // 2)
_OUTSIDE = wp.constant(wp.uint8(int(Reason.OUTSIDE_OVERLAP)))
_AMBIGUOUS = wp.constant(wp.uint8(int(Reason.AMBIGUOUS)))
_LEFT_RIGHT = wp.constant(wp.uint8(int(Reason.LEFT_RIGHT)))
_SUPPORT = wp.constant(wp.uint8(int(Reason.SUPPORT)))
_VALID = wp.constant(wp.uint8(0))


@wp.struct
class Limits:
    """Thresholds of the checks."""

    left_right: float  # Largest left-right difference [px].
    jump: float  # Largest range of disparities in 3x3 pixels [px].
    texture: float  # Least variance in the left window [codes^2].
    support: float  # Least share of neighbours with a like disparity; 0 = off.
    like: float  # Largest difference of like disparities [px].
    border: float  # Least distance of a match from the right image's first column [px].
    reach: int  # Largest searched disparity [px].
    locking: float  # Amplitude of pixel locking after the mean [px].
    quantum: float  # Step of the result [px]; 0 = no rounding.
    speckle: int  # Islands of at most this many pixels are removed.
    step: float  # A larger step separates two islands [1/16 px].


@wp.func
def _reflected(i: int, n: int) -> int:  # pragma: no cover - compiled
    """Index in an image that is mirrored at its border, without repeating the edge."""
    k = wp.abs(i)
    if k >= n:
        k = 2 * n - 2 - k
    return wp.clamp(k, 0, n - 1)


@wp.kernel
def sum_texture(
    codes: wp.array3d(dtype=wp.uint16), sums: wp.array3d(dtype=wp.vec2i)
):  # pragma: no cover - compiled
    """Sum codes and squared codes (n, h, w) along rows of the texture's window."""
    e, y, x = wp.tid()
    total = wp.vec2i(0, 0)
    for k in range(_TEXTURE):
        code = int(codes[e, y, _reflected(x + k - _TEXTURE // 2, codes.shape[2])])
        total += wp.vec2i(code, code * code)
    sums[e, y, x] = total


@wp.func
def _moments(
    sums: wp.array3d(dtype=wp.vec2i), e: int, y: int, x: int
) -> wp.vec2:  # pragma: no cover - compiled
    """Mean [codes] and variance [codes^2] in the texture's window, from whole numbers."""
    first = wp.int64(0)
    second = wp.int64(0)
    for k in range(_TEXTURE):
        row = sums[e, _reflected(y + k - _TEXTURE // 2, sums.shape[1]), x]
        first += wp.int64(row[0])
        second += wp.int64(row[1])
    count = wp.int64(_TEXTURE * _TEXTURE)
    variance = float(second * count - first * first) / float(count * count)
    return wp.vec2(float(first) / float(count), variance)


@wp.kernel
def limit_darkness(
    gain: wp.array(dtype=float),
    table: wp.array(dtype=wp.vec2),
    own_gain: float,
    per_octave: float,
    limits: wp.array(dtype=wp.vec2),
):  # pragma: no cover - compiled
    """Interpolate the largest variance and mean of windows without light at each gain.

    Args:
        gain: (n,) of the left imager.
        table: largest deviations [codes] and means [codes] by the logarithm of the gain.
        own_gain: gain of the first entry.
        per_octave: entries for each doubling of the gain.
        limits: (n,) is filled with variances [codes^2] and means [codes].
    """
    e = wp.tid()
    last = table.shape[0] - 1
    place = wp.clamp(wp.log2(gain[e] / own_gain) * per_octave, 0.0, float(last))
    k = wp.min(int(place), wp.max(last - 1, 0))
    largest = wp.lerp(table[k], table[wp.min(k + 1, last)], place - float(k))
    limits[e] = wp.vec2(largest[0] * largest[0], largest[1])


@wp.kernel
def find_dark(
    sums: wp.array3d(dtype=wp.vec2i),
    limits: wp.array(dtype=wp.vec2),
    dark: wp.array3d(dtype=wp.uint8),
):  # pragma: no cover - compiled
    """Mark the centres of windows without light in `dark` (n, h, w).

    Args:
        sums: of `sum_texture`.
        limits: (n,) of `limit_darkness`.
        dark: is filled.
    """
    e, y, x = wp.tid()
    moments = _moments(sums, e, y, x)
    dark[e, y, x] = wp.uint8(0)
    if moments[1] < limits[e][0] and moments[0] < limits[e][1]:
        dark[e, y, x] = wp.uint8(1)


@wp.kernel
def count_dark(
    dark: wp.array3d(dtype=wp.uint8), count: wp.array3d(dtype=wp.uint8)
):  # pragma: no cover - compiled
    """Count marked pixels (n, h, w) along rows of the texture's window."""
    e, y, x = wp.tid()
    total = wp.uint8(0)
    for k in range(-(_TEXTURE // 2), _TEXTURE // 2 + 1):
        total += dark[e, y, wp.clamp(x + k, 0, dark.shape[2] - 1)]
    count[e, y, x] = total


@wp.kernel
def spread_dark(
    count: wp.array3d(dtype=wp.uint8), spread: wp.array3d(dtype=wp.uint8)
):  # pragma: no cover - compiled
    """Mark in `spread` (n, h, w) where windows hold enough pixels that `count_dark` counted."""
    e, y, x = wp.tid()
    total = wp.int32(0)
    for k in range(-(_TEXTURE // 2), _TEXTURE // 2 + 1):
        total += wp.int32(count[e, wp.clamp(y + k, 0, count.shape[1] - 1), x])
    spread[e, y, x] = wp.uint8(wp.where(total >= _LEAST_DARK, 1, 0))


@wp.func
def _range(
    disparity: wp.array3d(dtype=float), e: int, y: int, x: int
) -> float:  # pragma: no cover - compiled
    """Range of disparities in 3x3 pixels [px]."""
    low = disparity[e, y, x]
    high = low
    for j in range(wp.max(y - 1, 0), wp.min(y + 2, disparity.shape[1])):
        for i in range(wp.max(x - 1, 0), wp.min(x + 2, disparity.shape[2])):
            low = wp.min(low, disparity[e, j, i])
            high = wp.max(high, disparity[e, j, i])
    return high - low


@wp.func
def _disagree(
    left: wp.array3d(dtype=float),
    right: wp.array3d(dtype=float),
    e: int,
    y: int,
    x: int,
    tolerance: float,
) -> bool:  # pragma: no cover - compiled
    """Whether the match in the right view has another disparity, or none; False outside of it."""
    target = x - int(wp.rint(left[e, y, x]))
    if target < 0 or target >= right.shape[2]:
        return False
    match = right[e, y, target]
    near = match >= 0.0 and wp.abs(match - left[e, y, x]) <= tolerance
    return not near  # True for NaN.


@wp.kernel
def compare_views(
    best: wp.array3d(dtype=wp.int16),
    ambiguous: wp.array3d(dtype=wp.uint8),
    left: wp.array3d(dtype=float),
    right: wp.array3d(dtype=float),
    limits: Limits,
    weight: wp.array3d(dtype=float),
    reason: wp.array3d(dtype=wp.uint8),
):  # pragma: no cover - compiled
    """Reject matches by the search and by the other view; they get no weight in the mean.

    Others have a least weight.

    Args:
        best: (n, h, w) whole winners [px].
        ambiguous: (n, h, w) of `choose_left`.
        left, right: (n, h, w) disparities that the left-right check compares [px].
        limits: thresholds.
        weight: (n, h, w) curvatures, become weights.
        reason: (n, h, w) filled with codes.
    """
    e, y, x = wp.tid()
    code = _VALID
    if _disagree(left, right, e, y, x, limits.left_right):
        code = _LEFT_RIGHT
    if ambiguous[e, y, x] > _VALID:
        code = _AMBIGUOUS
    if int(best[e, y, x]) > x:
        code = _OUTSIDE
    weight[e, y, x] = wp.where(code > _VALID, 0.0, wp.max(weight[e, y, x], _LEAST_WEIGHT))
    reason[e, y, x] = code


@wp.kernel
def find_consistent(
    best: wp.array3d(dtype=wp.int16),
    left: wp.array3d(dtype=float),
    right: wp.array3d(dtype=float),
    consistent: wp.array3d(dtype=wp.uint8),
):  # pragma: no cover - compiled
    """Mark where the winners of both views agree, before any mean.

    Args:
        best: (n, h, w) whole winners [px].
        left, right: (n, h, w) winners of both views [px], not finite or negative without match.
        consistent: (n, h, w) is filled.
    """
    e, y, x = wp.tid()
    mark = wp.uint8(1)
    if int(best[e, y, x]) > x or _disagree(left, right, e, y, x, _CONSISTENT):
        mark = wp.uint8(0)
    consistent[e, y, x] = mark


@wp.func
def _unsupported(
    disparity: wp.array3d(dtype=float),
    consistent: wp.array3d(dtype=wp.uint8),
    e: int,
    y: int,
    x: int,
    limits: Limits,
) -> bool:  # pragma: no cover - compiled
    """Whether too few consistent neighbours in the support's window have a like disparity."""
    centre = disparity[e, y, x]
    count = -wp.int32(consistent[e, y, x])  # Less the pixel itself.
    others = wp.int32(-1)
    for j in range(wp.max(y - _REACH, 0), wp.min(y + _REACH + 1, disparity.shape[1])):
        for i in range(wp.max(x - _REACH, 0), wp.min(x + _REACH + 1, disparity.shape[2])):
            others += 1
            like = wp.abs(disparity[e, j, i] - centre) <= limits.like
            if like:
                count += wp.int32(consistent[e, j, i])
    return float(count) < limits.support * float(others)


@wp.kernel
def reject(
    disparity: wp.array3d(dtype=float),
    compared: wp.array3d(dtype=wp.uint8),
    consistent: wp.array3d(dtype=wp.uint8),
    texture: wp.array3d(dtype=wp.vec2i),
    dark: wp.array3d(dtype=wp.uint8),
    limits: Limits,
    accepted: wp.array3d(dtype=float),
    reason: wp.array3d(dtype=wp.uint8),
):  # pragma: no cover - compiled
    """Reject what `compare_views` left by its support.

    Args:
        disparity: (n, h, w) refined [px].
        compared: (n, h, w) codes of `compare_views`.
        consistent: (n, h, w) of `find_consistent`; () if the support is not checked.
        texture: (n, h, w) of `sum_texture`; () accepts every texture.
        dark: (n, h, w), marked without light; () accepts every pixel.
        limits: thresholds.
        accepted: (n, h, w) filled with disparities that pass, NaN elsewhere.
        reason: (n, h, w) filled with codes.
    """
    e, y, x = wp.tid()
    code = _VALID
    if texture.shape[0] > 0 and _moments(texture, e, y, x)[1] < limits.texture:
        code = _SUPPORT
    if dark.shape[0] > 0 and dark[e, y, x] > _VALID:
        code = _SUPPORT
    if _range(disparity, e, y, x) > limits.jump:
        code = _SUPPORT
    if limits.support > 0.0 and _unsupported(disparity, consistent, e, y, x, limits):
        code = _SUPPORT
    if compared[e, y, x] > _VALID:
        code = compared[e, y, x]
    accepted[e, y, x] = disparity[e, y, x]
    if code > _VALID:
        accepted[e, y, x] = wp.NAN
    reason[e, y, x] = code


@wp.kernel
def reject_outside(
    limits: Limits, accepted: wp.array3d(dtype=float), reason: wp.array3d(dtype=wp.uint8)
):  # pragma: no cover - compiled
    """Reject matches left of the right image; a hole has the disparity of its right neighbour.

    A thread has one row. `accepted` and `reason` (n, h, w) are changed.
    """
    e, y = wp.tid()
    width = wp.min(2 * (limits.reach + int(wp.ceil(limits.border))), accepted.shape[2])
    following = float(wp.NAN)
    for i in range(width):
        x = width - 1 - i
        value = accepted[e, y, x]
        if wp.isfinite(value):
            following = value
        if following > float(x) - limits.border:  # False for NaN.
            accepted[e, y, x] = wp.NAN
            reason[e, y, x] = _OUTSIDE


@wp.kernel
def settle(
    limits: Limits, accepted: wp.array3d(dtype=float), island: wp.array(dtype=int)
):  # pragma: no cover - compiled
    """Apply pixel locking and the quantum to `accepted` (n, h, w), and start the islands.

    Args:
        limits: thresholds.
        accepted: (n, h, w) disparities [px].
        island: (n h w,) filled with each pixel's own index, -1 without disparity.
    """
    e, y, x = wp.tid()
    i = (e * accepted.shape[1] + y) * accepted.shape[2] + x
    value = accepted[e, y, x]
    island[i] = -1
    if wp.isnan(value):
        return
    if limits.locking != 0.0:
        value -= limits.locking * wp.sin(2.0 * wp.PI * (value - wp.rint(value)))
    accepted[e, y, x] = rounded(value, limits.quantum)
    island[i] = i
