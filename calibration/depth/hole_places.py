"""Compare depth readings: missing depth by place, and bias and scatter of disparity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.depth.depth_twin import DepthTwin
from starling.calibration.depth.disparity_scale import nmad
from starling.sim import metrics
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.sensor.sensor import Sensor

Array = NDArray[np.float32]
Column = NDArray[np.float64]
Mask = NDArray[np.bool_]

_EDGE_REACH_PX = 4  # Distance to a depth edge within which matcher and reference are uncertain.
_GRAZING = 0.4  # Cosine of the viewing angle below which a surface counts as slanted.
_MEAN_PX = 41  # Window of the local mean; slower errors do not count as scatter.
_GROSS_PX = 2.0  # Larger errors are wrong matches, not scatter.
_GROUPS = 12  # Groups of the jackknife.
_TILE_PX = 64  # Side of the jackknife's tiles.
_RATE_TOLERANCE = 0.1  # Relative model tolerance of a rate.
_RARE = 0.002  # Lower limit of the rate that the tolerance refers to.
_SCATTER_TOLERANCE = 0.03  # Relative model tolerance of the scatter.

PLACES = ("hidden", "edge", "slanted", "far", "near")  # A pixel belongs to the first that applies.
SCATTERS = ("far", "near")  # Places where the scatter of disparity is compared.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ComparedScene:
    """A scene with its pixels classified by place; the masks (h, w) do not overlap."""

    twin: DepthTwin
    places: dict[str, Mask]  # Pixels with a reference, right of the left band.
    counted: Mask  # Pixels with device depth, away from edges, where disparity is compared.
    error_px: Array  # (h, w) device error minus its mean over 41 px; NaN where not counted.
    group: NDArray[np.intp]  # (h, w) jackknife group, constant in each tile.


def classify(twins: Sequence[DepthTwin]) -> tuple[ComparedScene, ...]:
    """Classify pixels by place; "far" means beyond the scenes' median depth."""
    reached = [metrics.reached_pixels(twin.truth_px) for twin in twins]
    known = np.concatenate(
        [twin.truth_px[where] for twin, where in zip(twins, reached, strict=True)]
    )
    middle_px = float(np.median(known)) if known.size else 0.0
    return tuple(
        _classify_scene(twin, where, middle_px, number)
        for number, (twin, where) in enumerate(zip(twins, reached, strict=True))
    )


def difference(
    scenes: Sequence[ComparedScene], readings: Sequence[Array], *, without: int = -1
) -> Column:
    """Compute simulated minus device statistics, pooled over scenes.

    Args:
        scenes: result of `classify`.
        readings: simulated disparity (h, w) [px] of each scene, NaN = no depth.
        without: jackknife group to leave out; -1 leaves out none.

    Returns:
        (7,) differences of no-depth rates by `PLACES`, then ln of the scatter ratio by `SCATTERS`;
        0 if a place has no pixel.
    """
    masks = [scene.group != without for scene in scenes]
    errors = [_error(scene, reading) for scene, reading in zip(scenes, readings, strict=True)]
    values = []
    for place in PLACES:
        excess, count = 0, 0
        for scene, reading, mask in zip(scenes, readings, masks, strict=True):
            selected = scene.places[place] & mask
            device = np.count_nonzero(~np.isfinite(scene.twin.device_px[selected]))
            excess += np.count_nonzero(~np.isfinite(reading[selected])) - device
            count += np.count_nonzero(selected)
        values.append(excess / max(count, 1))
    for place in SCATTERS:
        device_errors, simulated = [], []
        for scene, error, mask in zip(scenes, errors, masks, strict=True):
            selected = scene.places[place] & mask & np.isfinite(scene.error_px) & np.isfinite(error)
            device_errors.append(scene.error_px[selected])
            simulated.append(error[selected])
        values.append(_log_ratio(np.concatenate(simulated), np.concatenate(device_errors)))
    return np.array(values)


def tolerance(scenes: Sequence[ComparedScene], readings: Sequence[Array]) -> Column:
    """Return the tolerated standard deviation (7,) of a `difference`: sampling and model error.

    The sampling error comes from a grouped jackknife: each of 12 groups of 64 px tiles is left
    out once. The model error is 10 % of a rate, and 3 % of the scatter.
    Source: Kunsch 1989, Annals of Statistics 17(3), blocks for dependent data.
    """
    jackknife = np.array([difference(scenes, readings, without=group) for group in range(_GROUPS)])
    chance = (_GROUPS - 1) / _GROUPS * ((jackknife - jackknife.mean(axis=0)) ** 2).sum(axis=0)
    model_tolerances = []
    for place in PLACES:
        where = [(scene.twin.device_px, scene.places[place]) for scene in scenes]
        holes = sum(np.count_nonzero(~np.isfinite(device[mask])) for device, mask in where)
        count = sum(np.count_nonzero(mask) for _, mask in where)
        model_tolerances.append(_RATE_TOLERANCE * max(holes / max(count, 1), _RARE))
    model_tolerances += [_SCATTER_TOLERANCE] * len(SCATTERS)
    return np.sqrt(np.array(model_tolerances) ** 2 + chance)


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
        "nmad_px": nmad(error) if error.size else float("nan"),
        "scatter_px": scatter_px(scene, reading),
        "ndp_rate": float((~np.isfinite(reading[measurable])).mean()),
        "ndp_iou": metrics.hole_overlap(reading, device, measurable),
        **{f"ndp_{place}": rate for place, rate in rates(scene, reading).items()},
    }


