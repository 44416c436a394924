"""Compare a depth reading with the reference and the device, before and after a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from starling.calibration.depth import hole_places
from starling.calibration.depth.depth_twin import DepthTwin
from starling.calibration.depth.hole_places import ComparedScene
from starling.sim import metrics
from starling.sim.sensor.sensor import Sensor

Array = NDArray[np.float32]
Figures = Mapping[str, float]


def figures(scene: ComparedScene, reading: Array) -> dict[str, float]:
    """Compare a reading of a scene with the reference and with the device's missing depth.

    Returns:
        - `bias_px`, `nmad_px` away from edges (see `starling.sim.metrics.DisparityFigures`).
        - `scatter_px`: scatter about the mean over 41 px.
        - `ndp_rate`, `ndp_iou`: rate and overlap of no-depth pixels, right of the left band.
        - `ndp_PLACE`: rate of no-depth pixels by place.
    """
    truth, device = scene.twin.truth_px, scene.twin.device_px
    measurable = metrics.reached_pixels(truth)
    error = (reading - truth)[scene.counted & np.isfinite(reading)]
    bias = float(np.median(error)) if error.size else float("nan")
    return {
        "bias_px": bias,
        "nmad_px": metrics.MAD_TO_SIGMA * float(np.median(np.abs(error - bias)))
        if error.size
        else float("nan"),
        "scatter_px": hole_places.scatter_px(scene, reading),
        "ndp_rate": float((~np.isfinite(reading[measurable])).mean()),
        "ndp_iou": metrics.hole_overlap(reading, device, measurable),
        **{f"ndp_{place}": rate for place, rate in hole_places.rates(scene, reading).items()},
    }


def compare_readings(
    twins: Sequence[DepthTwin], before: Sensor, after: Sensor
) -> dict[str, Figures]:
    """Compute figures of the device's and of two sensors' readings by scene.

    Returns:
        By scene, `figures` with the suffix `_device`, `_before` or `_after` on each name.
    """
    before_scenes = hole_places.classify([depth_twin.rendered(before) for depth_twin in twins])
    after_scenes = hole_places.classify([depth_twin.rendered(after) for depth_twin in twins])
    rows: dict[str, Figures] = {}
    for scene_before, scene_after in zip(before_scenes, after_scenes, strict=True):
        readings = {
            "device": (scene_before, scene_before.twin.device_px),
            "before": (scene_before, scene_before.twin.reading(before)),
            "after": (scene_after, scene_after.twin.reading(after)),
        }
        rows[scene_before.twin.name] = {
            f"{name}_{label}": value
            for label, (scene, reading) in readings.items()
            for name, value in figures(scene, reading).items()
        }
    return rows
