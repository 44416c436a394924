"""Fit what no lens model holds: a smooth map of disparity errors that stays with the camera.

Captured and simulated pairs of the same surface are matched alike. Where their disparities differ
by the same amount in all rooms, one image is warped against the other. Medians of cells are taken,
so that neither noise nor edges of things count.
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
from starling.sim.sensor.sensor import Sensor
from starling.sim.statistics import mean_known
from starling.sim.stereo.matching import match, readable
from starling.sim.stereo.memory import Memory

NAME = "right.alignment.warp_px"
COLUMNS = 32  # Cells across the image; down as many as make them square.
FEWEST_ROOMS = 2
_KNOWN = 0.2  # Least share of a cell's pixels that both pairs have.
_FARTHEST_PX = 1.5  # Differences beyond are wrong matches.
_SPREAD = 0.7  # Sigma of the smoothing over cells [cell].
_DIGITS = 4
_ROUNDS = (
    2  # A matcher's bias goes with the fraction of a pixel: in the second round both have one.
)
_OPEN = (
    "Which imager is warped is not told: the right one is given all of it, errors of the reference "
    "that are the same in all rooms included."
)

Cells = NDArray[np.float64]


def fit_warp(observations: Sequence[Observation], sensor: Sensor) -> Solution:
    """Fit the right image's warp to the disparities of captured pairs.

    Args:
        observations: of two rooms at least, loaded with `heldout.SMOOTHING_PX`.
        sensor: whose other geometry is right.

    Returns:
        The sensor with the warp, and as estimate its root mean square over the image, with that of
        its deviation over rooms.

    Raises:
        InputError: if there are too few rooms with pairs and surfaces.
    """
    usable = [one for one in observations if one.right is not None and one.scene is not None]
    rooms = list(dict.fromkeys(one.room for one in usable))
    if len(rooms) < FEWEST_ROOMS:
        raise errors.refuse(
            "captures",
            f"must hold infrared pairs of {FEWEST_ROOMS} rooms for the warp",
            len(rooms),
            "Capture another room, or leave out warp.",
        )
    memory = Memory(most=len(usable))
    fitted, of_rooms = sensor, np.empty(0)
    for _ in range(_ROUNDS):
        seen = [(one.room, difference(one, fitted, memory=memory)) for one in usable]
        of_rooms = np.stack(
            [mean_known(np.stack([made for own, made in seen if own == room]), 0) for room in rooms]
        )
        fitted = _with(fitted, _cells(fitted, of_rooms.shape[1:]) - _smoothed(of_rooms))
    known = np.isfinite(of_rooms).sum(axis=0)
    counted = known >= FEWEST_ROOMS
    spread = np.nanstd(of_rooms[:, counted], axis=0, ddof=1) / np.sqrt(known[counted])
    begun, ended = (_rms(_cells(one, known.shape)) for one in (sensor, fitted))
    estimate = Estimate(name=NAME, value=ended, sd=_rms(spread), unit="px", start=begun)
    return Solution(
        estimates=(estimate,),
        covariance=np.array([[estimate.sd**2]]),
        undetermined=(_OPEN,),
        cost=(),
        sensor=fitted,
    )


def difference(observation: Observation, sensor: Sensor, *, memory: Memory | None = None) -> Cells:
    """Disparity of a captured pair less that of the simulated one [px].

    Args:
        observation: with a pair and a surface, loaded with `heldout.SMOOTHING_PX`.
        sensor: that it is simulated with.
        memory: of searches of captured pairs.

    Returns:
        (rows, COLUMNS) medians of cells of the right image, NaN where too little is known.
    """
    assert observation.left is not None and observation.right is not None
    scale = sensor.projector.pattern_scale
    simulated, _ = heldout.simulate(observation.stage, sensor, scale)
    captured = _matched(observation.left, observation.right, sensor, memory)
    expected = _matched(simulated["left"], simulated["right"], sensor)
    apart = captured - expected
    apart[np.abs(apart) > _FARTHEST_PX] = np.nan
    return _medians(apart, expected)


def _matched(
    left: NDArray, right: NDArray, sensor: Sensor, memory: Memory | None = None
) -> NDArray[np.float32]:
    ceiling = sensor.left.ceiling_dn
    kind = np.uint8 if ceiling <= np.iinfo(np.uint8).max else np.uint16
    bits = int(ceiling).bit_length()
    first, second = (
        readable(np.clip(np.rint(one), 0, ceiling).astype(kind), bits) for one in (left, right)
    )
    return match(first, second, sensor.matcher, memory=memory).disparity_px


def _medians(values: NDArray[np.float32], disparity_px: NDArray[np.float32]) -> Cells:
    """Medians over cells of the right image, where a match lies."""
    height, width = values.shape
    rows = max(1, round(COLUMNS * height / width))
    row, column = np.nonzero(np.isfinite(values))
    there = column - disparity_px[row, column]
    inside = (there > -0.5) & (there < width - 0.5)
    row, there, known = row[inside], there[inside], values[row, column][inside]
    cell = row * rows // height * COLUMNS + ((there + 0.5) * COLUMNS / width).astype(int)
    order = np.argsort(cell, kind="stable")
    ends = np.searchsorted(cell[order], np.arange(rows * COLUMNS + 1))
    least = _KNOWN * height * width / (rows * COLUMNS)
    found = np.full(rows * COLUMNS, np.nan)
    for number, (first, end) in enumerate(itertools.pairwise(ends)):
        if end - first >= max(1, least):
            found[number] = np.median(known[order[first:end]])
    return found.reshape(rows, COLUMNS)


def _smoothed(of_rooms: Cells) -> Cells:
    """Mean over rooms and cells nearby; of cells that too few rooms know what those nearby have."""
    known = np.isfinite(of_rooms).sum(axis=0)
    weight = np.where(known >= FEWEST_ROOMS, known, 0).astype(float)
    mean = np.where(weight > 0, np.nan_to_num(mean_known(of_rooms, 0)), 0.0)
    near, total = (
        cv2.GaussianBlur(one, (0, 0), _SPREAD, borderType=cv2.BORDER_CONSTANT)
        for one in (mean * weight, weight)
    )
    return np.where(total > 0, near / np.where(total > 0, total, 1.0), 0.0)


def _with(sensor: Sensor, cells: Cells) -> Sensor:
    warp = tuple(tuple(map(float, row)) for row in np.round(cells, _DIGITS))
    aligned = dataclasses.replace(sensor.right.alignment, warp_px=warp)
    return dataclasses.replace(sensor, right=dataclasses.replace(sensor.right, alignment=aligned))


def _cells(sensor: Sensor, shape: tuple[int, ...]) -> Cells:
    """The warp that the sensor has already, in as many cells."""
    begun = sensor.right.alignment.warp_px
    if not begun:
        return np.zeros(shape)
    resized = cv2.resize(np.array(begun), shape[::-1], interpolation=cv2.INTER_CUBIC)
    return resized.astype(np.float64)


def _rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else float("inf")
