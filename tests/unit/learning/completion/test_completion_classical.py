"""Fills without learning: what they must get exactly right, and where they must stop."""

from __future__ import annotations

import numpy as np
import pytest

from starling.learning.completion.classical.bilateral import Bilateral
from starling.learning.completion.classical.morphological import Morphological
from starling.learning.completion.classical.nearest import Nearest
from starling.learning.completion.classical.poisson import Poisson
from starling.learning.completion.classical.wls import WeightedLeastSquares
from starling.learning.completion.method import Method, complete
from starling.patterns.errors import InputError

METHODS: tuple[Method, ...] = (
    Nearest(),
    Morphological(),
    Bilateral(),
    WeightedLeastSquares(),
    Poisson(),
)
GUIDED: tuple[Method, ...] = (Bilateral(), WeightedLeastSquares(), Poisson())
SHAPE = (72, 96)
EVEN = np.full(SHAPE, 100, np.uint8)


def named(method: Method) -> str:
    return method.name


def hole(rows: slice = slice(20, 50), columns: slice = slice(30, 66)) -> np.ndarray:
    valid = np.ones(SHAPE, bool)
    valid[rows, columns] = False
    return valid


def noise() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    image = rng.integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
    return image, rng.uniform(0.5, 3, SHAPE).astype(np.float32), rng.random(SHAPE) < 0.7


def test_names_differ() -> None:
    assert [named(one) for one in METHODS] == [
        *("nearest", "morphological", "bilateral", "wls", "poisson")
    ]


@pytest.mark.parametrize("method", METHODS, ids=named)
def test_valid_pixels_stay_and_every_hole_is_filled(method: Method) -> None:
    image, depth, valid = noise()
    found = complete(method, image, depth, valid)
    np.testing.assert_array_equal(found.depth_m[valid], depth[valid])
    assert found.depth_m.dtype == np.float32
    assert np.isfinite(found.depth_m).all() and np.isnan(found.sigma_m).all()
    # Means of what is there lie between the least and the greatest.
    assert found.depth_m.min() >= 0.49 and found.depth_m.max() <= 3.01


@pytest.mark.parametrize("method", METHODS, ids=named)
@pytest.mark.parametrize("holes", [hole(), hole(slice(None), slice(40)), noise()[2]])
def test_an_even_wall_is_filled_exactly(method: Method, holes: np.ndarray) -> None:
    found = complete(method, noise()[0], np.full(SHAPE, 1.3), holes)
    np.testing.assert_allclose(found.depth_m, 1.3, rtol=1e-4)


@pytest.mark.parametrize("method", METHODS, ids=named)
def test_one_valid_pixel_is_enough(method: Method) -> None:
    valid = np.zeros(SHAPE, bool)
    valid[10, 20] = True
    found = complete(method, noise()[0], np.full(SHAPE, 0.8), valid)
    np.testing.assert_allclose(found.depth_m, 0.8, rtol=1e-4)


@pytest.mark.parametrize("method", METHODS, ids=named)
def test_two_runs_agree_bit_for_bit(method: Method) -> None:
    one, two = (complete(method, *noise()).depth_m for _ in range(2))
    assert one.tobytes() == two.tobytes()


def test_a_slanted_plane_is_continued_exactly_by_the_membrane() -> None:
    """Inverse depth of a plane is linear in the image, and linear is harmonic."""
    v, u = np.indices(SHAPE)
    depth = 1 / (0.4 + 0.003 * u + 0.005 * v)
    found = complete(Poisson(), EVEN, depth, hole())
    np.testing.assert_allclose(found.depth_m, depth, rtol=1e-5)


@pytest.mark.parametrize("method", GUIDED, ids=named)
def test_a_hole_across_an_image_edge_gets_each_side_s_depth(method: Method) -> None:
    image, depth = np.full(SHAPE, 60, np.uint8), np.full(SHAPE, 1.0)
    image[:, 40:], depth[:, 40:] = 200, 2.0
    # Lopsided, so that the middle of the hole is not where the image has its edge.
    valid = hole()
    found = complete(method, image, depth, valid).depth_m
    off = np.abs(found - depth)
    assert off[~valid].mean() < 0.05
    away = np.abs(np.arange(SHAPE[1]) - 39.5) > 5
    assert off[:, away].max() < 0.1
    blind = complete(method, EVEN, depth, valid).depth_m
    assert np.abs(blind - depth)[~valid].mean() > 2 * off[~valid].mean()


def test_the_nearest_pixel_gives_its_depth() -> None:
    depth = np.broadcast_to(np.where(np.arange(SHAPE[1]) < 48, 1.0, 2.0), SHAPE)
    found = complete(Nearest(), EVEN, depth, hole(slice(None), slice(40, 60))).depth_m
    assert (found[:, :50] == 1).all() and (found[:, 50:] == 2).all()


def test_morphology_lets_the_near_surface_grow() -> None:
    depth = np.broadcast_to(np.where(np.arange(SHAPE[1]) < 48, 1.0, 2.0), SHAPE)
    valid = hole(slice(None), slice(46, 70))
    found = complete(Morphological(), EVEN, depth, valid).depth_m
    np.testing.assert_allclose(found[:, 46:60], 1.0, rtol=1e-3)


@pytest.mark.parametrize("method", METHODS, ids=named)
def test_a_false_match_alone_in_a_hole_is_not_spread(method: Method) -> None:
    """A few pixels of 9 m in a hole of a wall at 1 m: they stay, and nothing else is moved."""
    depth, valid = np.full(SHAPE, 1.0), hole()
    depth[34:37, 40:46], valid[34:37, 40:46] = 9.0, True
    found = complete(method, EVEN, depth, valid).depth_m
    assert (found[34:37, 40:46] == 9).all()
    np.testing.assert_allclose(found[~valid], 1.0, rtol=1e-3)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Morphological(large_px=1), r"large_px must be in \[3, 255\]; got 1"),
        (lambda: Morphological(small_px=4), "small_px must be odd; got 4"),
        (lambda: Morphological(median_px=7), r"median_px must be in \[1, 5\]; got 7"),
        (lambda: Bilateral(sigma_px=0.0), "sigma_px must be in"),
        (lambda: Bilateral(sigma_level=0.0), "sigma_level must be in"),
        (lambda: Bilateral(coarse_weight=0.0), "coarse_weight must be in"),
        (lambda: Bilateral(guide_smoothing_px=-1.0), "guide_smoothing_px must be in"),
        (lambda: WeightedLeastSquares(smoothness=0.0), "smoothness must be in"),
        (lambda: WeightedLeastSquares(sigma_level=0.0), "sigma_level must be in"),
        (lambda: WeightedLeastSquares(guide_smoothing_px=-1.0), "guide_smoothing_px must be in"),
        (lambda: Poisson(sigma_level=0.0), "sigma_level must be in"),
        (lambda: Poisson(least=0.0), "least must be in"),
        (lambda: Poisson(guide_smoothing_px=-1.0), "guide_smoothing_px must be in"),
    ],
)
def test_settings_that_cannot_be_are_refused(build, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build()
