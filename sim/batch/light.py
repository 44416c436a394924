"""Kernels of the light: reflectance, and radiance of both views.

Images have the shape (n, h, w) of n environments. The numba kernels of `starling.sim.warp` are the
reference; here every pixel is a thread.
"""
# pyright: reportInvalidTypeForm=false

from __future__ import annotations

from typing import Any

from starling.sim.batch import handoff
from starling.sim.batch.views import seen_disparity
from starling.sim.render.emission import NEAREST_M
from starling.sim.render.skylight import MATT_TILT
from starling.sim.scene.colours import DARKEST, RISE
from starling.sim.scene.visible import LUMINANCE
from starling.sim.warp.kernels import NEAREST_EMITTER_M, SLACK_PX, SLACK_SHARE

wp: Any = handoff.import_warp()  # Annotations of kernels are values, not types.

wp.set_module_options({"enable_backward": False})

_NEAREST_EMITTER = wp.constant(float(NEAREST_EMITTER_M))
_FULL_BLUR = wp.constant(NEAREST_M)
_SLACK_SHARE = wp.constant(float(SLACK_SHARE))
_SLACK_PX = wp.constant(float(SLACK_PX))
_TILT = wp.constant(MATT_TILT)
_DARKEST = wp.constant(DARKEST)
_RISE = wp.constant(RISE)
_RED, _GREEN, _BLUE = (wp.constant(float(share)) for share in LUMINANCE)


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


@wp.func
def _linear(byte: wp.uint8) -> float:  # pragma: no cover - compiled
    """Linear light of an sRGB byte (IEC 61966-2-1)."""
    share = float(byte) / 255.0
    linear = share / 12.92
    if share > 0.04045:
        linear = wp.pow((share + 0.055) / 1.055, 2.4)
    return linear


@wp.kernel
def fill_reflectance(
    bytes: wp.array4d(dtype=wp.uint8), visible: bool, reflectance: wp.array3d(dtype=float)
):  # pragma: no cover - compiled
    """Estimate the reflectance from RGB bytes (n, h, w, 3); see `depth_input`."""
    e, y, x = wp.tid()
    red = _linear(bytes[e, y, x, 0])
    green = _linear(bytes[e, y, x, 1])
    blue = _linear(bytes[e, y, x, 2])
    if visible:
        reflectance[e, y, x] = _RED * red + _GREEN * green + _BLUE * blue
    else:
        reflectance[e, y, x] = _DARKEST + _RISE * wp.max(wp.max(red, green), blue)


@wp.kernel
def scale(
    values: wp.array(dtype=float), factor: float, scaled: wp.array(dtype=float)
):  # pragma: no cover - compiled
    """Multiply (n,) values by a factor."""
    e = wp.tid()
    scaled[e] = values[e] * factor


@wp.kernel
def scale_reflectance(
    share: wp.array3d(dtype=float), scale: float, reflectance: wp.array3d(dtype=float)
):  # pragma: no cover - compiled
    """Multiply reflectances by a scale, within 0 to 1; NaN counts as 0."""
    e, y, x = wp.tid()
    reflectance[e, y, x] = wp.clamp(share[e, y, x] * scale, 0.0, 1.0)


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
    irradiance: wp.array(dtype=float),
    gradient: float,
    up: wp.array2d(dtype=float),
    light: wp.array3d(dtype=wp.vec2),
):  # pragma: no cover - compiled
    """Set the light of a view to that of the sky.

    Args:
        disparity, reflectance: (n, h, w) of the view.
        camera: geometry.
        irradiance: (n,) of the sky [W m^-2].
        gradient: of the sky; see `Ambient`.
        up: (n, 3) direction of the zenith, of any length.
        light: (n, h, w) radiance of the projector (0 here) and of the sky [W m^-2 sr^-1].
    """
    e, y, x = wp.tid()
    value = wp.float32(0.0)
    if disparity[e, y, x] > 0.0:
        value = irradiance[e] * reflectance[e, y, x] / wp.PI
        if gradient != 0.0:
            normal = _normal(disparity, e, y, x, camera)
            zenith = wp.vec3(up[e, 0], up[e, 1], up[e, 2])
            length = wp.length(normal) * wp.length(zenith)
            tilt = -wp.dot(normal, zenith) / wp.max(length, 1.0e-12)
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
    nearest = wp.min(seen_disparity(seen[e, y, i]), seen_disparity(seen[e, y, i + 1]))
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
