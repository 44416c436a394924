"""Pairs of a real and a simulated scene, as the judge's network reads them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

from starling.learning.judge import cells
from starling.learning.judge.network import WINDOW, WINDOW_PX
from starling.patterns.errors import refuse
from starling.sim.arrays import Image, Mask
from starling.sim.captures.capture import CapturedScene, CaptureSet, Frame
from starling.sim.captures.info import CaptureInfo
from starling.sim.commands.compare import pair_scenes
from starling.sim.console import progress
from starling.sim.metrics import LEFT_BAND_PX

_GAP_PX = 9  # Areas without reference depth that are narrower still count [px].
_EVERY = 2  # Step between the cells that means and deviations are taken from.
LEAST_SHOWN = 0.5  # Windows with a smaller share of shown cells are not judged.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ScenePair:
    """Cell statistics of one scene: real first, upright first."""

    scene: str
    room: str
    cells: Tensor  # (2 sides, 2 flips, c, rows, columns), 0 where cells do not count.
    shown: Tensor  # (2 flips, 1, rows, columns), 1 where cells count on both sides, else 0.


def pairs(
    kind: str, real: CaptureSet, sim: CaptureSet, *, track: progress.Progress = progress.silent
) -> list[ScenePair]:
    """Compute the statistics of the first frames of all scenes that both sets hold.

    Raises:
        InputError: if a frame lacks the images of this kind, sizes differ, or images are too small.
    """
    return [
        pair(a, read(kind, a), b, read(kind, b))
        for a, b in track(pair_scenes(real, sim), f"read {kind}")
    ]


def read(kind: str, scene: CapturedScene) -> Tensor:
    """Compute the statistics (2 flips, c, rows, columns) of a scene's first frame.

    Raises:
        InputError: if the frame lacks the images of this kind, or they are too small.
    """
    return statistics(kind, scene.frame(scene.frames[0]), scene.info)


def statistics(kind: str, frame: Frame, info: CaptureInfo) -> Tensor:
    """Compute the statistics (2 flips, c, rows, columns) of a frame.

    Raises:
        InputError: if the frame lacks the images of this kind, or they are too small.
    """
    height, width = info.shape
    if height < WINDOW_PX or width < LEFT_BAND_PX + WINDOW_PX:
        rule = f"must be at least {LEFT_BAND_PX + WINDOW_PX} x {WINDOW_PX} px to be judged"
        raise refuse("images", rule, f"{width} x {height}", "Take larger images.")
    frames = (frame, _flipped(frame))
    return torch.stack([_cut(cells.statistics(kind, each, info)) for each in frames])


def pair(
    real: CapturedScene, real_cells: Tensor, sim: CapturedScene, sim_cells: Tensor
) -> ScenePair:
    """Join both sides of a scene; cells without reference depth are hidden on both.

    Args:
        real: scene of a device.
        real_cells: its statistics, as `read` returns them.
        sim: the same scene, simulated.
        sim_cells: its statistics.

    Raises:
        InputError: if sizes differ.
    """
    if real.info.shape != sim.info.shape:
        got = f"{real.info.shape} and {sim.info.shape} in {real.name}"
        rule, advice = "must have one image size", "Simulate with the geometry of the captures."
        raise refuse("real and simulated", rule, got, advice)
    shown = _shown(real)
    flips = (shown, shown[::-1])
    known = torch.stack([_cut(cells.cell_means(image)[None]) for image in flips]) > LEAST_SHOWN
    return ScenePair(
        scene=real.name,
        room=real.room,
        cells=torch.stack([real_cells, sim_cells]) * known,
        shown=known.float(),
    )


def _cut(image: Image) -> Tensor:
    """Leave out the columns that the search for matches may not reach."""
    return torch.from_numpy(np.ascontiguousarray(image[..., LEFT_BAND_PX // cells.CELL_PX :]))


def _shown(scene: CapturedScene) -> Mask:
    """Pixels (h, w) with reference depth nearby: elsewhere nothing says what a simulation holds."""
    truth_m = scene.truth_m()
    if truth_m is None:
        return np.ones(scene.info.shape, bool)
    unknown = np.isnan(truth_m).astype(np.uint8)
    wide = cv2.morphologyEx(unknown, cv2.MORPH_OPEN, np.ones((_GAP_PX, _GAP_PX), np.uint8))
    return wide == 0


def _flipped(frame: Frame) -> Frame:
    """Flip a frame up-down, which keeps the order of the imagers."""
    images: dict[str, Any] = {
        name: None if image is None else np.ascontiguousarray(image[::-1])
        for name in ("ir_left", "ir_right", "depth_m")
        for image in (getattr(frame, name),)
    }
    return Frame(number=frame.number, **images)


def counted_windows(shown: Tensor) -> Tensor:
    """Windows (..., rows, columns) of the grid at the first cell that are judged."""
    means = torch.nn.functional.avg_pool2d(shown, WINDOW)
    return means[..., 0, :, :] >= LEAST_SHOWN


def moments(samples: Sequence[ScenePair]) -> tuple[Tensor, Tensor]:
    """Mean and inverse deviation (c, 1, 1) of each statistic over shown cells of several pairs."""
    rows = [
        pair.cells[:, 0].movedim(1, -1)[:, pair.shown[0, 0] > 0].flatten(0, 1)[::_EVERY]
        for pair in samples
    ]
    values = torch.cat(rows)
    scale = 1 / (values.std(0) + 1e-3)
    return values.mean(0)[:, None, None], scale[:, None, None]
