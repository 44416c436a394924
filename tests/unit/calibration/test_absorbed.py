"""Motion of an emitter that a re-solved pattern image absorbs."""

from __future__ import annotations

import numpy as np

from starling.calibration.pattern import emitter_model
from starling.calibration.pattern.cosine_image import Grid

GRID = Grid(half_a=0.5, half_b=0.4, step=5e-3)


def _cosines() -> np.ndarray:
    """Directions (n, 2), dense, well inside the grid."""
    a, b = np.meshgrid(np.linspace(-0.3, 0.3, 120), np.linspace(-0.2, 0.2, 80))
    return np.stack([a.ravel(), b.ravel()], axis=1).astype(np.float32)


def test_a_common_shift_is_absorbed() -> None:
    """The image follows a shift that is equal in two views, up to its variation in a cell."""
    cosines, weight = _cosines(), np.ones(9600, np.float32)
    slide = np.stack([1 + cosines[:, 0], cosines[:, 1] - 0.5], axis=1)
    motion = emitter_model.average_motion([(cosines, weight, {"x": slide})] * 2, GRID)
    inside = (np.abs(cosines) < [0.22, 0.12]).all(axis=1)
    np.testing.assert_allclose(motion.interpolate("x", cosines)[inside], slide[inside], atol=0.005)


def test_absorbed_motion_is_the_weighted_mean() -> None:
    """A near view shifts three times as far as a far view, at equal weight and at half weight."""
    cosines, slide = _cosines(), np.tile(np.array([1, -2], np.float32), (9600, 1))
    for weight, expected in ((1.0, 2.0), (0.5, 5 / 3)):
        near = (cosines, np.full(9600, weight, np.float32), {"x": 3 * slide})
        far = (cosines, np.ones(9600, np.float32), {"x": slide})
        motion = emitter_model.average_motion([near, far], GRID)
        np.testing.assert_allclose(
            motion.interpolate("x", cosines).mean(axis=0), np.multiply(expected, [1, -2]), rtol=1e-4
        )


def test_views_without_motion_count_in_the_mean() -> None:
    """A shift of the right image only is averaged with the unshifted left image."""
    cosines, weight = _cosines(), np.ones(9600, np.float32)
    slide = np.ones((9600, 2), np.float32)
    motion = emitter_model.average_motion(
        [(cosines, weight, {"right": slide}), (cosines, weight, {})], GRID
    )
    np.testing.assert_allclose(motion.interpolate("right", cosines), 0.5, rtol=1e-4)


def test_unknown_derivatives_do_not_contribute() -> None:
    """NaN derivatives and directions outside the grid do not contribute."""
    cosines, weight = _cosines(), np.ones(9600, np.float32)
    slide = np.ones((9600, 2), np.float32)
    cosines[0], weight[0], slide[0] = 9, 0, np.nan
    motion = emitter_model.average_motion([(cosines, weight, {"x": slide})], GRID)
    assert all(np.isfinite(image).all() for image in motion.partials["x"])
    assert not motion.interpolate("x", np.array([[9.0, 9.0]], np.float32)).any()
