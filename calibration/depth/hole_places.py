"""How two depth readings of one scene compare: holes by place, and the scatter of disparity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.depth.depth_twin import DepthTwin
from starling.sim import metrics
from starling.sim.geometry.pinhole import Pinhole

Array = NDArray[np.float32]
Column = NDArray[np.float64]
Mask = NDArray[np.bool_]

_EDGE_REACH_PX = 4  # Round depth edges: a matcher's own free pixels, and the reference's doubt.
_GRAZING = 0.4  # Cosine of the angle of view below which a surface counts as slanted.
_MEAN_PX = 41  # Errors that vary more slowly are no scatter.
_GROSS_PX = 2.0  # A wrong match, not scatter.
_GROUPS = 12  # Of the jackknife.
_TILE_PX = 64
_RATE_TOLERANCE = 0.1  # Of a rate: a simulation is not asked for more.
_RARE = 0.002  # Rates of this size and below are alike.
_SCATTER_TOLERANCE = 0.03  # Of the scatter.

PLACES = ("hidden", "edge", "slanted", "far", "near")  # Each pixel is in the first that holds.
SCATTERS = ("far", "near")  # Places where disparity's scatter is compared.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Compared:
    """What of a scene is compared, and where; masks (h, w), which do not overlap."""

    twin: DepthTwin
    places: dict[str, Mask]  # Known truth, right of the left band.
    counted: Mask  # Where disparity is compared: away from edges, with depth in the device.
    error_px: Array  # (h, w) of the device, less its mean over 41 px; NaN where not counted.
    group: NDArray[np.intp]  # (h, w) number of the jackknife's group; tiles share one.


def compared(twins: Sequence[DepthTwin]) -> tuple[Compared, ...]:
    """Say of every pixel which place it belongs to; far is beyond the scenes' median depth."""
    reached = [metrics.reached_pixels(twin.truth_px) for twin in twins]
    known = np.concatenate(
        [twin.truth_px[where] for twin, where in zip(twins, reached, strict=True)]
    )
    middle_px = float(np.median(known)) if known.size else 0.0
    return tuple(
        _compared(twin, where, middle_px, number)
        for number, (twin, where) in enumerate(zip(twins, reached, strict=True))
    )


def difference(
    scenes: Sequence[Compared], readings: Sequence[Array], *, without: int = -1
) -> Column:
    """Simulated readings less the device's, over all scenes together.

    Args:
        scenes: as `compared` made them.
        readings: disparity (h, w) [px] of each, NaN = no depth.
        without: number of the jackknife's group that is left out.

    Returns:
        (7,) differences of hole rates by `PLACES`, then ln of the scatters' ratio by `SCATTERS`;
        0 where a place has no pixel.
    """
    kept = [scene.group != without for scene in scenes]
    errors = [_error(scene, reading) for scene, reading in zip(scenes, readings, strict=True)]
    values = []
    for place in PLACES:
        excess, count = 0, 0
        for scene, reading, keep in zip(scenes, readings, kept, strict=True):
            where = scene.places[place] & keep
            device = np.count_nonzero(~np.isfinite(scene.twin.device_px[where]))
            excess += np.count_nonzero(~np.isfinite(reading[where])) - device
            count += np.count_nonzero(where)
        values.append(excess / max(count, 1))
    for place in SCATTERS:
        real, ours = [], []
        for scene, error, keep in zip(scenes, errors, kept, strict=True):
            where = scene.places[place] & keep & np.isfinite(scene.error_px) & np.isfinite(error)
            real.append(scene.error_px[where])
            ours.append(error[where])
        values.append(_log_ratio(np.concatenate(ours), np.concatenate(real)))
    return np.array(values)


