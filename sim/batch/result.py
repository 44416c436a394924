"""Kernel of the result: triangulation, range, and the first cause of each missing pixel.

Images have the shape (n, h, w). `starling.sim.causes` explains the causes.
"""
# pyright: reportInvalidTypeForm=false

from __future__ import annotations

from typing import Any

from starling.sim import causes
from starling.sim.batch import handoff
from starling.sim.reason import Reason
from starling.sim.warp.kernels import SLACK_PX, SLACK_SHARE

wp: Any = handoff.import_warp()  # Annotations of kernels are values, not types.

wp.set_module_options({"enable_backward": False})

_SLACK_SHARE = wp.constant(float(SLACK_SHARE))
_SLACK_PX = wp.constant(float(SLACK_PX))
_WINDOW = wp.constant(causes.WINDOW_PX)
_DARK_SNR = wp.constant(causes.DARK_SNR)
_BURNT_SHARE = wp.constant(causes.BURNT_SHARE)
_FIRST_COLUMN = wp.constant(causes.FIRST_COLUMN_PX)
_NO_SURFACE = wp.constant(wp.uint8(int(Reason.NO_SURFACE)))
_OUTSIDE = wp.constant(wp.uint8(int(Reason.OUTSIDE_OVERLAP)))
_OCCLUDED = wp.constant(wp.uint8(int(Reason.OCCLUDED)))
_SHADOWED = wp.constant(wp.uint8(int(Reason.SHADOWED)))
_LOW_SIGNAL = wp.constant(wp.uint8(int(Reason.LOW_SIGNAL)))
_SATURATED = wp.constant(wp.uint8(int(Reason.SATURATED)))
_OUT_OF_RANGE = wp.constant(wp.uint8(int(Reason.OUT_OF_RANGE)))
_NONE = wp.constant(wp.uint8(255))


@wp.struct
class Triangulation:
    """Numbers of triangulation and of the causes."""

    focal_baseline: float  # Nominal [px m].
    nearest: float  # Accepted depth [m].
    farthest: float  # [m]
    power: float  # Of the projector [W].
    electrons: float  # Per radiance and exposure time.
    dark: float  # Dark current [electrons/s].
    shot: float  # Variance of shot noise per electron.
    steady: float  # Variance of other noise [electrons^2].
    step: float  # Variance of the converter's step at the sensor's own gain [electrons^2].
    own_gain: float  # Of the left imager.
    saturation: float  # Code of a full pixel.


@wp.func
def _right_sees(
    disparity: wp.array3d(dtype=float), right: wp.array3d(dtype=float), e: int, y: int, x: int
) -> bool:  # pragma: no cover - compiled
    """Whether the right imager sees a surface of the left view."""
    d = disparity[e, y, x]
    w = right.shape[2]
    i = int(wp.floor(float(x) - d + 0.5))
    if i < 0 or i >= w:
        return False
    nearest = wp.min(right[e, y, wp.max(i - 1, 0)], right[e, y, i])
    nearest = wp.min(nearest, right[e, y, wp.min(i + 1, w - 1)])
    return nearest <= d * _SLACK_SHARE + _SLACK_PX


@wp.func
def _light_cause(
    radiance: wp.array3d(dtype=float),
    delivered: wp.array3d(dtype=Any),
    exposure: float,
    gain: float,
    outcome: Triangulation,
    e: int,
    y: int,
    x: int,
) -> wp.uint8:  # pragma: no cover - compiled
    """Too little signal or saturation in the window, or neither."""
    h = radiance.shape[1]
    w = radiance.shape[2]
    total = wp.float32(0.0)
    burnt = wp.int32(0)
    for j in range(_WINDOW):
        for i in range(_WINDOW):
            row = wp.abs(y + j - _WINDOW // 2)
            column = wp.abs(x + i - _WINDOW // 2)
            if row >= h:
                row = 2 * h - 2 - row
            if column >= w:
                column = 2 * w - 2 - column
            total += radiance[e, row, column]
            if float(delivered[e, row, column]) >= outcome.saturation:
                burnt += 1
    count = float(_WINDOW * _WINDOW)
    mean = total / count * outcome.electrons * exposure
    share = outcome.own_gain / gain
    steady = outcome.steady + outcome.step * share * share
    noise = wp.sqrt(outcome.shot * (wp.max(mean, 0.0) + outcome.dark * exposure) + steady)
    if mean < _DARK_SNR * noise:
        return _LOW_SIGNAL
    if float(burnt) / count > _BURNT_SHARE:
        return _SATURATED
    return _NONE


@wp.kernel
def conclude(
    accepted: wp.array3d(dtype=float),
    disparity: wp.array3d(dtype=float),
    right: wp.array3d(dtype=float),
    lit: wp.array3d(dtype=wp.uint8),
    radiance: wp.array3d(dtype=float),
    delivered: wp.array3d(dtype=Any),
    exposure: wp.array(dtype=float),
    gain: wp.array(dtype=float),
    outcome: Triangulation,
    depth: wp.array3d(dtype=float),
    reason: wp.array3d(dtype=wp.uint8),
):  # pragma: no cover - compiled
    """Triangulate, limit the range, and give each missing pixel its first cause.

    Args:
        accepted: (n, h, w) disparities of the matcher [px], NaN without disparity.
        disparity, right: (n, h, w) true disparities of both views [px], 0 without a surface.
        lit: (n, h, w) of `light_by_beam`.
        radiance: (n, h, w) of the left image.
        delivered: (n, h, w) codes of the left image.
        exposure: (n,) exposure time [s].
        gain: (n,) of the left imager.
        outcome: numbers.
        depth: (n, h, w) is filled [m], NaN without depth.
        reason: (n, h, w) codes of the matcher before, of all causes after.
    """
    e, y, x = wp.tid()
    z = float(wp.NAN)
    value = accepted[e, y, x]
    if value > 0.0:
        z = outcome.focal_baseline / value
    code = reason[e, y, x]
    if code == wp.uint8(0) and not (z >= outcome.nearest and z <= outcome.farthest):
        z = wp.NAN
        code = _OUT_OF_RANGE
    depth[e, y, x] = z
    if code != wp.uint8(0):
        true = disparity[e, y, x]
        cause = _light_cause(radiance, delivered, exposure[e], gain[e], outcome, e, y, x)
        if lit[e, y, x] == wp.uint8(0) and outcome.power > 0.0:
            cause = _SHADOWED
        if true <= 0.0:
            cause = _NO_SURFACE
        elif float(x) - true < _FIRST_COLUMN:
            cause = _OUTSIDE
        elif not _right_sees(disparity, right, e, y, x):
            cause = _OCCLUDED
        if cause != _NONE:
            code = cause
    reason[e, y, x] = code


for _codes in (wp.uint8, wp.int32):  # Both are compiled together.
    wp.overload(conclude, {"delivered": wp.array3d(dtype=_codes)})
