"""Kernels of the image: lens, speckle, exposure, noise and converter.

Images have the shape (n, h, w) of n environments. `starling.sim.imaging` explains the models.
"""
# pyright: reportInvalidTypeForm=false

from __future__ import annotations

from typing import Any

from starling.sim.batch import handoff

wp: Any = handoff.import_warp()  # Annotations of kernels are values, not types.

wp.set_module_options({"enable_backward": False})

_REACH = wp.constant(6.0)  # Range of the quantile table of speckle [standard deviations].


@wp.struct
class Spot:
    """The lens's spot."""

    even: float  # Variance everywhere [px^2].
    corner: float  # Variance per squared distance from the principal point.
    defocus: float  # Sigma per nearness out of focus [px m].
    focus: float  # Nearness in focus [1/m].
    cx: float  # [px]
    cy: float  # [px]
    focal_baseline: float  # [px m]


@wp.struct
class PixelChain:
    """Electronics of one imager."""

    electrons: float  # Per radiance and exposure time [1 / (W m^-2 sr^-1 s)].
    veil: float  # Share of the mean light that is spread over the image.
    crosstalk: float  # Share of a pixel's charge that ends in its four neighbours.
    prnu: float
    dark: float  # Dark current [electrons/s].
    shot: float  # Share of the Poisson deviation.
    read: float  # Read noise [electrons].
    dsnu: float  # [electrons]
    row: float  # Row noise [electrons].
    column: float  # [electrons]
    hot: float  # Share of hot pixels.
    full_well: float  # [electrons]
    conversion: float  # At the sensor's own gain [DN / electron].
    own_gain: float  # The left imager's, which frames of a larger gain are compared with.
    low: float  # Signals that are clipped before smoothing [DN].
    high: float
    gamma: float  # Inverse of the exponent.
    black: float  # [DN]
    ceiling: float  # [DN]
    finer: float  # Codes of the converter per DN.
    matched_ceiling: float  # Largest code of the converter.
    excess: int  # Finest bits of the converter, which the matcher does not read.


@wp.func
def _mirrored(i: int, n: int) -> int:  # pragma: no cover - compiled
    """Index in an image that is mirrored at its border, with the edge repeated."""
    k = i
    while k < 0 or k >= n:
        k = wp.where(k < 0, -1 - k, 2 * n - 1 - k)
    return k


@wp.kernel
def spread_rows(
    light: wp.array3d(dtype=wp.vec2),
    weights: wp.array2d(dtype=float),
    level: int,
    blurred: wp.array4d(dtype=wp.vec2),
):  # pragma: no cover - compiled
    """Blur two lights along rows.

    Args:
        light: (n, h, w) radiance of projector and sky.
        weights: (levels, 2 reach + 1) of the uniform blurs.
        level: the blur.
        blurred: (levels, n, h, w); the level is filled.
    """
    e, y, x = wp.tid()
    w = light.shape[2]
    reach = weights.shape[1] // 2
    total = wp.vec2(0.0, 0.0)
    for k in range(2 * reach + 1):
        total += weights[level, k] * light[e, y, _mirrored(x + k - reach, w)]
    blurred[level, e, y, x] = total


@wp.func
def _column(
    blurred: wp.array4d(dtype=wp.vec2),
    weights: wp.array2d(dtype=float),
    level: int,
    e: int,
    y: int,
    x: int,
) -> wp.vec2:  # pragma: no cover - compiled
    reach = weights.shape[1] // 2
    total = wp.vec2(0.0, 0.0)
    for k in range(2 * reach + 1):
        row = _mirrored(y + k - reach, blurred.shape[2])
        total += weights[level, k] * blurred[level, e, row, x]
    return total


@wp.kernel
def draw_normal(
    seed: int, first: int, normal: wp.array3d(dtype=float)
):  # pragma: no cover - compiled
    """Fill an image (n, h, w) with standard normal deviates of the environments from `first` on."""
    e, y, x = wp.tid()
    h = normal.shape[1]
    w = normal.shape[2]
    state = wp.rand_init(seed, ((first + e) * h + y) * w + x)
    normal[e, y, x] = wp.randn(state)


@wp.func
def _filtered(
    normal: wp.array3d(dtype=float), taps: wp.array(dtype=float), e: int, y: int, x: int
) -> float:  # pragma: no cover - compiled
    """Deviate of a pixel from deviates (n, h + taps - 1, w + taps - 1) of its neighbours."""
    z = wp.float32(0.0)
    for j in range(taps.shape[0]):
        line = wp.float32(0.0)
        for i in range(taps.shape[0]):
            line += taps[i] * normal[e, y + j, x + i]
        z += taps[j] * line
    return z


