"""Fit a smooth map of disparity errors of the camera that the lens model does not explain.

The same matcher runs on captured and simulated pairs of a surface. A disparity difference that is
equal in all rooms is a warp of one image against the other. The fit uses medians of cells, which
are robust against noise and object edges.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration import heldout
from starling.calibration.observation import Observation
from starling.calibration.solution import Estimate, Solution
from starling.patterns import errors
from starling.sim.arrays import mean_known
from starling.sim.console import progress
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.matching import match, readable
from starling.sim.stereo.memory import Memory

NAME = "right.alignment.warp_px"
COLUMNS = 32  # Columns of cells; rows follow from square cells.
FEWEST_ROOMS = 2
_KNOWN = 0.2  # Minimum share of a cell's pixels with disparity in both pairs.
_FARTHEST_PX = 1.5  # Larger differences are wrong matches.
_SPREAD = 0.7  # Sigma of the smoothing over cells [cell].
_DIGITS = 4  # Decimals of the written warp.
# Matcher bias depends on the fraction of the disparity, which agrees in the second round.
_ROUNDS = 2
_OPEN = (
    "Which imager is warped cannot be determined: the right imager takes the whole warp, including "
    "errors of the reference that are equal in all rooms."
)

Cells = NDArray[np.float64]


def fit_warp(
    observations: Sequence[Observation],
    sensor: Sensor,
    *,
    track: progress.Progress = progress.silent,
) -> Solution:
    """Fit the right image's warp to the disparities of captured pairs.

    Args:
        observations: observations of at least two rooms, with reflectance in detail.
        sensor: sensor with all other geometry calibrated.
        track: progress callback around the simulations.

    Returns:
        The sensor with the warp. The estimate is the warp's root mean square over the image, with
        the root mean square of its standard error over rooms.

    Raises:
        InputError: if there are too few rooms with pairs and surfaces.
    """
    usable = [
        observation
        for observation in observations
        if observation.right is not None and observation.scene is not None
    ]
    rooms = list(dict.fromkeys(observation.room for observation in usable))
    if len(rooms) < FEWEST_ROOMS:
        raise errors.refuse(
            "captures",
            f"must hold infrared pairs of {FEWEST_ROOMS} rooms for the warp",
            len(rooms),
            "Capture another room, or leave out warp.",
        )
    memory = Memory(most=len(usable))
    fitted, room_cells = sensor, np.empty(0)
    for number in range(1, _ROUNDS + 1):
        differences = [
            (observation.room, difference(observation, fitted, memory=memory))
            for observation in track(usable, f"warp, round {number} of {_ROUNDS}")
        ]
        room_cells = np.stack(
            [
                mean_known(
                    np.stack([cells for cell_room, cells in differences if cell_room == room]), 0
                )
                for room in rooms
            ]
        )
        fitted = _with_warp(
            fitted, _cells(fitted, room_cells.shape[1:]) - _smooth_rooms(room_cells)
        )
    known = np.isfinite(room_cells).sum(axis=0)
    counted = known >= FEWEST_ROOMS
    spread = np.nanstd(room_cells[:, counted], axis=0, ddof=1) / np.sqrt(known[counted])
    initial_px, fitted_px = (
        _rms(_cells(observation, known.shape)) for observation in (sensor, fitted)
    )
    estimate = Estimate(name=NAME, value=fitted_px, sd=_rms(spread), unit="px", start=initial_px)
    return Solution(
        estimates=(estimate,),
        covariance=np.array([[estimate.sd**2]]),
        undetermined=(_OPEN,),
        cost=(),
        sensor=fitted,
    )


def difference(observation: Observation, sensor: Sensor, *, memory: Memory | None = None) -> Cells:
    """Compute captured minus simulated disparity [px].

    Args:
        observation: scene with a pair and a surface, with reflectance in detail.
        sensor: sensor of the simulation.
        memory: cache of matched captured pairs.

    Returns:
        (rows, COLUMNS) medians of cells of the right image, NaN with too few pixels.
    """
    assert observation.left is not None and observation.right is not None
    scale = sensor.projector.pattern_scale
    simulated, _ = heldout.simulate(observation.stage, sensor, scale)
    captured = _match_pair(observation.left, observation.right, sensor, memory)
    expected = _match_pair(simulated["left"], simulated["right"], sensor)
    difference_px = captured - expected
    difference_px[np.abs(difference_px) > _FARTHEST_PX] = np.nan
    return _medians(difference_px, expected)


def _match_pair(
    left: NDArray, right: NDArray, sensor: Sensor, memory: Memory | None = None
) -> NDArray[np.float32]:
    ceiling = sensor.left.ceiling_dn
    kind = np.uint8 if ceiling <= np.iinfo(np.uint8).max else np.uint16
    bits = int(ceiling).bit_length()
    first, second = (
        readable(np.clip(np.rint(image), 0, ceiling).astype(kind), bits) for image in (left, right)
    )
    return match(first, second, sensor.matcher, memory=memory).disparity_px


def _medians(values: NDArray[np.float32], disparity_px: NDArray[np.float32]) -> Cells:
    """Return medians over cells of the right image, at the matched columns."""
    height, width = values.shape
    rows = max(1, round(COLUMNS * height / width))
    row, column = np.nonzero(np.isfinite(values))
    right_column = column - disparity_px[row, column]
    inside = (right_column > -0.5) & (right_column < width - 0.5)
    row, right_column, known = row[inside], right_column[inside], values[row, column][inside]
    cell = row * rows // height * COLUMNS + ((right_column + 0.5) * COLUMNS / width).astype(int)
    order = np.argsort(cell, kind="stable")
    ends = np.searchsorted(cell[order], np.arange(rows * COLUMNS + 1))
    least = _KNOWN * height * width / (rows * COLUMNS)
    medians = np.full(rows * COLUMNS, np.nan)
    for number, (first, end) in enumerate(itertools.pairwise(ends)):
        if end - first >= max(1, least):
            medians[number] = np.median(known[order[first:end]])
    return medians.reshape(rows, COLUMNS)


def _smooth_rooms(room_cells: Cells) -> Cells:
    """Smooth the mean over rooms; cells with too few rooms take the value of their neighbours."""
    known = np.isfinite(room_cells).sum(axis=0)
    weight = np.where(known >= FEWEST_ROOMS, known, 0).astype(float)
    mean = np.where(weight > 0, np.nan_to_num(mean_known(room_cells, 0)), 0.0)
    weighted, total = (
        cv2.GaussianBlur(values, (0, 0), _SPREAD, borderType=cv2.BORDER_CONSTANT)
        for values in (mean * weight, weight)
    )
    return np.where(total > 0, weighted / np.where(total > 0, total, 1.0), 0.0)


def _with_warp(sensor: Sensor, cells: Cells) -> Sensor:
    warp = tuple(tuple(map(float, row)) for row in np.round(cells, _DIGITS))
    aligned = dataclasses.replace(sensor.right.alignment, warp_px=warp)
    return dataclasses.replace(sensor, right=dataclasses.replace(sensor.right, alignment=aligned))


def _cells(sensor: Sensor, shape: tuple[int, ...]) -> Cells:
    """Resample the sensor's current warp to a shape of cells."""
    warp = sensor.right.alignment.warp_px
    if not warp:
        return np.zeros(shape)
    resized = cv2.resize(np.array(warp), shape[::-1], interpolation=cv2.INTER_CUBIC)
    return resized.astype(np.float64)


def _rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("inf")
