"""The mean over neighbours of a disparity map: windows, weights, passes."""

from __future__ import annotations

import numpy as np
import pytest

from starling.sim.sensor.matcher import Refinement
from starling.sim.stereo import subpixel


def test_smoothing_keeps_jumps_planes_and_holes():
    plane = np.tile(np.arange(60, dtype=np.float32) * 0.1, (40, 1))
    plane[:, 30:] += 20
    plane[10, 10] = np.nan
    window = {"columns_px": 9, "rows_px": 9, "step_px": 2.0, "quantum_px": 0.0}
    out = subpixel.smooth(plane, np.ones_like(plane), **window)
    assert np.isnan(out[10, 10])
    np.testing.assert_allclose(out[:, 36:54], plane[:, 36:54], atol=1e-4)
    assert np.nanmax(np.abs(out - plane)) < 0.3


def test_smoothing_counts_by_weight():
    uneven = np.full((20, 20), 7, np.float32)
    uneven[10, 10] = 8
    sure = np.ones_like(uneven)
    sure[10, 10] = 0
    window = {"columns_px": 5, "rows_px": 5, "step_px": 2.0, "quantum_px": 0.0}
    assert subpixel.smooth(uneven, sure, **window)[10, 10] == 7
    nobody = np.zeros_like(uneven)
    remaining = subpixel.smooth(uneven, nobody, **window)
    np.testing.assert_array_equal(remaining, uneven)


@pytest.mark.parametrize(("columns", "rows"), [(15, 5), (15, 8), (3, 9), (7, 7)])
def test_mean_window_has_the_requested_rows_and_columns(columns, rows):
    """A single deviating pixel is spread evenly over the window; rows never exceed columns."""
    off = np.full((31, 31), 7, np.float32)
    off[15, 15] = 8
    setting = Refinement(smooth_px=columns, smooth_rows_px=rows)
    spread = subpixel.refine(off, setting) - 7
    down, across = (np.ptp(places) + 1 for places in np.nonzero(spread > 1e-4))
    assert (across, down) == (columns, min(rows, columns))
    inside = spread[spread > 1e-4]
    np.testing.assert_allclose(inside, 1 / (across * down), rtol=1e-3)


def test_an_even_window_has_one_row_more_above_its_centre() -> None:
    off = np.full((31, 31), 7, np.float32)
    off[15] = 8
    spread = subpixel.refine(off, Refinement(smooth_px=15, smooth_rows_px=8))[:, 15] - 7
    rows = np.flatnonzero(spread > 1e-4)
    assert (rows[0], rows[-1]) == (15 - 3, 15 + 4)  # Row 19 has row 15 as its fourth above.


def test_the_mean_leaves_out_what_has_no_weight() -> None:
    off = np.full((31, 31), 7, np.float32)
    off[15, 15] = 8
    rejected = np.ones_like(off)
    rejected[15, 15] = 0
    unmoved = subpixel.refine(off, Refinement(smooth_px=5), rejected)
    assert np.delete(unmoved[15], 15) == pytest.approx(7)