@wp.func
def _grain(
    normal: wp.array3d(dtype=float),
    taps: wp.array(dtype=float),
    quantiles: wp.array(dtype=float),
    e: int,
    y: int,
    x: int,
) -> float:  # pragma: no cover - compiled
    """Factor of speckle; 1 without quantiles."""
    if quantiles.shape[0] == 0:
        return 1.0
    z = _filtered(normal, taps, e, y, x)
    last = quantiles.shape[0] - 1
    place = (z / _REACH + 1.0) * 0.5 * float(last)
    place = wp.clamp(place, 0.0, float(last - 1))
    k = int(place)
    return wp.lerp(quantiles[k], quantiles[k + 1], place - float(k))


@wp.kernel
def focus(
    blurred: wp.array4d(dtype=wp.vec2),
    disparity: wp.array3d(dtype=float),
    weights: wp.array2d(dtype=float),
    steps: wp.array(dtype=float),
    spot: Spot,
    focused: wp.array3d(dtype=wp.vec2),
):  # pragma: no cover - compiled
    """Blur two lights by the lens's spot.

    Args:
        blurred: (levels, n, h, w) of `spread_rows`.
        disparity: (n, h, w) of the view [px], 0 without a surface.
        weights: (levels, 2 reach + 1) of the uniform blurs.
        steps: (levels,) their variances, ascending [px^2].
        spot: the lens's spot.
        focused: (n, h, w) is filled with the radiance of projector and sky.
    """
    e, y, x = wp.tid()
    inverse = disparity[e, y, x] / spot.focal_baseline
    across = float(x) - spot.cx
    down = float(y) - spot.cy
    off = spot.defocus * (inverse - spot.focus)
    wanted = spot.even + spot.corner * (across * across + down * down) + off * off
    light = wp.vec2(0.0, 0.0)
    count = steps.shape[0]
    i = wp.int32(0)
    while i < count - 2 and wanted > steps[i + 1]:
        i += 1
    light = _column(blurred, weights, i, e, y, x)
    if count > 1:
        share = wp.clamp((wanted - steps[i]) / (steps[i + 1] - steps[i]), 0.0, 1.0)
        light += share * (_column(blurred, weights, i + 1, e, y, x) - light)
    focused[e, y, x] = light


@wp.func
def _shifted(
    focused: wp.array3d(dtype=wp.vec2), shift: float, e: int, y: int, x: int
) -> wp.vec2:  # pragma: no cover - compiled
    """Light that a shift to the right moves to a pixel; see `alignment.misalign`."""
    last = focused.shape[2] - 1
    place = wp.clamp(float(x) - shift, 0.0, float(last))
    first = int(place)
    t = place - float(first)
    left = (t + 2.0) * (t + 1.0)
    right = (t - 2.0) * (t - 3.0)
    middle = t * (t - 1.0)
    total = middle * (t + 1.0) * right / -120.0 * focused[e, y, wp.max(first - 2, 0)]
    total += middle * (t + 2.0) * right / 24.0 * focused[e, y, wp.max(first - 1, 0)]
    total += left * (t - 1.0) * right / -12.0 * focused[e, y, first]
    total += left * t * right / 12.0 * focused[e, y, wp.min(first + 1, last)]
    total += left * middle * (t - 3.0) / -24.0 * focused[e, y, wp.min(first + 2, last)]
    total += left * middle * (t - 2.0) / 120.0 * focused[e, y, wp.min(first + 3, last)]
    return total


@wp.kernel
def form(
    focused: wp.array3d(dtype=wp.vec2),
    shift: wp.array2d(dtype=float),
    normal: wp.array3d(dtype=float),
    taps: wp.array(dtype=float),
    quantiles: wp.array(dtype=float),
    shading: wp.array2d(dtype=wp.vec2),
    radiance: wp.array3d(dtype=float),
):  # pragma: no cover - compiled
    """Form the image on the imager: shift, speckle, vignetting and filter.

    Args:
        focused: (n, h, w) of `focus`.
        shift: (h, w) of the image to the right [px]; () is none.
        normal: (n, h + taps - 1, w + taps - 1) normal deviates of speckle.
        taps: (taps,) filter of the deviates.
        quantiles: gamma variate of deviates from -6 to 6; () without speckle.
        shading: (h, w) transmission of projector and other light.
        radiance: (n, h, w) is filled [W m^-2 sr^-1].
    """
    e, y, x = wp.tid()
    light = focused[e, y, x]
    if shift.shape[0] > 0:
        light = _shifted(focused, shift[y, x], e, y, x)
    laser = light[0] * _grain(normal, taps, quantiles, e, y, x)
    radiance[e, y, x] = laser * shading[y, x][0] + light[1] * shading[y, x][1]


@wp.func
def _electrons(
    radiance: wp.array3d(dtype=float),
    mean: float,
    die: PixelChain,
    scale: float,
    e: int,
    y: int,
    x: int,
) -> float:  # pragma: no cover - compiled
    """Mean photoelectrons of a pixel, with the border repeated."""
    j = wp.clamp(y, 0, radiance.shape[1] - 1)
    i = wp.clamp(x, 0, radiance.shape[2] - 1)
    return scale * wp.lerp(radiance[e, j, i], mean, die.veil)


