"""Maps of the gap in the camera frame and the projector frame, and the gap by object.

Effects of imager and lens are fixed in the camera image. Effects of the projector are fixed in the
projector field. Effects of a material stay on the object.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.diagnosis.scenes.observation import SceneObservation, StereoObservation
from starling.diagnosis.scenes.rooms import FEWEST, room_means
from starling.diagnosis.scenes.strata import FAR_OFF_PX, Mask, Strata
from starling.sim.arrays import mean_known
from starling.sim.scene.scene import Scene

Frame = Literal["camera", "projector"]

CAMERA: Frame = "camera"
PROJECTOR: Frame = "projector"
ROWS, COLUMNS = 18, 32  # Cells of a map.
_FEWEST = 12  # Least number of pixels of a scene in a cell, or on an object.
_FEWEST_CELLS = 30  # Least number of common cells for comparing two maps.
FIELD = 1.0  # Tangent of the half angle that a projector map covers to each side.
_RAISED_DN = 1.0  # Added to levels, because a level of zero has no logarithm.
_UNKNOWN = np.full((ROWS, COLUMNS), np.nan)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class GapMap:
    """Gap of one quantity in one frame, mean over rooms."""

    quantity: str  # "infrared": log ratio of mean levels; "error" [px]; "holes": share.
    frame: Frame
    mean: NDArray[np.float64]  # (rows, columns); NaN with fewer than two rooms.
    # (rows, columns) normal deviate of the mean's p-value; NaN with too few rooms.
    deviations: NDArray[np.float64]
    # (rooms,) covariance over cells of each room's map with the mean map of the other rooms, in the
    # squared unit of the quantity. Independent noise does not change its mean. NaN with too few
    # known cells.
    agreement: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True)
class BodyGap:
    """The gap on one object of one scene."""

    scene: str
    body: int
    name: str
    material: str
    pixels: int
    infrared: float  # Log ratio of the real mean level to the base; NaN without infrared.
    holes: float  # Share of no-depth pixels, real minus base.


def gap_maps(
    base: Sequence[SceneObservation],
    real: Sequence[SceneObservation],
    scene_strata: Sequence[Strata],
    rooms: Sequence[str],
) -> list[GapMap]:
    """Compute all maps that the observations allow.

    Args:
        base: simulated observations, or other captures of the scenes.
        real: captured observations.
        scene_strata: pixel strata of each scene.
        rooms: room of each scene.
    """
    maps = []
    by_scene = [_by_frame(*scene) for scene in zip(base, real, scene_strata, strict=True)]
    for frame in (CAMERA, PROJECTOR):
        gaps = [frames[frame] for frames in by_scene]
        for quantity in dict.fromkeys(name for gap in gaps for name in gap):
            each = [gap.get(quantity, _UNKNOWN) for gap in gaps]
            maps.append(_over_rooms(quantity, frame, room_means(np.stack(each), rooms)))
    return maps


def body_gaps(
    scenes: Sequence[tuple[str, Scene]],
    base: Sequence[SceneObservation],
    real: Sequence[SceneObservation],
    scene_strata: Sequence[Strata],
) -> list[BodyGap]:
    """Compare object by object; objects with most pixels come first.

    Args:
        scenes: name and model of each scene.
        base: simulated observations, or other captures of the scenes.
        real: captured observations.
        scene_strata: pixel strata of each scene.
    """
    gaps = []
    for (scene, model), before, after, strata in zip(scenes, base, real, scene_strata, strict=True):
        known = {number: body for number, body in enumerate(model.bodies, 1)}
        holes = _differences(before, after, strata)["holes"]
        for body in np.unique(strata.body[strata.counted]):
            where = strata.counted & (strata.body == body)
            if np.count_nonzero(where) < _FEWEST:
                continue
            gaps.append(
                BodyGap(
                    scene=scene,
                    body=int(body),
                    name=known[body].name if body in known else "",
                    material=known[body].material.name if body in known else "",
                    pixels=int(np.count_nonzero(where)),
                    infrared=_level(before, after, where),
                    holes=float(np.nanmean(holes[where])),
                )
            )
    return sorted(gaps, key=lambda gap: -gap.pixels)


def _by_frame(
    base: SceneObservation, real: SceneObservation, strata: Strata
) -> dict[Frame, dict[str, NDArray[np.float64]]]:
    """Return the gap of each quantity per cell, in each frame."""
    differences = _differences(base, real, strata)
    return {
        frame: _by_cell(base, real, strata, differences, frame) for frame in (CAMERA, PROJECTOR)
    }


def _by_cell(
    base: SceneObservation,
    real: SceneObservation,
    strata: Strata,
    differences: Mapping[str, NDArray[np.float64]],
    frame: Frame,
) -> dict[str, NDArray[np.float64]]:
    """Return the gap of each quantity per cell; NaN if unknown."""
    cell = _cells(strata, frame)
    gaps = {}
    if isinstance(real, StereoObservation) and isinstance(base, StereoObservation):
        level, before = (
            _means(_counted(images[0], strata.counted), cell) for images in (real.left, base.left)
        )
        gaps["infrared"] = _log_ratio(level, before)
    return gaps | {name: _means(values, cell) for name, values in differences.items()}


def _level(base: SceneObservation, real: SceneObservation, where: Mask) -> float:
    if not (isinstance(real, StereoObservation) and isinstance(base, StereoObservation)):
        return float("nan")
    level, before = (images[0][where].mean() for images in (real.left, base.left))
    return float(_log_ratio(level, before))


def _log_ratio(level: NDArray[np.float64], before: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the log ratio of means; a mean of logarithms would depend on contrast."""
    return np.log((level + _RAISED_DN) / (before + _RAISED_DN))


