"""Residuals of images after level, slopes and lights of each tile are fitted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.calibration.least_squares import variable_projection
from starling.patterns.errors import InputError

SHAPE, SIZE = (24, 36), 12


def drawn(seed: int, count: int = 1) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Return an image, layers of light, and weights that are partly 0."""
    rng = np.random.default_rng(seed)
    layers = [rng.random(SHAPE, np.float32) for _ in range(count)]
    level = 10 + 5 * sum(layers, start=np.zeros(SHAPE)) + rng.standard_normal(SHAPE)
    weight = rng.random(SHAPE, np.float32) * (rng.random(SHAPE) < 0.9)
    return level.astype(np.float32), layers, weight.astype(np.float32)


def dense(level: np.ndarray, layers: list[np.ndarray], weight: np.ndarray) -> tuple:
    """Return the weighted basis and the dense least-squares fit of one tile."""
    y, x = np.mgrid[: level.shape[0], : level.shape[1]].astype(float)
    root = np.sqrt(weight.astype(float)).ravel()
    columns = [np.ones(level.size), x.ravel(), y.ravel(), *(layer.ravel() for layer in layers)]
    basis = np.stack(columns, axis=1) * root[:, None]
    return basis, np.linalg.lstsq(basis, level.ravel() * root, rcond=None)[0], root


@given(seed=st.integers(0, 10**6), count=st.integers(1, 3))
def test_tiles_match_dense_least_squares(seed: int, count: int) -> None:
    level, layers, weight = drawn(seed, count)
    fit = variable_projection.eliminate(level, layers, weight, size_px=SIZE)
    change = [np.random.default_rng(seed + 1).random(SHAPE, np.float32) for _ in layers]
    slope = fit.project([change])[..., 0]
    tiles = [variable_projection.cut(image, SIZE) for image in (level, weight, *layers, *change)]
    for number in range(len(tiles[0])):
        parts = [part[number].reshape(SIZE, SIZE) for part in tiles]
        basis, fitted, root = dense(parts[0], parts[2 : 2 + count], parts[1])
        if (fitted[3:] < 0).any():
            continue  # `test_light_is_not_negative` covers this case.
        residual = parts[0].ravel() * root - basis @ fitted
        np.testing.assert_allclose(fit.residual[number], residual, atol=2e-3)
        np.testing.assert_allclose(fit.amplitude[number], fitted[3:], rtol=1e-2, atol=1e-3)
        moved = -root * sum(
            amplitude * part.ravel()
            for amplitude, part in zip(fitted[3:], parts[2 + count :], strict=True)
        )
        left = moved - basis @ np.linalg.lstsq(basis, moved, rcond=None)[0]
        np.testing.assert_allclose(slope[number], left, atol=2e-2)


@given(
    seed=st.integers(0, 10**6),
    gain=st.floats(0.1, 10),
    offset=st.floats(-50, 50),
    slope=st.floats(-1, 1),
)
def test_reflectance_and_ambient_light_are_eliminated(
    seed: int, gain: float, offset: float, slope: float
) -> None:
    """Light times reflectance plus a plane of ambient light leaves no residual."""
    rng = np.random.default_rng(seed)
    light = rng.random(SHAPE, np.float32)
    _, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    level = (gain * light + offset + slope * x).astype(np.float32)
    fit = variable_projection.eliminate(level, [light], np.ones_like(light), size_px=SIZE)
    assert np.abs(fit.residual).max() < 1e-4 * (gain + abs(offset) + 40)
    np.testing.assert_allclose(fit.amplitude, gain, rtol=1e-2)
    assert fit.pixels == light.size
    assert fit.freedom == light.size - 4 * fit.used.sum()


def test_light_is_not_negative() -> None:
    """A layer with a negative strength is removed and has no derivative."""
    light = np.random.default_rng(0).random(SHAPE, np.float32)
    fit = variable_projection.eliminate(100 - 5 * light, [light], np.ones_like(light), size_px=SIZE)
    assert (fit.amplitude == 0).all()
    assert fit.residual.std() > 1
    assert not fit.project([[light]]).any()


def test_tiles_with_few_pixels_are_unused() -> None:
    level, layers, weight = drawn(0)
    weight[:SIZE, :SIZE] = 0
    weight[2:4, 2:8] = 1
    fit = variable_projection.eliminate(level, layers, weight, size_px=SIZE)
    assert not fit.used[0] and fit.used[1:].all()
    assert not fit.residual[0].any()
    assert not fit.project([layers])[0].any()


@given(size=st.integers(4, 24))
def test_join_inverts_cut(size: int) -> None:
    image = np.arange(SHAPE[0] * SHAPE[1]).reshape(SHAPE)
    parts = variable_projection.cut(image, size)
    back = variable_projection.join(parts, SHAPE, size)
    inside = np.zeros(SHAPE, bool)
    inside[: SHAPE[0] // size * size, : SHAPE[1] // size * size] = True
    assert (back[inside] == image[inside]).all() and not back[~inside].any()
    y, x = np.divmod(parts.mean(axis=1), SHAPE[1])
    centres = variable_projection.centres(SHAPE, size)
    np.testing.assert_allclose(centres @ (1, SHAPE[1]), parts.mean(axis=1))
    assert len(x) == len(y) == len(centres)


def test_images_of_several_views_are_refused() -> None:
    level, layers, weight = drawn(0)
    with pytest.raises(InputError, match="observed, layers and weight must share one shape"):
        variable_projection.eliminate(level[1:], layers, weight, size_px=SIZE)
    with pytest.raises(InputError, match="size_px must be in"):
        variable_projection.eliminate(level, layers, weight, size_px=2)