@wp.kernel
def collect(
    radiance: wp.array3d(dtype=float),
    means: wp.array(dtype=float),
    exposure: wp.array(dtype=float),
    gain: wp.array(dtype=float),
    die: PixelChain,
    fixed: wp.array2d(dtype=wp.vec4),
    normal: wp.array3d(dtype=float),
    colour: wp.array(dtype=float),
    noise_seed: int,
    row_seed: int,
    first: int,
    signal: wp.array3d(dtype=float),
):  # pragma: no cover - compiled
    """Collect charge with all noise of an imager.

    Args:
        radiance: (n, h, w) [W m^-2 sr^-1].
        means: (n,) mean radiance.
        exposure: (n,) exposure time [s].
        gain: (n,) of the left imager.
        die: the electronics.
        fixed: (h, w) deviates of the device: PRNU, DSNU, column (normal), hot pixels (uniform).
        normal: (n, h + taps - 1, w + taps - 1) deviates of correlated noise; () if it is white.
        colour: (taps,) its filter; () if it is white.
        noise_seed, row_seed: of the frame's shot and read noise, and of its row noise.
        first: number of the first environment.
        signal: (n, h, w) is filled [DN], above the black level.
    """
    e, y, x = wp.tid()
    h = radiance.shape[1]
    w = radiance.shape[2]
    scale = die.electrons * exposure[e]
    charge = _electrons(radiance, means[e], die, scale, e, y, x)
    if die.crosstalk > 0.0:
        near = _electrons(radiance, means[e], die, scale, e, y - 1, x)
        near += _electrons(radiance, means[e], die, scale, e, y + 1, x)
        near += _electrons(radiance, means[e], die, scale, e, y, x - 1)
        near += _electrons(radiance, means[e], die, scale, e, y, x + 1)
        charge += die.crosstalk * (0.25 * near - charge)
    device = fixed[y, x]
    charge = charge * wp.max(1.0 + die.prnu * device[0], 0.0) + die.dark * exposure[e]
    if die.shot > 0.0 or die.read > 0.0:
        state = wp.rand_init(noise_seed, ((first + e) * h + y) * w + x)
        z = wp.randn(state)
        if colour.shape[0] > 0:
            z = _filtered(normal, colour, e, y, x)
        mean = wp.max(charge, 0.0)
        variance = die.shot * die.shot * mean + die.read * die.read
        deviation = wp.sqrt(variance)
        third = die.shot * die.shot * die.shot * mean / 6.0
        bend = third / wp.max(variance * deviation, 1.0e-12)
        charge += deviation * (z + bend * (z * z - 1.0)) / wp.sqrt(1.0 + 2.0 * bend * bend)
    if die.row > 0.0:
        row_state = wp.rand_init(row_seed, (first + e) * h + y)
        charge += die.row * wp.randn(row_state)
    charge += die.dsnu * device[1] + die.column * device[2]
    if device[3] < die.hot:
        charge = wp.max(charge, die.full_well)
    conversion = die.conversion * (gain[e] / die.own_gain)
    signal[e, y, x] = conversion * wp.min(charge, die.full_well)


@wp.kernel
def digitise(
    signal: wp.array3d(dtype=float),
    weights: wp.array(dtype=float),
    die: PixelChain,
    delivered: wp.array3d(dtype=Any),
    matched: wp.array3d(dtype=wp.uint16),
):  # pragma: no cover - compiled
    """Convert a signal [DN] to codes: averaging, gamma, black level, quantisation.

    Args:
        signal: (n, h, w) above the black level [DN].
        weights: (2 reach + 1,) of the device's averaging along each axis.
        die: the electronics.
        delivered: (n, h, w) codes that the device delivers.
        matched: (n, h, w) codes of the matcher, of at most ten bits.
    """
    e, y, x = wp.tid()
    reach = weights.shape[0] // 2
    level = signal[e, y, x]
    if reach > 0:
        level = wp.float32(0.0)
        for j in range(2 * reach + 1):
            row = _mirrored(y + j - reach, signal.shape[1])
            line = wp.float32(0.0)
            for i in range(2 * reach + 1):
                value = signal[e, row, _mirrored(x + i - reach, signal.shape[2])]
                line += weights[i] * wp.clamp(value, die.low, die.high)
            level += weights[j] * line
    if die.gamma != 1.0:
        share = wp.pow(wp.abs(level) / die.ceiling, die.gamma)
        level = wp.sign(level) * die.ceiling * share
    level += die.black
    delivered[e, y, x] = delivered.dtype(int(wp.clamp(wp.rint(level), 0.0, die.ceiling)))
    codes = wp.clamp(wp.rint(level * die.finer), 0.0, die.matched_ceiling)
    matched[e, y, x] = wp.uint16(int(codes) >> die.excess)


for _codes in (wp.uint8, wp.int32):  # Both are compiled together.
    wp.overload(digitise, {"delivered": wp.array3d(dtype=_codes)})
