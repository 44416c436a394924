"""Kernels of the views: disparities and reflectance seen from other places.

Images have the shape (n, h, w) of n environments. The numba kernels of `starling.sim.warp` are the
reference; here every pixel is a thread.
"""
# pyright: reportInvalidTypeForm=false

from __future__ import annotations

from typing import Any

from starling.sim.batch import handoff
from starling.sim.warp.depth_input import NEAREST_SURFACE_M
from starling.sim.warp.kernels import INSET_PX
from starling.sim.warp.layers import JUMP_PX

wp: Any = handoff.import_warp()  # Annotations of kernels are values, not types.

wp.set_module_options({"enable_backward": False})

_JUMP = wp.constant(JUMP_PX)
_INSET = wp.constant(float(INSET_PX))
_NEAREST = wp.constant(NEAREST_SURFACE_M)
_LOW = wp.constant(wp.uint64(0xFFFFFFFF))
_ROW = wp.constant(wp.uint64(32))


@wp.kernel
def fill_disparity(
    depth: wp.array3d(dtype=float), focal_baseline: float, disparity: wp.array3d(dtype=float)
):  # pragma: no cover - compiled
    """Convert depth [m] to disparity [px]; 0 without a surface."""
    e, y, x = wp.tid()
    z = depth[e, y, x]
    value = wp.float32(0.0)
    if wp.isfinite(z) and z >= _NEAREST:
        value = focal_baseline / z
    disparity[e, y, x] = value


@wp.func
def _offer(
    seen: wp.array3d(dtype=wp.uint64), e: int, y: int, i: int, value: float, source: float
):  # pragma: no cover - compiled
    """Offer a surface to a pixel: the larger disparity wins, then the smaller source column.

    The order of threads does not change the result.
    """
    low = _LOW - wp.uint64(wp.cast(source, wp.uint32))
    wp.atomic_max(seen, e, y, i, (wp.uint64(wp.cast(value, wp.uint32)) << _ROW) | low)


@wp.func
def seen_disparity(packed: wp.uint64) -> float:  # pragma: no cover - compiled
    """Disparity of a pixel that `_offer` filled [px]; 0 where nothing is seen."""
    return wp.cast(wp.uint32(packed >> _ROW), wp.float32)


@wp.kernel
def see(
    disparity: wp.array3d(dtype=float),
    place: float,
    margin: int,
    seen: wp.array3d(dtype=wp.uint64),
):  # pragma: no cover - compiled
    """Rasterise the left view into the view at `place` baselines; the nearest surface wins.

    Args:
        disparity: (n, h, w) [px], 0 without a surface.
        place: place of the view [baselines].
        margin: columns of `seen` to the left of the view's first column.
        seen: (n, h, columns), zero before; disparity and source column of each pixel.
    """
    e, y, x = wp.tid()
    value = disparity[e, y, x]
    if value <= 0.0:
        return
    w = disparity.shape[2]
    columns = seen.shape[2]
    left = float(x) - place * value + float(margin)
    following = wp.float32(0.0)
    before = wp.float32(0.0)
    if x + 1 < w:
        following = disparity[e, y, x + 1]
    if x > 0:
        before = disparity[e, y, x - 1]
    joined = following > 0.0 and wp.abs(following - value) <= _JUMP
    if joined:
        right = float(x + 1) - place * following + float(margin)
        if right > left:
            slope = 1.0 / (right - left)
            first = wp.max(int(wp.ceil(left)), 0)
            last = wp.min(int(wp.floor(right)), columns - 1)
            for i in range(first, last + 1):
                share = (float(i) - left) * slope
                _offer(seen, e, y, i, value + share * (following - value), float(x) + share)
    if (not joined) or before <= 0.0 or wp.abs(before - value) > _JUMP:
        i = int(wp.floor(left + 0.5))
        if i >= 0 and i < columns:
            _offer(seen, e, y, i, value, float(x))


