"""Figures of a depth reading beside the truth and the device, before and after a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from starling.calibration.depth import hole_places
from starling.calibration.depth.depth_twin import DepthTwin
from starling.calibration.depth.hole_places import Compared
from starling.sim import metrics
from starling.sim.sensor.sensor import Sensor

Array = NDArray[np.float32]
Figures = Mapping[str, float]


def figures(scene: Compared, reading: Array) -> dict[str, float]:
    """Say how a reading of a scene compares with its truth and the device's holes.

    Returns:
        `bias_px`, `nmad_px` (see `starling.sim.metrics.DisparityFigures`) away from edges, `scatter_px`
        (of what varies within 41 px), `ndp_rate` and `ndp_iou` right of the left band, and
        `ndp_PLACE`, the rate by place.
    """
    truth, device = scene.twin.truth_px, scene.twin.device_px
    reached = metrics.reached_pixels(truth)
    error = (reading - truth)[scene.counted & np.isfinite(reading)]
    bias = float(np.median(error)) if error.size else float("nan")
    return {
        "bias_px": bias,
        "nmad_px": metrics.MAD_TO_SIGMA * float(np.median(np.abs(error - bias)))
        if error.size
        else float("nan"),
        "scatter_px": hole_places.scatter_px(scene, reading),
        "ndp_rate": float((~np.isfinite(reading[reached])).mean()),
        "ndp_iou": metrics.hole_overlap(reading, device, reached),
        **{f"ndp_{place}": rate for place, rate in hole_places.rates(scene, reading).items()},
    }


def side_by_side(twins: Sequence[DepthTwin], before: Sensor, after: Sensor) -> dict[str, Figures]:
    """Figures of the device and of two sensors' readings, scene by scene.

    Returns:
        By scene, `figures` with `_device`, `_before` or `_after` behind each name.
    """
    first = hole_places.compared([one.rendered(before) for one in twins])
    last = hole_places.compared([one.rendered(after) for one in twins])
    rows: dict[str, Figures] = {}
    for one, other in zip(first, last, strict=True):
        readings = {
            "device": (one, one.twin.device_px),
            "before": (one, one.twin.reading(before)),
            "after": (other, other.twin.reading(after)),
        }
        rows[one.twin.name] = {
            f"{name}_{label}": value
            for label, (scene, reading) in readings.items()
            for name, value in figures(scene, reading).items()
        }
    return rows
