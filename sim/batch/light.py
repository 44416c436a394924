"""Kernels of the light: disparities seen from other places, and their radiance.

Images have the shape (n, h, w) of n environments. The numba kernels of `starling.sim.warp` are the
reference; here every pixel is a thread.
"""
# pyright: reportInvalidTypeForm=false

from __future__ import annotations

from typing import Any

from starling.sim.batch import handoff
from starling.sim.render.emission import NEAREST_M
from starling.sim.render.skylight import MATT_TILT
from starling.sim.warp.depth_input import NEAREST_SURFACE_M
from starling.sim.warp.kernels import INSET_PX, NEAREST_EMITTER_M, SLACK_PX, SLACK_SHARE
from starling.sim.warp.layers import JUMP_PX

wp: Any = handoff.import_warp()  # Annotations of kernels are values, not types.

wp.set_module_options({"enable_backward": False})

_JUMP = wp.constant(JUMP_PX)
_INSET = wp.constant(float(INSET_PX))
_NEAREST = wp.constant(NEAREST_SURFACE_M)
_NEAREST_EMITTER = wp.constant(float(NEAREST_EMITTER_M))
_FULL_BLUR = wp.constant(NEAREST_M)
_SLACK_SHARE = wp.constant(float(SLACK_SHARE))
_SLACK_PX = wp.constant(float(SLACK_PX))
_TILT = wp.constant(MATT_TILT)
_LOW = wp.constant(wp.uint64(0xFFFFFFFF))
_ROW = wp.constant(wp.uint64(32))


@wp.struct
class PairCamera:
    """Geometry of the rectified pair."""

    fx: float  # [px]
    fy: float  # [px]
    cx: float  # [px]
    cy: float  # [px]
    baseline: float  # True distance of the imagers [m].


@wp.struct
class EmitterBeam:
    """One emitter, in the left imager's frame."""

    origin: wp.vec3  # [m]
    rotation: wp.mat33  # Transposed, times a point: the point in the emitter's frame.
    half: wp.vec2  # Tangents of half the field.
    scale: float  # Direction cosines over those of the nominal pattern.
    place: float  # For shadows [baselines].
    focus: float  # Nearness in focus [1/m].
    width: float  # Blur of a spot per nearness, relative to its width in focus [m].
    log_ratio: float  # Logarithm of the variances' ratio of consecutive levels.


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


@wp.kernel
def fill_reflectance(
    bytes: wp.array4d(dtype=wp.uint8), reflectance: wp.array3d(dtype=float)
):  # pragma: no cover - compiled
    """Estimate the infrared reflectance from RGB bytes (n, h, w, 3); see `depth_input`."""
    e, y, x = wp.tid()
    level = wp.max(wp.max(bytes[e, y, x, 0], bytes[e, y, x, 1]), bytes[e, y, x, 2])
    share = float(level) / 255.0
    linear = share / 12.92
    if share > 0.04045:
        linear = wp.pow((share + 0.055) / 1.055, 2.4)
    reflectance[e, y, x] = 0.25 + 0.6 * linear


@wp.kernel
def scale_reflectance(
    share: wp.array3d(dtype=float), scale: float, reflectance: wp.array3d(dtype=float)
):  # pragma: no cover - compiled
    """Multiply reflectances by a scale, within 0 to 1; NaN counts as 0."""
    e, y, x = wp.tid()
    reflectance[e, y, x] = wp.clamp(share[e, y, x] * scale, 0.0, 1.0)


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
def _value(packed: wp.uint64) -> float:  # pragma: no cover - compiled
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


