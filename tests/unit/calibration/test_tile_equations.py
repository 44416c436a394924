"""Normal equations with levels, slopes and strengths of tiles eliminated."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.calibration.pattern import tile_equations
from starling.calibration.pattern.tile_equations import NormalEquations

TILE, ROWS, ACROSS = 8, 2, 3
SHAPE = (ROWS * TILE, ACROSS * TILE)
COUNT, PARAMETERS = 2, 3


def _problem(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights, templates and their derivatives."""
    rng = np.random.default_rng(seed)
    weight = rng.uniform(0.5, 2.0, SHAPE).astype(np.float32)
    weight[rng.random(SHAPE) < 0.1] = 0
    templates = rng.uniform(0, 1, (COUNT, *SHAPE)).astype(np.float32)
    columns = rng.standard_normal((COUNT, PARAMETERS, *SHAPE)).astype(np.float32)
    return weight, templates, columns


def _tiles() -> list[tuple[slice, slice]]:
    return [
        (slice(r * TILE, (r + 1) * TILE), slice(c * TILE, (c + 1) * TILE))
        for r in range(ROWS)
        for c in range(ACROSS)
    ]


def _reading(
    templates: np.ndarray, seed: int = 1, *, level: float = 30.0, slope: float = 4.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return a noise-free image of the model and its strengths (tiles, k)."""
    rng = np.random.default_rng(seed)
    image = np.zeros(SHAPE, np.float32)
    strengths = rng.uniform(5, 15, (ROWS * ACROSS, COUNT))
    y, x = np.mgrid[:TILE, :TILE] / TILE
    for tile, strength in zip(_tiles(), strengths, strict=True):
        background = level + slope * (rng.uniform(-1, 1) * x + rng.uniform(-1, 1) * y)
        image[tile] = background + np.tensordot(strength, templates[(slice(None), *tile)], axes=1)
    return image, strengths


def _eliminated(
    image: np.ndarray, weight: np.ndarray, templates: np.ndarray, columns: np.ndarray
) -> NormalEquations:
    return tile_equations.reduce_image(image, weight, templates, columns, tile_px=TILE)


def _dense(
    image: np.ndarray,
    weight: np.ndarray,
    templates: np.ndarray,
    columns: np.ndarray,
    strengths: np.ndarray,
) -> np.ndarray:
    """Return the step of dense weighted least squares with each tile's unknowns as columns."""
    y, x = np.mgrid[:TILE, :TILE] / TILE
    unknowns = 3 + COUNT
    tiles = _tiles()
    matrix = np.zeros((len(tiles), TILE * TILE, PARAMETERS + unknowns * len(tiles)))
    reading = np.zeros((len(tiles), TILE * TILE))
    for number, tile in enumerate(tiles):
        root = np.sqrt(weight[tile]).ravel()
        start = PARAMETERS + unknowns * number
        basis = [np.ones_like(x), x, y, *templates[(slice(None), *tile)]]
        for i, row in enumerate(basis):
            matrix[number, :, start + i] = root * row.ravel()
        slopes = np.tensordot(strengths[number], columns[(slice(None), slice(None), *tile)], axes=1)
        matrix[number, :, :PARAMETERS] = root[:, None] * slopes.reshape(PARAMETERS, -1).T
        reading[number] = root * image[tile].ravel()
    flat = matrix.reshape(-1, matrix.shape[-1])
    return np.linalg.lstsq(flat, reading.ravel(), rcond=None)[0][:PARAMETERS]


def _step(normal: NormalEquations) -> np.ndarray:
    return np.linalg.solve(normal.matrix, normal.right_side)


def test_the_step_is_that_of_dense_least_squares() -> None:
    """Residuals are 1 % of a deviation, so robust weights are 1 within 1e-4.

    The test does not cover larger residuals.
    """
    weight, templates, columns = _problem(0)
    image, strengths = _reading(templates)
    truth = np.array([1e-3, -5e-4, 7e-4])
    for number, tile in enumerate(_tiles()):
        slopes = np.tensordot(strengths[number], columns[(slice(None), slice(None), *tile)], axes=1)
        image[tile] += np.tensordot(truth, slopes, axes=1)
    normal = _eliminated(image, weight, templates, columns)
    dense = _dense(image, weight, templates, columns, normal.strengths)
    np.testing.assert_allclose(_step(normal), dense, rtol=2e-3, atol=1e-6)
    np.testing.assert_allclose(dense, truth, rtol=0.02, atol=1e-5)


def test_strengths_are_recovered_without_residual() -> None:
    """A noise-free image leaves only rounding errors of single precision, 3e-6 DN."""
    weight, templates, columns = _problem(2)
    image, strengths = _reading(templates)
    normal = _eliminated(image, weight, templates, columns)
    np.testing.assert_allclose(normal.strengths, strengths, rtol=1e-4)
    assert normal.misfit / normal.freedom < 1e-9
    assert normal.freedom == np.count_nonzero(weight) - ROWS * ACROSS * (3 + COUNT)
    assert np.abs(_step(normal)).max() < 1e-5


@given(st.floats(0, 200), st.floats(-20, 20), st.integers(0, 99))
@settings(max_examples=25)
def test_a_tile_s_level_and_slopes_change_nothing(level: float, slope: float, seed: int) -> None:
    """With large residuals, adding a plane to tiles does not change the equations."""
    weight, templates, columns = _problem(seed)
    noise = np.random.default_rng(seed).standard_normal(SHAPE).astype(np.float32)
    plain = _reading(templates, seed, level=0.0, slope=0.0)[0] + noise
    lifted = _reading(templates, seed, level=level, slope=slope)[0] + noise
    plain_equations, lifted_equations = (
        _eliminated(image, weight, templates, columns) for image in (plain, lifted)
    )
    size = np.abs(plain_equations.matrix).max()
    np.testing.assert_allclose(lifted_equations.matrix, plain_equations.matrix, atol=1e-4 * size)
    np.testing.assert_allclose(_step(lifted_equations), _step(plain_equations), atol=1e-4)
    assert lifted_equations.misfit == pytest.approx(plain_equations.misfit, rel=1e-3)


def test_a_tile_s_gain_changes_only_its_weight() -> None:
    """A tile that is k times as bright, with scaled noise, gives the same step."""
    weight, templates, columns = _problem(4)
    noise = 0.01 * np.random.default_rng(4).standard_normal(SHAPE)
    image = _reading(templates)[0] + noise
    gain = np.kron(np.array([[1, 2, 3], [0.5, 4, 1]]), np.ones((TILE, TILE)))
    plain_equations = _eliminated(image.astype(np.float32), weight, templates, columns)
    brighter = (gain * image).astype(np.float32), (weight / gain**2).astype(np.float32)
    bright_equations = _eliminated(*brighter, templates, columns)
    np.testing.assert_allclose(
        _step(bright_equations), _step(plain_equations), rtol=1e-3, atol=1e-7
    )


def test_an_outlier_has_little_influence() -> None:
    """One outlier of 100 deviations changes the step by less than 10 % of the squares' change."""
    weight, templates, columns = _problem(5)
    image, _ = _reading(templates)
    place = tuple(np.argwhere(weight > 0)[40])
    image[place] += 100
    normal = _eliminated(image, weight, templates, columns)
    dense = _dense(image, weight, templates, columns, normal.strengths)
    assert np.abs(_step(normal)).max() < 0.1 * np.abs(dense).max()


def test_a_tile_with_too_few_pixels_is_unused() -> None:
    weight, templates, columns = _problem(6)
    image, _ = _reading(templates)
    weight[_tiles()[1]] = 0
    weight[0, TILE : TILE + 3] = 1
    normal = _eliminated(image, weight, templates, columns)
    assert np.isnan(normal.strengths[1]).all()
    assert not normal.scores[1].any()
    assert np.isfinite(np.delete(normal.strengths, 1, axis=0)).all()


def test_an_empty_template_has_no_strength() -> None:
    weight, templates, columns = _problem(7)
    templates[1] = 0
    image, _ = _reading(templates)
    normal = _eliminated(image, weight, templates, columns)
    np.testing.assert_allclose(normal.strengths[:, 1], 0, atol=1e-6)
    assert np.isfinite(normal.matrix).all()


def test_misfit_of_noise_is_its_count() -> None:
    """The misfit of 10^6 normal samples is their count within 0.5 %, and grows with noise.

    One residual of 1000 deviations counts as 50 to 200.
    """
    noise = np.random.default_rng(0).standard_normal(10**6)
    assert tile_equations.misfit(noise) == pytest.approx(noise.size, rel=5e-3)
    assert 2 < tile_equations.misfit(2 * noise) / noise.size < 4
    assert 50 < tile_equations.misfit(np.array([1000.0])) < 200


def test_total_and_embed() -> None:
    """Equations of two images add; parameters outside a part's equations stay 0."""
    weight, templates, columns = _problem(8)
    image, _ = _reading(templates)
    part = _eliminated(image + 1, weight, templates, columns)
    wide = tile_equations.embed(part, [4, 0, 2], 5)
    np.testing.assert_array_equal(wide.matrix[np.ix_([4, 0, 2], [4, 0, 2])], part.matrix)
    np.testing.assert_allclose(wide.right_side[[4, 0, 2]], part.right_side, rtol=1e-9, atol=1e-9)
    assert not wide.matrix[[1, 3]].any() and not wide.right_side[[1, 3]].any()
    both = tile_equations.total([wide, wide])
    np.testing.assert_allclose(both.matrix, 2 * wide.matrix)
    np.testing.assert_allclose(both.right_side, 2 * wide.right_side)
    assert both.freedom == 2 * part.freedom and both.misfit == 2 * part.misfit
    assert both.scores.shape == (2 * ROWS * ACROSS, 5)
