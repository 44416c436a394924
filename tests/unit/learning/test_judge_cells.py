"""Statistics of cells against counts by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from starling.learning.judge import cells
from starling.learning.judge.cells import CELL_PX
from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.captures.capture import Frame
from starling.sim.captures.info import CaptureInfo

SHAPE = (48, 160)


@pytest.fixture
def info(small_set: Path) -> CaptureInfo:
    return capture.open_set(small_set).info


def _frame(seed: int = 0) -> Frame:
    rng = np.random.default_rng(seed)
    depth_m = (1 + 0.002 * rng.standard_normal(SHAPE)).astype(np.float32)
    depth_m[rng.random(SHAPE) < 0.02] = np.nan
    left, right = rng.integers(80, 200, (2, *SHAPE)).astype(np.uint8)
    return Frame(number=0, ir_left=left, ir_right=right, depth_m=depth_m)


def test_a_cell_holds_the_mean_of_its_pixels():
    image = np.zeros((2 * CELL_PX + 3, 3 * CELL_PX + 5), np.float32)
    image[CELL_PX, CELL_PX] = CELL_PX**2
    image[-1, -1] = 1  # In no whole cell.
    expected = np.zeros((2, 3))
    expected[1, 1] = 1
    np.testing.assert_array_equal(cells.cell_means(image), expected)


@pytest.mark.parametrize("kind", list(cells.KINDS))
def test_statistics_are_finite_and_not_negative(kind, info):
    statistics = cells.statistics(kind, _frame(), info)
    assert statistics.shape[1:] == (SHAPE[0] // CELL_PX, SHAPE[1] // CELL_PX)
    assert np.isfinite(statistics).all() and (statistics >= 0).all()


def test_a_whole_map_has_no_hole_statistics_but_those_of_its_one_island(info):
    frame = replace(_frame(), depth_m=np.ones(SHAPE, np.float32))
    statistics = cells.statistics("holes", frame, info)
    shown = {tuple(np.unique(channel)) for channel in statistics}
    assert shown == {(0.0,), (1.0,)}  # Runs and area of the whole image fill every cell.


def test_a_pinhole_is_one_run_and_one_area_of_a_pixel(info):
    depth_m = np.ones(SHAPE, np.float32)
    depth_m[20, 40] = np.nan
    statistics = cells.statistics("holes", replace(_frame(), depth_m=depth_m), info)
    share = 1 / CELL_PX**2
    assert statistics[0, 1, 2] == share  # The mask itself comes first.
    # Along rows, along columns, area; and patterns of a corner, four at each of four steps.
    assert np.count_nonzero(statistics == share) == 1 + 3 + 4 * 4
    assert np.count_nonzero(statistics[0]) == 1


def test_the_level_of_infrared_images_gives_little_away(info):
    frame = _frame()
    assert frame.ir_left is not None and frame.ir_right is not None
    darker = replace(frame, ir_left=frame.ir_left // 2, ir_right=frame.ir_right // 2)
    blurred = (frame.ir_left[:, :-1] // 2 + frame.ir_left[:, 1:] // 2).astype(np.uint8)
    soft = replace(frame, ir_left=np.pad(blurred, ((0, 0), (0, 1)), mode="edge"))
    usual, dark, smooth = (
        cells.statistics("infrared", each, info) for each in (frame, darker, soft)
    )
    assert np.abs(usual - dark).mean() < 0.4 * np.abs(usual - smooth).mean()


def test_slow_disparity_gives_nothing_away(info):
    """A tilt of the surface changes no statistic by as much as noise does."""
    rng = np.random.default_rng(1)
    noise = 0.1 * rng.standard_normal(SHAPE)
    tilt = np.linspace(0, 0.2, SHAPE[1])[None]

    def seen(disparity_px: np.ndarray) -> np.ndarray:
        depth_m = (info.focal_baseline_px_m / disparity_px).astype(np.float32)
        return cells.statistics("depth", replace(_frame(), depth_m=depth_m), info)

    flat, tilted, noisier = (seen(40 + part) for part in (noise, noise + tilt, 2 * noise))
    assert np.abs(tilted - flat).mean() < 0.1 * np.abs(noisier - flat).mean()


@pytest.mark.parametrize(
    ("kind", "missing", "name"),
    [
        ("depth", "depth_m", "depth"),
        ("holes", "depth_m", "depth"),
        ("infrared", "ir_right", "infrared pair"),
    ],
)
def test_a_frame_without_the_images_is_refused(kind, missing, name, info):
    frame = replace(_frame(), **{missing: None})
    with pytest.raises(InputError, match=f"{name} must be in every frame to be judged; got none"):
        cells.statistics(kind, frame, info)
