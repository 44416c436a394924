"""Parts of the normal equations of infrared images, against hand-computed values."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.calibration import parameters
from starling.calibration.geometry import residuals
from starling.calibration.geometry.residuals import LevelVariance
from starling.calibration.parameters import DOT_BLUR, FIELD, CalibrationParameter
from starling.sim.sensor import presets

SIZE = 16
SHAPE = (64, 640)  # Squares of three tiles.


def test_variance_grows_with_the_level_and_its_square() -> None:
    level = np.array([[-5.0, 0.0, 10.0]], np.float32)
    np.testing.assert_allclose(
        LevelVariance(2.0, 0.3, 0.04).at_level(level), [[2.0, 2.0, 9.0]], rtol=1e-6
    )
    assert (LevelVariance(0.0, 0.0, 0.0).at_level(level) > 0).all()


def test_stiffness_is_curvature_over_weight() -> None:
    """For residuals r and Cauchy scale c it is (1 - r^2/c^2) / (1 + r^2/c^2); 0 is ignored."""
    square = 0.25
    residual = np.array([[1.0, -1.0, 0.0, 1.0]], np.float32) * np.float32(2.5 * square**0.5)
    assert residuals._stiffness(residual) == pytest.approx((1 - square) / (1 + square), rel=1e-5)
    assert residuals._stiffness(np.zeros((2, 3), np.float32)) == 1.0
    assert residuals._stiffness(100 * residual) == 0.1


def clustered(side: str, tile: int, disparity_px: float) -> int:
    """Return the cluster number of a tile in the first row."""
    predicted: Any = SimpleNamespace(
        light=np.zeros(SHAPE, np.float32),
        view=SimpleNamespace(side=side),
        disparity_px=np.full(SHAPE, disparity_px, np.float32),
    )
    parts = np.zeros((SHAPE[0] // SIZE * SHAPE[1] // SIZE, 1))
    parts[tile] = 1.0
    summed = residuals._sum_clusters(parts, predicted, SIZE)
    (number,) = np.flatnonzero(summed[:, 0])
    return int(number)


@pytest.mark.parametrize("tiles_off", [3, 6])
def test_both_imagers_share_clusters(tiles_off: int) -> None:
    """A point at x in the right image is at x + d in the left."""
    for tile in (10, 17):
        right = clustered("right", tile, float(tiles_off * SIZE))
        assert right == clustered("left", tile + tiles_off, float(tiles_off * SIZE))
        assert right != clustered("left", tile, 0.0)
    assert clustered("right", 17, float("nan")) == clustered("left", 17, 0.0)


def test_the_main_body_of_a_tile_is_used() -> None:
    body = np.full((SIZE, 2 * SIZE), 3, np.uint32)
    body[:, :6] = 1
    body[4:, SIZE:] = 0
    mask = residuals._main_body(body, SIZE)
    np.testing.assert_array_equal(mask[:, :SIZE], body[:, :SIZE] == 3)
    np.testing.assert_array_equal(mask[:, SIZE:], body[:, SIZE:] == 0)


def test_columns_use_the_parameters_variable() -> None:
    """The field uses a relative step, the width of dots its variance."""
    sensor = presets.load("d415")

    def row(name: str) -> CalibrationParameter:
        return CalibrationParameter(name=name, group="", unit="", tolerance=0.02)

    half = parameters.value(sensor, FIELD)
    assert residuals._per_tolerance(row(FIELD), sensor) == pytest.approx(0.02 / half)
    assert residuals._per_tolerance(row(DOT_BLUR), sensor) == pytest.approx(0.02**2)
    assert residuals._per_tolerance(row("baseline_m"), sensor) == 0.02
