"""Classical completion methods: exact cases and limits."""

from __future__ import annotations

import numpy as np
import pytest

from starling.learning.completion.classical import Classical
from starling.learning.completion.method import CompletionMethod, complete
from starling.learning.completion.methods import CLASSICAL

METHODS = tuple(map(Classical, CLASSICAL))
GUIDED = tuple(map(Classical, ("bilateral", "wls", "poisson")))
SHAPE = (72, 96)
EVEN = np.full(SHAPE, 100, np.uint8)


def name_of(method: CompletionMethod) -> str:
    return method.name


def hole(rows: slice = slice(20, 50), columns: slice = slice(30, 66)) -> np.ndarray:
    valid = np.ones(SHAPE, bool)
    valid[rows, columns] = False
    return valid


def noise() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    image = rng.integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
    return image, rng.uniform(0.5, 3, SHAPE).astype(np.float32), rng.random(SHAPE) < 0.7


@pytest.mark.parametrize("method", METHODS, ids=name_of)
def test_valid_pixels_stay_and_every_hole_is_filled(method: CompletionMethod) -> None:
    image, depth, valid = noise()
    result = complete(method, image, depth, valid)
    np.testing.assert_array_equal(result.depth_m[valid], depth[valid])
    assert result.depth_m.dtype == np.float32
    assert np.isfinite(result.depth_m).all() and np.isnan(result.sigma_m).all()
    # Weighted means are between the least and the greatest depth.
    assert result.depth_m.min() >= 0.49 and result.depth_m.max() <= 3.01


@pytest.mark.parametrize("method", METHODS, ids=name_of)
@pytest.mark.parametrize("holes", [hole(), hole(slice(None), slice(40)), noise()[2]])
def test_a_flat_wall_is_filled_exactly(method: CompletionMethod, holes: np.ndarray) -> None:
    result = complete(method, noise()[0], np.full(SHAPE, 1.3), holes)
    np.testing.assert_allclose(result.depth_m, 1.3, rtol=1e-4)


@pytest.mark.parametrize("method", METHODS, ids=name_of)
def test_one_valid_pixel_is_enough(method: CompletionMethod) -> None:
    valid = np.zeros(SHAPE, bool)
    valid[10, 20] = True
    result = complete(method, noise()[0], np.full(SHAPE, 0.8), valid)
    np.testing.assert_allclose(result.depth_m, 0.8, rtol=1e-4)


@pytest.mark.parametrize("method", METHODS, ids=name_of)
def test_results_are_reproducible_bit_for_bit(method: CompletionMethod) -> None:
    item, two = (complete(method, *noise()).depth_m for _ in range(2))
    assert item.tobytes() == two.tobytes()


def test_the_membrane_extends_a_slanted_plane_exactly() -> None:
    """Inverse depth of a plane is linear in the image, and linear is harmonic."""
    v, u = np.indices(SHAPE)
    depth = 1 / (0.4 + 0.003 * u + 0.005 * v)
    result = complete(Classical("poisson"), EVEN, depth, hole())
    np.testing.assert_allclose(result.depth_m, depth, rtol=1e-5)


@pytest.mark.parametrize("method", GUIDED, ids=name_of)
def test_a_hole_across_an_image_edge_takes_depth_from_each_side(method: CompletionMethod) -> None:
    image, depth = np.full(SHAPE, 60, np.uint8), np.full(SHAPE, 1.0)
    image[:, 40:], depth[:, 40:] = 200, 2.0
    # Asymmetric, so that the centre of the hole is not at the image edge.
    valid = hole()
    result = complete(method, image, depth, valid).depth_m
    off = np.abs(result - depth)
    assert off[~valid].mean() < 0.05
    away = np.abs(np.arange(SHAPE[1]) - 39.5) > 5
    assert off[:, away].max() < 0.1
    blind = complete(method, EVEN, depth, valid).depth_m
    assert np.abs(blind - depth)[~valid].mean() > 2 * off[~valid].mean()


def test_the_nearest_pixel_gives_its_depth() -> None:
    depth = np.broadcast_to(np.where(np.arange(SHAPE[1]) < 48, 1.0, 2.0), SHAPE)
    result = complete(Classical("nearest"), EVEN, depth, hole(slice(None), slice(40, 60))).depth_m
    assert (result[:, :50] == 1).all() and (result[:, 50:] == 2).all()


def test_morphology_extends_the_near_surface() -> None:
    depth = np.broadcast_to(np.where(np.arange(SHAPE[1]) < 48, 1.0, 2.0), SHAPE)
    valid = hole(slice(None), slice(46, 70))
    result = complete(Classical("morphological"), EVEN, depth, valid).depth_m
    np.testing.assert_allclose(result[:, 46:60], 1.0, rtol=1e-3)


@pytest.mark.parametrize("method", METHODS, ids=name_of)
def test_an_isolated_false_match_does_not_spread(method: CompletionMethod) -> None:
    """A few pixels of 9 m in a hole of a wall at 1 m stay and do not affect other pixels."""
    depth, valid = np.full(SHAPE, 1.0), hole()
    depth[34:37, 40:46], valid[34:37, 40:46] = 9.0, True
    result = complete(method, EVEN, depth, valid).depth_m
    assert (result[34:37, 40:46] == 9).all()
    np.testing.assert_allclose(result[~valid], 1.0, rtol=1e-3)
