"""The gap as pictures: in the camera's frame, the projector's, and by object.

What an imager or lens does stays at its place in the image; what a projector does stays at its
place in the projector's field; what a material does stays on the object.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.scenes.rooms import FEWEST, means
from starling.diagnosis.scenes.strata import FAR_OFF_PX, Ground, Mask
from starling.sim.scene.scene import Scene
from starling.sim.statistics import mean_known

Frame = Literal["camera", "projector"]

CAMERA: Frame = "camera"
PROJECTOR: Frame = "projector"
ROWS, COLUMNS = 18, 32  # Cells of a map.
_FEWEST = 12  # Pixels of a scene in a cell, or on an object.
_FEWEST_CELLS = 30  # That two maps share, to be compared.
FIELD = 1.0  # Tangent of the half field that a projector's map shows to each side.
_RAISED_DN = 1.0  # Added to levels, as black ones have no logarithm.
_UNKNOWN = np.full((ROWS, COLUMNS), np.nan)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Map:
    """Mean over rooms of one quantity's gap in one frame."""

    quantity: str  # "infrared": log ratio of mean levels; "error": [px]; "holes": share.
    frame: Frame
    mean: NDArray[np.float64]  # (rows, columns); NaN where fewer than two rooms reach.
    # Likewise, how far a normal deviate of its chance is off; NaN of too few rooms.
    deviations: NDArray[np.float64]
    # (rooms,) covariance over cells of each room's map with the mean of the others, in the square
    # of the quantity's unit: noise adds nothing to it. NaN where too few cells are known.
    agreement: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True)
class OfBody:
    """The gap on one object of one scene."""

    scene: str
    body: int
    name: str
    material: str
    pixels: int
    infrared: float  # Logarithm of the real mean level over the base's; NaN without infrared.
    holes: float  # Share of real no-depth pixels less the base's.


def maps(
    base: Sequence[Reading],
    real: Sequence[Reading],
    grounds: Sequence[Ground],
    rooms: Sequence[str],
) -> list[Map]:
    """Draw all maps that the readings allow.

    Args:
        base: simulated readings, or other captures of the scenes.
        real: what was captured.
        grounds: of the scenes.
        rooms: likewise.
    """
    found = []
    scenes = list(zip(base, real, grounds, strict=True))
    differences = [_differences(*one) for one in scenes]
    for frame in (CAMERA, PROJECTOR):
        gaps = [
            _by_cell(*one, apart, frame) for one, apart in zip(scenes, differences, strict=True)
        ]
        for quantity in dict.fromkeys(name for gap in gaps for name in gap):
            each = [gap.get(quantity, _UNKNOWN) for gap in gaps]
            found.append(_over_rooms(quantity, frame, means(np.stack(each), rooms)))
    return found


def bodies(
    scenes: Sequence[tuple[str, Scene]],
    base: Sequence[Reading],
    real: Sequence[Reading],
    grounds: Sequence[Ground],
) -> list[OfBody]:
    """Compare object by object, those with most pixels first.

    Args:
        scenes: name of each, and what it is made of.
        base: simulated readings, or other captures of the scenes.
        real: what was captured.
        grounds: of the scenes.
    """
    found = []
    for (scene, made_of), one, other, ground in zip(scenes, base, real, grounds, strict=True):
        known = {number: body for number, body in enumerate(made_of.bodies, 1)}
        holes = _differences(one, other, ground)["holes"]
        for body in np.unique(ground.body[ground.counted]):
            where = ground.counted & (ground.body == body)
            if np.count_nonzero(where) < _FEWEST:
                continue
            found.append(
                OfBody(
                    scene=scene,
                    body=int(body),
                    name=known[body].name if body in known else "",
                    material=known[body].material.name if body in known else "",
                    pixels=int(np.count_nonzero(where)),
                    infrared=_level(one, other, where),
                    holes=float(np.nanmean(holes[where])),
                )
            )
    return sorted(found, key=lambda one: -one.pixels)


def _by_cell(
    base: Reading,
    real: Reading,
    ground: Ground,
    differences: Mapping[str, NDArray[np.float64]],
    frame: Frame,
) -> dict[str, NDArray[np.float64]]:
    """Gap of each quantity, a value a cell; NaN where it is not known."""
    cell = _cells(ground, frame)
    found = {}
    if real.left is not None and base.left is not None:
        level, before = (
            _means(_counted(one[0], ground.counted), cell) for one in (real.left, base.left)
        )
        found["infrared"] = _log_ratio(level, before)
    return found | {name: _means(values, cell) for name, values in differences.items()}


def _level(base: Reading, real: Reading, where: Mask) -> float:
    if real.left is None or base.left is None:
        return float("nan")
    level, before = (one[0][where].mean() for one in (real.left, base.left))
    return float(_log_ratio(level, before))


def _log_ratio(level: NDArray[np.float64], before: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of means: a mean of logarithms would call what has more contrast darker."""
    return np.log((level + _RAISED_DN) / (before + _RAISED_DN))


def _differences(base: Reading, real: Reading, ground: Ground) -> dict[str, NDArray[np.float64]]:
    """Real less base, a value a pixel; NaN where it is not known."""
    found = {}
    before, after = base.depth_px[0].astype(np.float64), real.depth_px[0]
    error = after - before
    near = np.abs(error) <= FAR_OFF_PX
    found["error"] = _counted(np.where(near, error, np.nan), ground.counted)
    change = (~np.isfinite(after)).astype(np.float64) - ~np.isfinite(before)
    found["holes"] = _counted(change, ground.counted)
    return found


def _counted(values: NDArray, counted: Mask) -> NDArray[np.float64]:
    return np.where(counted, values, np.nan)


def _cells(ground: Ground, frame: Frame) -> NDArray[np.int64]:
    """Number of each pixel's cell (h, w); -1 outside."""
    if frame == CAMERA:
        height, width = ground.counted.shape
        row = np.arange(height) * ROWS // height
        column = np.arange(width) * COLUMNS // width
        return row[:, None] * COLUMNS + column[None]
    across, down = (ground.projector[..., axis] / FIELD for axis in (0, 1))
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


def _over_rooms(quantity: str, frame: Frame, each: NDArray[np.float64]) -> Map:
    known = np.isfinite(each)
    count = known.sum(axis=0)
    total = np.where(known, each, 0.0).sum(axis=0)
    mean = np.where(count >= 2, total / np.maximum(count, 1), np.nan)
    square = np.where(known, (each - mean) ** 2, 0.0).sum(axis=0)
    free = np.maximum(count - 1, 1)
    t = mean / np.maximum(np.sqrt(square / free / np.maximum(count, 1)), 1e-9)
    # Few rooms make large t by chance: as far off as a normal deviate of the same chance.
    off = np.sign(t) * stats.norm.isf(np.maximum(stats.t.sf(np.abs(t), free), 1e-300))
    deviations = np.where(count >= FEWEST, off, np.nan)
    return Map(
        quantity=quantity,
        frame=frame,
        mean=mean,
        deviations=deviations,
        agreement=np.array([_agreement(each, room) for room in range(len(each))]),
    )


def _agreement(each: NDArray[np.float64], room: int) -> float:
    one, others = each[room], mean_known(np.delete(each, room, axis=0), axis=0)
    known = np.isfinite(one) & np.isfinite(others)
    if np.count_nonzero(known) < _FEWEST_CELLS:
        return float("nan")
    first, second = (values[known] - values[known].mean() for values in (one, others))
    return float(np.mean(first * second))
