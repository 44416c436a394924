"""What an image of a pattern takes over of a move of its emitter."""

from __future__ import annotations

import numpy as np

from starling.calibration.pattern import absorbed
from starling.calibration.pattern.cosine_image import Grid

GRID = Grid(half_a=0.5, half_b=0.4, step=5e-3)


def _cosines() -> np.ndarray:
    """Directions (n, 2), dense, well inside the grid."""
    a, b = np.meshgrid(np.linspace(-0.3, 0.3, 120), np.linspace(-0.2, 0.2, 80))
    return np.stack([a.ravel(), b.ravel()], axis=1).astype(np.float32)


def test_all_of_what_every_view_does() -> None:
    """Two views that slide alike: the image follows, up to how the slide varies in a cell."""
    cosines, weight = _cosines(), np.ones(9600, np.float32)
    slide = np.stack([1 + cosines[:, 0], cosines[:, 1] - 0.5], axis=1)
    found = absorbed.of([(cosines, weight, {"x": slide})] * 2, GRID)
    inside = (np.abs(cosines) < [0.22, 0.12]).all(axis=1)
    np.testing.assert_allclose(found.at("x", cosines)[inside], slide[inside], atol=0.005)


def test_the_mean_of_what_views_do_by_their_weight() -> None:
    """A near view slides three times as far as a far one that weighs as much; then half of it."""
    cosines, slide = _cosines(), np.tile(np.array([1, -2], np.float32), (9600, 1))
    for weight, expected in ((1.0, 2.0), (0.5, 5 / 3)):
        near = (cosines, np.full(9600, weight, np.float32), {"x": 3 * slide})
        far = (cosines, np.ones(9600, np.float32), {"x": slide})
        found = absorbed.of([near, far], GRID)
        np.testing.assert_allclose(
            found.at("x", cosines).mean(axis=0), np.multiply(expected, [1, -2]), rtol=1e-4
        )


def test_views_that_do_not_move_count() -> None:
    """A right image's own move: the left image, which stays, takes half of it."""
    cosines, weight = _cosines(), np.ones(9600, np.float32)
    slide = np.ones((9600, 2), np.float32)
    found = absorbed.of([(cosines, weight, {"right": slide}), (cosines, weight, {})], GRID)
    np.testing.assert_allclose(found.at("right", cosines), 0.5, rtol=1e-4)


def test_what_is_not_known_is_nobody_s() -> None:
    """NaN derivatives and directions out of the grid add nothing."""
    cosines, weight = _cosines(), np.ones(9600, np.float32)
    slide = np.ones((9600, 2), np.float32)
    cosines[0], weight[0], slide[0] = 9, 0, np.nan
    found = absorbed.of([(cosines, weight, {"x": slide})], GRID)
    assert all(np.isfinite(image).all() for image in found.partials["x"])
    assert not found.at("x", np.array([[9.0, 9.0]], np.float32)).any()
