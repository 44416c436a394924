"""Kernels of exposure control: mean light, integration time and gain.

Images have the shape (n, h, w) of n environments. `starling.sim.imaging` explains the models.
"""
# pyright: reportInvalidTypeForm=false

from __future__ import annotations

from typing import Any

from starling.sim.batch import handoff

wp: Any = handoff.import_warp()  # Annotations of kernels are values, not types.

wp.set_module_options({"enable_backward": False})


@wp.kernel
def sum_rows(
    radiance: wp.array3d(dtype=float), part: wp.vec4i, sums: wp.array2d(dtype=wp.float64)
):  # pragma: no cover - compiled
    """Sum rows of images in a fixed order, so that the sum is reproducible.

    Args:
        radiance: (n, h, w).
        part: first row, end of rows, first column and end of columns to sum.
        sums: (n, rows) is filled.
    """
    e, y = wp.tid()
    total = wp.float64(0.0)
    for x in range(part[2], part[3]):
        total += wp.float64(radiance[e, part[0] + y, x])
    sums[e, y] = total


@wp.kernel
def average(
    sums: wp.array2d(dtype=wp.float64), columns: int, means: wp.array(dtype=float)
):  # pragma: no cover - compiled
    """Average each image from the sums (n, h) of its rows."""
    e = wp.tid()
    total = wp.float64(0.0)
    for y in range(sums.shape[1]):
        total += sums[e, y]
    means[e] = float(total / wp.float64(sums.shape[1] * columns))


@wp.kernel
def expose(
    means: wp.array(dtype=float),
    metered: wp.array(dtype=float),
    veil: float,
    aim: float,
    signal: float,
    longest: float,
    gains: wp.vec2,
    exposure: wp.array(dtype=float),
    gain: wp.array(dtype=float),
):  # pragma: no cover - compiled
    """Choose the exposure time [s] and gain of each environment.

    Args:
        means: (n,) mean radiance of the left image [W m^-2 sr^-1].
        metered: (n,) mean radiance of the part that is metered.
        veil: share of the mean light that is spread over the image.
        aim: mean signal to reach [DN].
        signal: per radiance and exposure time [DN / (W m^-2 sr^-1 s)].
        longest: largest exposure time [s].
        gains: the sensor's own gain and the highest, which holds at the longest exposure only.
        exposure: (n,) is filled.
        gain: (n,) is filled.
    """
    e = wp.tid()
    level = wp.lerp(metered[e], means[e], veil)
    wanted = aim / wp.max(level * signal, 1.0e-30)
    exposure[e] = wp.min(wanted, longest)
    gain[e] = gains[0]
    if gains[1] > gains[0]:
        gain[e] = wp.min(gains[0] * wp.max(wanted / longest, 1.0), gains[1])