def _differences(
    base: SceneObservation, real: SceneObservation, strata: Strata
) -> dict[str, NDArray[np.float64]]:
    """Return real minus base per pixel; NaN if unknown."""
    differences = {}
    before, after = base.depth_px[0].astype(np.float64), real.depth_px[0]
    error = after - before
    near = np.abs(error) <= FAR_OFF_PX
    differences["error"] = _counted(np.where(near, error, np.nan), strata.counted)
    change = (~np.isfinite(after)).astype(np.float64) - ~np.isfinite(before)
    differences["holes"] = _counted(change, strata.counted)
    return differences


def _counted(values: NDArray, counted: Mask) -> NDArray[np.float64]:
    return np.where(counted, values, np.nan)


def _cells(strata: Strata, frame: Frame) -> NDArray[np.int64]:
    """Return the cell number of each pixel (h, w); -1 outside."""
    if frame == CAMERA:
        height, width = strata.counted.shape
        row = np.arange(height) * ROWS // height
        column = np.arange(width) * COLUMNS // width
        return row[:, None] * COLUMNS + column[None]
    across, down = (strata.projector[..., axis] / FIELD for axis in (0, 1))
    inside = (np.abs(across) < 1) & (np.abs(down) < 1)
    column = np.floor((np.where(inside, across, 0) + 1) / 2 * COLUMNS).astype(np.int64)
    row = np.floor((np.where(inside, down, 0) + 1) / 2 * ROWS).astype(np.int64)
    return np.where(inside, row * COLUMNS + column, -1)


def _means(values: NDArray[np.float64], cell: NDArray[np.int64]) -> NDArray[np.float64]:
    known = np.isfinite(values) & (cell >= 0)
    count = np.bincount(cell[known], minlength=ROWS * COLUMNS)
    total = np.bincount(cell[known], values[known], minlength=ROWS * COLUMNS)
    mean = np.where(count >= _FEWEST, total / np.maximum(count, 1), np.nan)
    return mean.reshape(ROWS, COLUMNS)


def _over_rooms(quantity: str, frame: Frame, each: NDArray[np.float64]) -> GapMap:
    known = np.isfinite(each)
    count = known.sum(axis=0)
    total = np.where(known, each, 0.0).sum(axis=0)
    mean = np.where(count >= 2, total / np.maximum(count, 1), np.nan)
    square = np.where(known, (each - mean) ** 2, 0.0).sum(axis=0)
    free = np.maximum(count - 1, 1)
    t = mean / np.maximum(np.sqrt(square / free / np.maximum(count, 1)), 1e-9)
    # Convert t to a normal deviate of equal p-value: few rooms give large t by chance.
    deviate = np.sign(t) * stats.norm.isf(np.maximum(stats.t.sf(np.abs(t), free), 1e-300))
    deviations = np.where(count >= FEWEST, deviate, np.nan)
    return GapMap(
        quantity=quantity,
        frame=frame,
        mean=mean,
        deviations=deviations,
        agreement=np.array([_agreement(each, room) for room in range(len(each))]),
    )


def _agreement(each: NDArray[np.float64], room: int) -> float:
    own_map, mean_map = each[room], mean_known(np.delete(each, room, axis=0), axis=0)
    known = np.isfinite(own_map) & np.isfinite(mean_map)
    if np.count_nonzero(known) < _FEWEST_CELLS:
        return float("nan")
    first, second = (values[known] - values[known].mean() for values in (own_map, mean_map))
    return float(np.mean(first * second))
