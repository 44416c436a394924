"""Least squares by tiles, against dense least squares with each tile's factor as an unknown."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.calibration.least_squares import tiles

SHAPE = (32, 48)  # Six tiles.


@given(st.integers(0, 2**31 - 1))
@settings(max_examples=20)
def test_elimination_is_least_squares_with_a_factor_a_tile(seed: int) -> None:
    rng = np.random.default_rng(seed)
    signal, model, column = (rng.normal(2, 1, SHAPE) for _ in range(3))
    weight = rng.uniform(0.5, 2, SHAPE)
    gram = tiles.grams([signal, model, column], weight, means=False)
    inner, _ = tiles.eliminate(gram, 1)
    summed = inner.sum(axis=0)
    cut = [tiles.cut_tiles(image * np.sqrt(weight)) for image in (signal, model, column)]
    design = np.zeros((6, 256, 7))
    for tile in range(6):
        design[tile, :, tile] = cut[1][tile]
    design[:, :, 6] = cut[2]
    whole = np.linalg.lstsq(design.reshape(-1, 7), cut[0].ravel(), rcond=None)[0]
    assert summed[0, 1] / summed[1, 1] == pytest.approx(whole[6], rel=1e-6)


def test_factor_and_gradient_are_recovered() -> None:
    rng = np.random.default_rng(0)
    model = rng.uniform(1, 2, SHAPE).astype(np.float32)
    across, down = tiles.ramps(SHAPE)
    factor = 0.7 + 0.2 * across - 0.1 * down
    fitted = tiles.fit_factor(factor * model, model, np.ones(SHAPE, np.float32))
    np.testing.assert_allclose(fitted, factor, atol=1e-5)


def test_pixels_without_weight_are_unused() -> None:
    weight = np.ones(SHAPE, np.float32)
    weight[:16, :16] = np.arange(256).reshape(16, 16) < 100
    gram = tiles.grams([np.ones(SHAPE), np.ones(SHAPE)], weight, means=False)
    assert gram[0].sum() == 0  # Under half of the first tile counts.
    assert (gram[1:, 0, 0] == 256).all()


def test_means_compare_one_level_a_tile() -> None:
    rng = np.random.default_rng(2)
    image, second = rng.normal(5, 1, SHAPE), rng.normal(3, 1, SHAPE)
    gram = tiles.grams([image, second], np.ones(SHAPE), means=True)
    means = tiles.cut_tiles(image).mean(axis=1), tiles.cut_tiles(second).mean(axis=1)
    np.testing.assert_allclose(gram[:, 0, 1], 256 * means[0] * means[1])


def test_an_undetermined_parameter_has_no_finite_deviation() -> None:
    rng = np.random.default_rng(3)
    jacobian, residual = rng.normal(size=(40, 30, 2)), rng.normal(size=(40, 30))
    columns = np.concatenate(
        [residual[..., None], jacobian, np.zeros((40, 30, 1))], axis=2
    )  # The last moves nothing.
    gram = columns.transpose(0, 2, 1) @ columns
    equations = tiles.sum_clusters(gram, np.full(40, 30), np.arange(40))
    deviation = np.sqrt(np.diagonal(equations.covariance()))
    assert deviation[:2] == pytest.approx(1 / np.sqrt(1200), rel=0.3)
    assert np.isinf(deviation[2])
    assert equations.step()[2] == 0


def test_no_free_parameter_needs_no_step() -> None:
    """Noise alone is fitted with all levels fixed."""
    equations = tiles.ClusterEquations(
        matrices=np.zeros((3, 0, 0)), scores=np.zeros((3, 0)), cost=1.0
    )
    assert equations.step().shape == (0,)
    assert equations.covariance().shape == (0, 0)


def test_deviations_allow_for_errors_common_to_clusters() -> None:
    """Errors are common to each cluster, so clusters, not pixels, set the deviation."""
    steps, deviations = [], []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        common = rng.normal(size=(30, 1)) + 0.1 * rng.normal(size=(30, 50))
        columns = np.stack([common, np.ones((30, 50))], axis=2)
        gram = columns.transpose(0, 2, 1) @ columns
        equations = tiles.sum_clusters(gram, np.full(30, 50), np.arange(30))
        steps.append(equations.step()[0])
        deviations.append(np.sqrt(equations.covariance()[0, 0]))
    assert np.median(deviations) == pytest.approx(np.std(steps), rel=0.2)


def test_each_pixel_gets_its_tiles_value_back() -> None:
    values = np.arange(6.0)
    spread = tiles.to_pixels(values, (35, 50))
    np.testing.assert_array_equal(tiles.cut_tiles(spread).mean(axis=1), values)
    assert np.isnan(spread[32:]).all()
    assert np.isnan(spread[:, 48:]).all()


def test_clusters_are_squares_ten_across() -> None:
    """No cluster continues in the next row of clusters, even if they do not fill the image."""
    even = tiles.clusters((192, 320)).reshape(12, 20)
    assert len(np.unique(even[0])) == 10
    for number in np.unique(even):
        rows, columns = np.nonzero(even == number)
        assert (np.ptp(rows), np.ptp(columns), len(rows)) == (1, 1, 4)
    uneven = tiles.clusters((48, 25 * 16)).reshape(3, 25)
    assert len(np.unique(uneven)) == 2 * 13


def test_outlying_tiles_are_downweighted() -> None:
    """A tile with thirty times the median cost contributes three times the median cost."""
    gram = np.tile(np.array([[10.0, 2.0], [2.0, 4.0]]), (5, 1, 1))
    gram[4, 0, 0] = 300.0
    equations = tiles.sum_clusters(gram, np.full(5, 10.0), np.arange(5))
    np.testing.assert_allclose(equations.matrices.ravel(), [4, 4, 4, 4, 0.4])
    np.testing.assert_allclose(equations.scores.ravel(), [2, 2, 2, 2, 0.2])
    assert equations.cost == pytest.approx((4 * 10 + 30) / (4 * 10 + 1))


def test_leverage_of_clusters_increases_the_variance() -> None:
    """Leverage h scales the scores: var = sum s^2 / (1 - h) / M^2 for one parameter."""
    share, score = np.array([8.0, 1.0, 1.0]), np.array([3.0, -1.0, 2.0])
    equations = tiles.ClusterEquations(
        matrices=share[:, None, None], scores=score[:, None], cost=1.0
    )
    expected = (score**2 / (1 - share / 10)).sum() / 10**2
    assert equations.covariance()[0, 0] == pytest.approx(expected)


def test_ramps_are_about_the_tile_s_middle() -> None:
    """The factor without gradient is then the mean over the tile."""
    across, down = tiles.ramps((16, 32))
    np.testing.assert_allclose(across[:, :16], -across[:, 15::-1])
    np.testing.assert_allclose(down, -down[::-1])
    np.testing.assert_allclose(across[:, 16:], across[:, :16])
    assert across[0, 15] == down[15, 0] == pytest.approx(15 / 16)
