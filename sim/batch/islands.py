"""Kernels that remove small islands of disparity from images (n, h, w).

`starling.sim.stereo.checks.speckle` is the reference.
"""
# pyright: reportInvalidTypeForm=false

from __future__ import annotations

from typing import Any

from starling.sim.batch import handoff
from starling.sim.batch.checks import Limits
from starling.sim.reason import Reason

wp: Any = handoff.import_warp()  # Annotations of kernels are values, not types.

wp.set_module_options({"enable_backward": False})

_SPECKLE = wp.constant(wp.uint8(int(Reason.SPECKLE)))


@wp.func
def _root(island: wp.array(dtype=int), start: int) -> int:  # pragma: no cover - compiled
    i = start
    while island[i] != i:
        i = island[i]
    return i


@wp.func
def _unite(island: wp.array(dtype=int), first: int, second: int):  # pragma: no cover - compiled
    """Unite two islands. The root is the least index in any order of threads.

    Source: Playne and Hawick, IEEE TPDS 29(6), 2018, "A new algorithm for parallel
    connected-component labelling on GPUs".
    """
    a = _root(island, first)
    b = _root(island, second)
    while a != b:
        high = wp.max(a, b)
        low = wp.min(a, b)
        before = wp.atomic_min(island, high, low)
        a = low
        b = low
        if before != high:  # Another thread moved the root meanwhile.
            b = _root(island, before)
            a = _root(island, low)


@wp.kernel
def join_islands(
    accepted: wp.array3d(dtype=float), limits: Limits, island: wp.array(dtype=int)
):  # pragma: no cover - compiled
    """Unite each pixel's island with those of its right and lower neighbours.

    Args:
        accepted: (n, h, w) disparities [px], compared as whole sixteenths.
        limits: thresholds.
        island: (n h w,) of `settle`; each pixel leads to the root of its island.
    """
    e, y, x = wp.tid()
    h = accepted.shape[1]
    w = accepted.shape[2]
    i = (e * h + y) * w + x
    if island[i] < 0:
        return
    fixed = int(accepted[e, y, x] * 16.0)
    if x + 1 < w and island[i + 1] >= 0:
        off = wp.abs(int(accepted[e, y, x + 1] * 16.0) - fixed)
        if float(off) <= limits.step:
            _unite(island, i, i + 1)
    if y + 1 < h and island[i + w] >= 0:
        off = wp.abs(int(accepted[e, y + 1, x] * 16.0) - fixed)
        if float(off) <= limits.step:
            _unite(island, i, i + w)


@wp.kernel
def count_islands(
    island: wp.array(dtype=int), count: wp.array(dtype=int)
):  # pragma: no cover - compiled
    """Count the pixels of each island at its root; `count` (n h w,) is zero before."""
    i = wp.tid()
    if island[i] >= 0:
        wp.atomic_add(count, _root(island, i), 1)


@wp.kernel
def sink_islands(
    island: wp.array(dtype=int),
    count: wp.array(dtype=int),
    limits: Limits,
    accepted: wp.array3d(dtype=float),
    reason: wp.array3d(dtype=wp.uint8),
):  # pragma: no cover - compiled
    """Remove islands of few pixels from `accepted` and `reason` (n, h, w)."""
    e, y, x = wp.tid()
    i = (e * accepted.shape[1] + y) * accepted.shape[2] + x
    if island[i] >= 0 and count[_root(island, i)] <= limits.speckle:
        accepted[e, y, x] = wp.NAN
        reason[e, y, x] = _SPECKLE