def tolerance(scenes: Sequence[Compared], readings: Sequence[Array]) -> Column:
    """Standard deviation (7,) that a `difference` is granted: by chance, and for being a model.

    Chance is estimated by a grouped jackknife: each of 12 groups of 64 px tiles is left out once.
    Beside it a model may be 10 % off in a rate, and 3 % in the scatter.
    Source: Kunsch 1989, Annals of Statistics 17(3), blocks for dependent data.
    """
    rows = np.array([difference(scenes, readings, without=group) for group in range(_GROUPS)])
    chance = (_GROUPS - 1) / _GROUPS * ((rows - rows.mean(axis=0)) ** 2).sum(axis=0)
    asked = []
    for place in PLACES:
        where = [(scene.twin.device_px, scene.places[place]) for scene in scenes]
        holes = sum(np.count_nonzero(~np.isfinite(device[mask])) for device, mask in where)
        count = sum(np.count_nonzero(mask) for _, mask in where)
        asked.append(_RATE_TOLERANCE * max(holes / max(count, 1), _RARE))
    asked += [_SCATTER_TOLERANCE] * len(SCATTERS)
    return np.sqrt(np.array(asked) ** 2 + chance)


def rates(scene: Compared, reading: Array) -> dict[str, float]:
    """Share of a reading's pixels without depth by place, 0 ... 1; NaN for an empty place."""
    hole = ~np.isfinite(reading)
    return {
        place: float(hole[where].mean()) if where.any() else float("nan")
        for place, where in scene.places.items()
    }


def scatter_px(scene: Compared, reading: Array) -> float:
    """1.4826 x median absolute error of disparity about its mean over 41 px [px]."""
    error = _error(scene, reading)
    known = error[np.isfinite(error)]
    return _nmad(known) if known.size else float("nan")


def _compared(twin: DepthTwin, reached: Mask, middle_px: float, number: int) -> Compared:
    truth, seen = twin.truth_px, twin.layers.truth
    edge = _grown(metrics.depth_edges(truth), _EDGE_REACH_PX)
    pinhole = Pinhole.of(twin.info)
    v, u = np.mgrid[0 : truth.shape[0], 0 : truth.shape[1]].astype(np.float32)
    ray = np.stack(
        [(u - pinhole.cx_px) / pinhole.fx_px, (v - pinhole.cy_px) / pinhole.fy_px, np.ones_like(u)],
        axis=-1,
    )
    cosine = np.abs((seen.normal * ray).sum(-1)) / np.linalg.norm(ray, axis=-1)
    with np.errstate(invalid="ignore"):
        kinds = {
            "hidden": ~(seen.right_sees & seen.lit),
            "edge": edge,
            "slanted": cosine < _GRAZING,
            "far": truth < middle_px,
            "near": truth >= middle_px,
        }
    left = reached.copy()
    places = {}
    for place in PLACES:
        places[place] = left & kinds[place]
        left &= ~places[place]
    rng = np.random.default_rng(number)
    height, width = truth.shape
    shape = (-(-height // _TILE_PX), -(-width // _TILE_PX))
    tiles = rng.permutation(shape[0] * shape[1]).reshape(shape) % _GROUPS
    group = np.kron(tiles, np.ones((_TILE_PX, _TILE_PX), np.intp))[:height, :width]
    counted = twin.beside(truth).counted()
    return Compared(
        twin=twin,
        places=places,
        counted=counted,
        error_px=_local(twin.device_px - truth, counted),
        group=group,
    )


def _log_ratio(ours: Array, real: Array) -> float:
    if real.size == 0:
        return 0.0
    return float(np.log(max(_nmad(ours), 1e-6) / max(_nmad(real), 1e-6)))


def _error(scene: Compared, reading: Array) -> Array:
    return _local(reading - scene.twin.truth_px, scene.counted)


def _local(error: Array, counted: Mask) -> Array:
    """Error of disparity less its mean over 41 px, NaN where it is not counted or gross."""
    with np.errstate(invalid="ignore"):
        known = counted & (np.abs(error) < _GROSS_PX)
    window = (_MEAN_PX, _MEAN_PX)
    total = cv2.blur(np.where(known, error, np.float32(0)), window)
    share = cv2.blur(known.astype(np.float32), window)
    return np.where(known, error - total / np.maximum(share, np.float32(1e-6)), np.float32(np.nan))


def _grown(mask: Mask, reach: int) -> Mask:
    side = 2 * reach + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)).astype(bool)


def _nmad(values: Array) -> float:
    return metrics.MAD_TO_SIGMA * float(np.median(np.abs(values - np.median(values))))
