"""Normal equations of a view of a pattern image."""

from __future__ import annotations

import numpy as np
import pytest

from starling.calibration.pattern import tile_equations, unprojected
from starling.calibration.pattern.unprojected import PlacedView
from starling.calibration.pattern.views import Modulation

SHAPE = (96, 128)
TILE = 32
MOVE_PX = 0.1


def _light(shift_px: float) -> np.ndarray:
    """Return dots at a pitch of 6 px, with a sigma of 1.2 px, shifted to the right."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float64)
    away = [(np.abs((axis - off + 3) % 6 - 3)) ** 2 for axis, off in ((x, shift_px), (y, 0.0))]
    return np.exp(-(away[0] + away[1]) / (2 * 1.2**2)).astype(np.float32)


def _slope() -> np.ndarray:
    return (_light(1e-2) - _light(-1e-2)) / np.float32(2e-2)


def _placed(value: np.ndarray, weight: float = 25.0) -> PlacedView:
    weights = np.full(SHAPE, weight, np.float32)
    nowhere = np.zeros((SHAPE[0] * SHAPE[1], 2), np.float32)
    modulated = Modulation(value=value.astype(np.float32), weight=weights)
    gain = np.full(SHAPE, 0.8, np.float32)
    return PlacedView(modulation=modulated, cosines=nowhere, blur_px=0.6, gain=gain)


def _step(value: np.ndarray) -> float:
    normal = tile_equations.reduce_view(_placed(value), _light(0.0), {"x": _slope()}, tile_px=TILE)
    assert normal.scores.shape == (SHAPE[0] // TILE * SHAPE[1] // TILE, 1)
    return float(normal.right_side[0] / normal.matrix[0, 0])


def _moved() -> np.ndarray:
    return 0.8 * unprojected.imaged(_light(MOVE_PX), 0.6)


def _noise(deviation: float) -> np.ndarray:
    return deviation * np.random.default_rng(0).standard_normal(SHAPE)


@pytest.mark.parametrize("deviation", [0.2, 1.2])
def test_the_step_equals_the_shift(deviation: float) -> None:
    """A shift of 0.1 px is recovered within 5 %, with nominal noise and with six times as much.

    With weights at the scale of the nominal noise, the step would be too small. The step for the
    same noise without shift is subtracted, to remove chance.
    """
    noise = _noise(deviation)
    still = 0.8 * unprojected.imaged(_light(0.0), 0.6)
    assert _step(_moved() + noise) - _step(still + noise) == pytest.approx(MOVE_PX, rel=0.05)


def test_texture_has_little_influence() -> None:
    """Outliers of ten deviations in 10 % of the pixels change the step by less than 1/6 of squares.

    The Cauchy influence of such a residual is 1/12.
    """
    value = _moved() + _noise(0.2)
    texture = np.zeros(SHAPE)
    texture[:, :12] = 2 * np.sign(_slope()[:, :12])
    slope = 0.8 * unprojected.imaged(_slope(), 0.6)
    squares = float((slope * texture).sum() / (slope**2).sum())
    assert abs(_step(value + texture) - _step(value)) < squares / 6


def test_a_view_without_weight_contributes_nothing() -> None:
    empty = _placed(_moved(), weight=0.0)
    normal = tile_equations.reduce_view(empty, _light(0.0), {"x": _slope()}, tile_px=TILE)
    assert not normal.matrix.any() and not normal.scores.any() and normal.freedom == 0