def compare_readings(
    twins: Sequence[DepthTwin], before: Sensor, after: Sensor
) -> dict[str, Mapping[str, float]]:
    """Compute figures of the device's and of two sensors' readings by scene.

    Returns:
        By scene, `figures` with the suffix `_device`, `_before` or `_after` on each name.
    """
    before_scenes = classify([depth_twin.rendered(before) for depth_twin in twins])
    after_scenes = classify([depth_twin.rendered(after) for depth_twin in twins])
    rows: dict[str, Mapping[str, float]] = {}
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


def rates(scene: ComparedScene, reading: Array) -> dict[str, float]:
    """Return the rate of no-depth pixels by place, 0 ... 1; NaN for an empty place."""
    hole = ~np.isfinite(reading)
    return {
        place: float(hole[mask].mean()) if mask.any() else float("nan")
        for place, mask in scene.places.items()
    }


def scatter_px(scene: ComparedScene, reading: Array) -> float:
    """Return 1.4826 x median absolute error of disparity about its mean over 41 px [px]."""
    error = _error(scene, reading)
    known = error[np.isfinite(error)]
    return nmad(known) if known.size else float("nan")


def _classify_scene(twin: DepthTwin, reached: Mask, middle_px: float, number: int) -> ComparedScene:
    truth, rendered = twin.truth_px, twin.layers.truth
    edge = _dilated(metrics.depth_edges(truth), _EDGE_REACH_PX)
    pinhole = Pinhole.from_camera(twin.info)
    v, u = np.mgrid[0 : truth.shape[0], 0 : truth.shape[1]].astype(np.float32)
    ray = np.stack(
        [(u - pinhole.cx_px) / pinhole.fx_px, (v - pinhole.cy_px) / pinhole.fy_px, np.ones_like(u)],
        axis=-1,
    )
    cosine = np.abs((rendered.normal * ray).sum(-1)) / np.linalg.norm(ray, axis=-1)
    with np.errstate(invalid="ignore"):
        kinds = {
            "hidden": ~(rendered.right_sees & rendered.lit),
            "edge": edge,
            "slanted": cosine < _GRAZING,
            "far": truth < middle_px,
            "near": truth >= middle_px,
        }
    unassigned = reached.copy()
    places = {}
    for place in PLACES:
        places[place] = unassigned & kinds[place]
        unassigned &= ~places[place]
    rng = np.random.default_rng(number)
    height, width = truth.shape
    shape = (-(-height // _TILE_PX), -(-width // _TILE_PX))
    tiles = rng.permutation(shape[0] * shape[1]).reshape(shape) % _GROUPS
    group = np.kron(tiles, np.ones((_TILE_PX, _TILE_PX), np.intp))[:height, :width]
    counted = twin.pair_with(truth).counted()
    return ComparedScene(
        twin=twin,
        places=places,
        counted=counted,
        error_px=_local(twin.device_px - truth, counted),
        group=group,
    )


def _log_ratio(simulated: Array, real: Array) -> float:
    if real.size == 0:
        return 0.0
    return float(np.log(max(nmad(simulated), 1e-6) / max(nmad(real), 1e-6)))


def _error(scene: ComparedScene, reading: Array) -> Array:
    return _local(reading - scene.twin.truth_px, scene.counted)


def _local(error: Array, counted: Mask) -> Array:
    """Subtract the mean over 41 px from the disparity error; NaN if not counted or gross."""
    with np.errstate(invalid="ignore"):
        known = counted & (np.abs(error) < _GROSS_PX)
    window = (_MEAN_PX, _MEAN_PX)
    total = cv2.blur(np.where(known, error, np.float32(0)), window)
    share = cv2.blur(known.astype(np.float32), window)
    return np.where(known, error - total / np.maximum(share, np.float32(1e-6)), np.float32(np.nan))


def _dilated(mask: Mask, reach: int) -> Mask:
    side = 2 * reach + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)).astype(bool)