@wp.func
def _inner(
    left: wp.array3d(dtype=float), reflectance: wp.array3d(dtype=float), e: int, y: int, x: int
) -> float:  # pragma: no cover - compiled
    """Reflectance that does not mix two surfaces; see `starling.sim.warp.kernels.inner_rows`."""
    d = left[e, y, x]
    w = left.shape[2]
    h = left.shape[1]
    west = wp.abs(left[e, y, wp.max(x - 1, 0)] - d) <= _JUMP
    east = wp.abs(left[e, y, wp.min(x + 1, w - 1)] - d) <= _JUMP
    above = wp.abs(left[e, wp.max(y - 1, 0), x] - d) <= _JUMP
    below = wp.abs(left[e, wp.min(y + 1, h - 1), x] - d) <= _JUMP
    if west and not east:
        return reflectance[e, y, x - 1]
    if east and not west:
        return reflectance[e, y, x + 1]
    if above and not below:
        return reflectance[e, y - 1, x]
    if below and not above:
        return reflectance[e, y + 1, x]
    return reflectance[e, y, x]


@wp.func
def _source(packed: wp.uint64, column: int, x: int) -> float:  # pragma: no cover - compiled
    """Column of the left view whose reflectance continues from `column` to `x`."""
    source = wp.cast(wp.uint32(_LOW - (packed & _LOW)), wp.float32)
    if column < x:
        source -= _INSET
    if column > x:
        source += _INSET
    return source


@wp.kernel
def fill_right(
    seen: wp.array3d(dtype=wp.uint64),
    left: wp.array3d(dtype=float),
    reflectance: wp.array3d(dtype=float),
    rendered: wp.array3d(dtype=float),
    disparity: wp.array3d(dtype=float),
    reflected: wp.array3d(dtype=float),
):  # pragma: no cover - compiled
    """Fill the right view; the farther neighbour continues over unknown columns.

    Args:
        seen: (n, h, w) of `see` at 1 baseline, without margin.
        left, reflectance: (n, h, w) disparity and reflectance of the left view.
        rendered: (n, h, w) disparity of the right view [px], with which the reflectance of the
            neighbour that is nearer in disparity continues; () takes that of the warp.
        disparity: (n, h, w) of the right view [px]; 0 in rows without a surface.
        reflected: (n, h, w) reflectance of the right view.
    """
    e, y, x = wp.tid()
    w = seen.shape[2]
    before = x
    while before >= 0 and seen[e, y, before] == wp.uint64(0):
        before -= 1
    after = x
    while after < w and seen[e, y, after] == wp.uint64(0):
        after += 1
    value = wp.float32(0.0)
    source = wp.float32(-1.0)
    farther = wp.int32(-1)
    nearer = wp.int32(-1)
    if before >= 0:
        farther = before
    if after < w and before != after:
        nearer = after
        if before < 0 or seen_disparity(seen[e, y, after]) < seen_disparity(seen[e, y, before]):
            farther = after
            nearer = before
    if farther >= 0:
        value = seen_disparity(seen[e, y, farther])
        source = _source(seen[e, y, farther], farther, x)
    if rendered.shape[0] > 0:
        true = rendered[e, y, x]
        if nearer >= 0:
            packed = seen[e, y, nearer]
            if wp.abs(true - seen_disparity(packed)) < wp.abs(true - value):
                source = _source(packed, nearer, x)
        value = true
    disparity[e, y, x] = value
    place = wp.clamp(source, 0.0, float(w - 1))
    column = wp.min(int(place), w - 2)
    share = place - float(column)
    if wp.abs(left[e, y, column + 1] - left[e, y, column]) > _JUMP:  # Surfaces do not mix.
        share = wp.rint(share)
    value_left = _inner(left, reflectance, e, y, column)
    value_right = _inner(left, reflectance, e, y, column + 1)
    reflected[e, y, x] = value_left + share * (value_right - value_left)


@wp.kernel
def see_rendered(
    disparity: wp.array3d(dtype=float), margin: int, seen: wp.array3d(dtype=wp.uint64)
):  # pragma: no cover - compiled
    """Fill `seen` of `see` with disparities (n, h, w) that were rendered from the view itself."""
    e, y, x = wp.tid()
    seen[e, y, x + margin] = wp.uint64(wp.cast(disparity[e, y, x], wp.uint32)) << _ROW