@wp.kernel
def fill_right(
    seen: wp.array3d(dtype=wp.uint64),
    left: wp.array3d(dtype=float),
    reflectance: wp.array3d(dtype=float),
    disparity: wp.array3d(dtype=float),
    reflected: wp.array3d(dtype=float),
):  # pragma: no cover - compiled
    """Fill the right view; the farther neighbour continues over unknown columns.

    Args:
        seen: (n, h, w) of `see` at 1 baseline, without margin.
        left, reflectance: (n, h, w) disparity and reflectance of the left view.
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
    nearest = wp.int32(-1)
    if before >= 0:
        nearest = before
    if after < w and (before < 0 or _value(seen[e, y, after]) < _value(seen[e, y, before])):
        nearest = after
    if nearest >= 0:
        packed = seen[e, y, nearest]
        value = _value(packed)
        source = wp.cast(wp.uint32(_LOW - (packed & _LOW)), wp.float32)
        if nearest < x:
            source -= _INSET
        if nearest > x:
            source += _INSET
    disparity[e, y, x] = value
    place = wp.clamp(source, 0.0, float(w - 1))
    column = wp.min(int(place), w - 2)
    share = place - float(column)
    if wp.abs(left[e, y, column + 1] - left[e, y, column]) > _JUMP:  # Surfaces do not mix.
        share = wp.rint(share)
    here = _inner(left, reflectance, e, y, column)
    beside = _inner(left, reflectance, e, y, column + 1)
    reflected[e, y, x] = here + share * (beside - here)


@wp.func
def _slope(before: float, value: float, after: float) -> float:  # pragma: no cover - compiled
    """Difference to the neighbour that is nearer in disparity; 0 without neighbours."""
    back = value - before
    ahead = after - value
    if before <= 0.0:
        back = ahead
    if after <= 0.0:
        ahead = back
    if before <= 0.0 and after <= 0.0:
        return 0.0
    if wp.abs(back) < wp.abs(ahead):
        return back
    return ahead


@wp.func
def _normal(
    disparity: wp.array3d(dtype=float), e: int, y: int, x: int, camera: PairCamera
) -> wp.vec3:  # pragma: no cover - compiled
    """Normal away from the imager, not normalised; disparity is linear on planes."""
    value = disparity[e, y, x]
    left = wp.float32(0.0)
    right = wp.float32(0.0)
    above = wp.float32(0.0)
    below = wp.float32(0.0)
    if x > 0:
        left = disparity[e, y, x - 1]
    if x + 1 < disparity.shape[2]:
        right = disparity[e, y, x + 1]
    if y > 0:
        above = disparity[e, y - 1, x]
    if y + 1 < disparity.shape[1]:
        below = disparity[e, y + 1, x]
    gx = _slope(left, value, right)
    gy = _slope(above, value, below)
    along = value - gx * (float(x) - camera.cx) - gy * (float(y) - camera.cy)
    return wp.vec3(gx * camera.fx, gy * camera.fy, along)


@wp.kernel
def light_by_sky(
    disparity: wp.array3d(dtype=float),
    reflectance: wp.array3d(dtype=float),
    camera: PairCamera,
    irradiance: float,
    gradient: float,
    up: wp.vec3,
    light: wp.array3d(dtype=wp.vec2),
):  # pragma: no cover - compiled
    """Set the light of a view to that of the sky.

    Args:
        disparity, reflectance: (n, h, w) of the view.
        camera: geometry.
        irradiance: of the sky [W m^-2].
        gradient, up: of the sky; see `Ambient`.
        light: (n, h, w) radiance of the projector (0 here) and of the sky [W m^-2 sr^-1].
    """
    e, y, x = wp.tid()
    value = wp.float32(0.0)
    if disparity[e, y, x] > 0.0:
        value = irradiance * reflectance[e, y, x] / wp.PI
        if gradient != 0.0:
            normal = _normal(disparity, e, y, x, camera)
            tilt = -wp.dot(normal, up) / wp.max(wp.length(normal), 1.0e-12)
            value *= 1.0 + gradient * _TILT * tilt
    light[e, y, x] = wp.vec2(0.0, value)


@wp.func
def _irradiance(
    levels: wp.array3d(dtype=float), level: int, y: float, x: float
) -> float:  # pragma: no cover - compiled
    """Interpolate a level of the pattern bilinearly, with the border repeated."""
    h = levels.shape[1]
    w = levels.shape[2]
    j = int(wp.floor(y))
    i = int(wp.floor(x))
    v = y - float(j)
    u = x - float(i)
    j0 = wp.clamp(j, 0, h - 1)
    j1 = wp.clamp(j + 1, 0, h - 1)
    i0 = wp.clamp(i, 0, w - 1)
    i1 = wp.clamp(i + 1, 0, w - 1)
    upper = wp.lerp(levels[level, j0, i0], levels[level, j0, i1], u)
    return wp.lerp(upper, wp.lerp(levels[level, j1, i0], levels[level, j1, i1], u), v)


@wp.kernel
def light_by_beam(
    disparity: wp.array3d(dtype=float),
    reflectance: wp.array3d(dtype=float),
    camera: PairCamera,
    place: float,
    beam: EmitterBeam,
    levels: wp.array3d(dtype=float),
    seen: wp.array3d(dtype=wp.uint64),
    margin: int,
    power: float,
    light: wp.array3d(dtype=wp.vec2),
    lit: wp.array3d(dtype=wp.uint8),
):  # pragma: no cover - compiled
    """Add an emitter's light to a view.

    Args:
        disparity, reflectance: (n, h, w) of the view; disparity 0 is no surface.
        camera: geometry.
        place: place of the view [baselines].
        beam: the emitter.
        levels: (levels, rows, columns) irradiance of 1 W at unit distance [W m^-2].
        seen: (n, h, w + 2 margin) of `see` at the emitter's place.
        margin: columns of `seen` to the left of the image.
        power: of the projector [W].
        light: (n, h, w) radiance of projector and sky [W m^-2 sr^-1]; the first is added to.
        lit: (n, h, w) set to 1 where the emitter's light arrives.
    """
    e, y, x = wp.tid()
    d = disparity[e, y, x]
    if d <= 0.0:
        return
    z = camera.fx * camera.baseline / d
    p = wp.vec3((float(x) - camera.cx) / camera.fx * z, (float(y) - camera.cy) / camera.fy * z, z)
    p = p - beam.origin + wp.vec3(place * camera.baseline, 0.0, 0.0)
    point = wp.transpose(beam.rotation) * p
    nominal = point
    if beam.scale != 1.0:
        nx = point[0] / beam.scale
        ny = point[1] / beam.scale
        nominal = wp.vec3(nx, ny, wp.sqrt(wp.max(wp.length_sq(point) - nx * nx - ny * ny, 0.0)))
    if point[2] < _NEAREST_EMITTER or nominal[2] < _NEAREST_EMITTER:
        return
    slope_x = nominal[0] / nominal[2]
    slope_y = nominal[1] / nominal[2]
    if wp.abs(slope_x) > beam.half[0] or wp.abs(slope_y) > beam.half[1]:
        return
    column = int(wp.floor(float(x) + (place - beam.place) * d + float(margin)))
    i = wp.clamp(column, 0, seen.shape[2] - 2)
    nearest = wp.min(_value(seen[e, y, i]), _value(seen[e, y, i + 1]))
    if nearest > d * _SLACK_SHARE + _SLACK_PX:
        return
    columns = 0.5 * float(levels.shape[2])
    rows = 0.5 * float(levels.shape[1])
    tx = slope_x * columns / beam.half[0] + columns - 0.5
    ty = slope_y * rows / beam.half[1] + rows - 0.5
    count = levels.shape[0]
    irradiance = wp.float32(0.0)
    if count == 1:
        irradiance = _irradiance(levels, 0, ty, tx)
    else:
        blur = beam.width * (1.0 / wp.max(point[2], _FULL_BLUR) - beam.focus)
        variance = 1.0 + blur * blur
        below = wp.floor(wp.log(variance) / beam.log_ratio)
        share = variance * wp.exp(-below * beam.log_ratio) - 1.0
        share = wp.clamp(share / (wp.exp(beam.log_ratio) - 1.0), 0.0, 1.0)
        level = wp.min(below + share, float(count - 1))
        k = wp.min(int(level), count - 2)
        irradiance = wp.lerp(
            _irradiance(levels, k, ty, tx), _irradiance(levels, k + 1, ty, tx), level - float(k)
        )
    irradiance /= point[2] * point[2]
    if beam.scale != 1.0:
        widening = point[2] / nominal[2] * (point[2] / nominal[2]) / beam.scale
        irradiance *= widening * widening
    normal = _normal(disparity, e, y, x, camera)
    facing = wp.abs(wp.dot(normal, p)) / wp.length(normal) / point[2]
    radiance = power * irradiance * facing * reflectance[e, y, x] / wp.PI
    light[e, y, x] += wp.vec2(radiance, 0.0)
    lit[e, y, x] = wp.uint8(1)
