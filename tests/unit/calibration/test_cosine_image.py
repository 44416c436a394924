"""An image over direction cosines: reading, adding, and the slope between its pixels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.calibration.pattern import cosine_image
from starling.calibration.pattern.cosine_image import Grid

SHAPE = (9, 12)
seeds = st.integers(0, 2**32 - 1)


def _drawn(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return an image, positions inside and outside it, and values."""
    rng = np.random.default_rng(seed)
    place = rng.uniform([-2, -2], [SHAPE[1] + 1, SHAPE[0] + 1], (50, 2))
    return rng.standard_normal(SHAPE), place, rng.standard_normal(50)


@given(seeds)
def test_add_is_the_transpose_of_read(seed: int) -> None:
    """<A x, y> = <x, A' y>, places outside included."""
    image, place, values = _drawn(seed)
    read, added = np.zeros(50), np.zeros(SHAPE)
    cosine_image.read(image, place, read)
    cosine_image.add(added, place, values)
    assert read @ values == pytest.approx(np.vdot(image, added), rel=1e-10, abs=1e-10)
    assert read.any()


@given(seeds)
def test_slope_is_the_derivative_of_read_within_a_cell(seed: int) -> None:
    """Bilinear along each axis: differences inside one cell are exact."""
    image, place, _ = _drawn(seed)
    place = np.clip(place, 0.25, [SHAPE[1] - 1.75, SHAPE[0] - 1.75])
    place = np.floor(place) + np.clip(place % 1, 0.1, 0.9)
    slope = np.empty((50, 2))
    cosine_image.slope(image, place, slope)
    for axis in range(2):
        ends = np.zeros((2, 50))
        for row, way in zip(ends, (0.05, -0.05), strict=True):
            cosine_image.read(image, place + way * np.eye(2)[axis], row)
        np.testing.assert_allclose(slope[:, axis], (ends[0] - ends[1]) / 0.1, atol=1e-10)


def test_read_accumulates_and_ignores_positions_outside() -> None:
    image = np.ones(SHAPE)
    place = np.array([[2.5, 3.5], [-0.1, 3.0], [3.0, SHAPE[0] - 0.5], [np.nan, 1.0]])
    out = np.full(4, 2.0)
    cosine_image.read(image, place, out)
    np.testing.assert_array_equal(out, [3, 2, 2, 2])
    slope = np.full((4, 2), 7.0)
    cosine_image.slope(image, place, slope)
    assert not slope.any()


def test_cosines_are_those_of_the_pixel_positions() -> None:
    grid = Grid(half_a=0.6, half_b=0.4, step=0.03)
    a, b = grid.cosines()
    assert (len(b), len(a)) == grid.shape
    assert -a[0] == pytest.approx(a[-1]) and a[-1] >= 0.6
    assert -b[0] == pytest.approx(b[-1]) and b[-1] >= 0.4
    corners = np.array([[a[0], b[0]], [a[-1], b[-1]]])
    expected = [[0, 0], [len(a) - 1, len(b) - 1]]
    np.testing.assert_allclose(grid.place(corners), expected, atol=1e-5)
