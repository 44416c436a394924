"""Recovery of a pattern image by least squares over synthetic views."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from starling.calibration.correlation import without_mean
from starling.calibration.pattern import cosine_image, unprojected
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.unprojected import PatternImage, PlacedView
from starling.calibration.pattern.views import Modulation

GRID = Grid(half_a=0.32, half_b=0.2, step=2.5e-3)
SHAPE = (180, 280)
FOCAL_PX = 420.0
NOISE = 0.15  # Noise of a view, for dots of unit deviation; gives about the maximum weight.
BLUR_PX = 0.6
BLIND_PX = 60  # Unusable columns at the left of each view.
MARGIN_PX = 26  # Unusable margin at the other borders, where filters are not self-adjoint.


def _truth(seed: int = 0) -> np.ndarray:
    """Return random dots two pixels wide, with zero mean and unit deviation."""
    rng = np.random.default_rng(seed)
    points = (rng.random(GRID.shape) < 1 / 60).astype(np.float32)
    image = cv2.GaussianBlur(points, (0, 0), 1.1)
    return ((image - image.mean()) / image.std()).astype(np.float32)


def _cosines(shift: float) -> np.ndarray:
    """Return nominal cosines (h w, 2) of a view's pixels on a slightly slanted surface."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    a = (x - SHAPE[1] / 2) / FOCAL_PX + shift + 0.03 * (y - SHAPE[0] / 2) / FOCAL_PX
    b = (y - SHAPE[0] / 2) / FOCAL_PX - 0.4 * shift
    return np.stack([a.ravel(), b.ravel()], axis=1).astype(np.float32)


def _view(value: np.ndarray, number: int, gain: float = 0.8) -> PlacedView:
    """Return a noisy view of the pattern with an unusable left part."""
    rng = np.random.default_rng([5, number])
    cosines = _cosines([-0.02, 0.013, 0.021, -0.008][number])
    image = np.zeros(SHAPE[0] * SHAPE[1], np.float32)
    cosine_image.read(value, GRID.place(cosines), image)
    blurred = np.asarray(cv2.GaussianBlur(image.reshape(SHAPE), (0, 0), BLUR_PX), np.float32)
    seen = gain * without_mean(blurred) + NOISE * rng.standard_normal(SHAPE)
    weight = np.full(SHAPE, 1 / NOISE**2, np.float32)
    weight[:, :BLIND_PX] = 0
    weight[:MARGIN_PX], weight[-MARGIN_PX:], weight[:, -MARGIN_PX:] = 0, 0, 0
    return PlacedView(
        modulation=Modulation(value=seen.astype(np.float32), weight=weight),
        cosines=cosines,
        blur_px=BLUR_PX,
    )


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    return _truth()


@pytest.fixture(scope="module")
def pattern(truth: np.ndarray) -> PatternImage:
    return unprojected.solve([_view(truth, number) for number in range(4)], GRID)


def _inside(pattern: PatternImage) -> np.ndarray:
    """Return the mask of full coverage, away from borders of views."""
    seen = (pattern.views >= pattern.views.max()).astype(np.uint8)
    return cv2.erode(seen, np.ones((15, 15), np.uint8)).astype(bool)


def _correlation(pattern: PatternImage, truth: np.ndarray) -> float:
    inside = _inside(pattern)
    return float(np.corrcoef(pattern.value[inside], truth[inside])[0, 1])


def test_the_pattern_is_recovered_in_covered_directions(
    pattern: PatternImage, truth: np.ndarray
) -> None:
    """Noise and blur limit the correlation to 0.96; the mirrored pattern has chance correlation.

    The chance correlation has a standard error of 0.06, from the number of dots.
    """
    assert _inside(pattern).mean() > 0.3
    assert _correlation(pattern, truth) > 0.95
    assert abs(_correlation(pattern, truth[:, ::-1])) < 0.2


def test_local_gain_does_not_change_the_pattern(truth: np.ndarray) -> None:
    """Views of different strength give the same pattern."""
    views = [_view(truth, n, gain) for n, gain in enumerate((0.5, 1.0, 0.7, 0.9))]
    assert _correlation(unprojected.solve(views, GRID), truth) > 0.95


def test_coverage_counts_views(pattern: PatternImage) -> None:
    assert pattern.views.max() == 4 and pattern.views.min() == 0
    assert (np.rint(pattern.views) == pattern.views).all()
    single = unprojected.solve([_view(_truth(), 0)], GRID)
    assert set(np.unique(single.views)) == {0, 1}
    # Unusable columns of the view do not count as coverage.
    places = GRID.place(np.stack([_cosines(-0.02)[:, 0], _cosines(-0.02)[:, 1]], axis=1))
    middle = (SHAPE[0] // 2) * SHAPE[1]
    row, column = round(places[middle + BLIND_PX, 1]), places[middle + BLIND_PX, 0]
    assert not single.views[row, : int(column) - 2].any()
    assert single.views[row, int(column) + 3]


def test_uncovered_directions_have_infinite_deviation(pattern: PatternImage) -> None:
    blind = pattern.views == 0
    assert blind.any()
    assert np.isinf(pattern.sd[blind]).all()
    assert np.isfinite(pattern.sd[~blind]).mean() > 0.99


def test_the_deviation_matches_the_errors(pattern: PatternImage, truth: np.ndarray) -> None:
    """The blurred error over the reported deviation has a width of 1 within a factor of 2.

    Errors of single pixels are larger; the reported deviation does not include them.
    """
    # The views do not determine what their high-pass filter removes.
    error = cv2.GaussianBlur(without_mean(pattern.value - truth), (0, 0), BLUR_PX)
    off = (error / pattern.sd)[_inside(pattern)]
    assert 0.5 < float(np.sqrt(np.mean(off**2))) < 2


def test_an_initial_pattern_is_used(pattern: PatternImage, truth: np.ndarray) -> None:
    """One round from the solution changes little; one round from zero is worse."""
    views = [_view(truth, number) for number in range(4)]
    more = unprojected.solve(views, GRID, start=pattern.value, rounds=1)
    less = unprojected.solve(views, GRID, rounds=1, steps=2)
    assert _correlation(more, truth) > _correlation(pattern, truth) - 0.01
    assert _correlation(less, truth) < _correlation(more, truth)


def test_the_transposed_model_is_the_model_s_transpose(truth: np.ndarray) -> None:
    """<w g A p, r> = <p, A' g w r> for a view's model A; single precision, 1e-4."""
    rng = np.random.default_rng(8)
    view = dataclasses.replace(_view(truth, 1), gain=np.full(SHAPE, 0.7, np.float32))
    view = dataclasses.replace(view, cosines=GRID.place(view.cosines))
    residual = rng.standard_normal(SHAPE).astype(np.float32)
    back = np.zeros(GRID.shape, np.float32)
    unprojected._transposed(view, residual, back)
    model = 0.7 * unprojected.predict(view, truth)
    forth = np.vdot((view.modulation.weight * model).astype(np.float64), residual)
    assert forth == pytest.approx(float(np.vdot(truth.astype(np.float64), back)), rel=1e-3)


def test_the_deviation_is_independent_of_the_scale_of_weights(truth: np.ndarray) -> None:
    """Weights that are four times too large do not change the deviations."""
    plain = _view(truth, 0)
    sure = plain.modulation._replace(weight=4 * plain.modulation.weight)
    plain_pattern, sure_pattern = (
        unprojected.solve([view], GRID, rounds=1)
        for view in (plain, dataclasses.replace(plain, modulation=sure))
    )
    looked = np.isfinite(plain_pattern.sd)
    np.testing.assert_allclose(sure_pattern.sd[looked], plain_pattern.sd[looked], rtol=0.02)


@pytest.mark.parametrize(("times", "gain"), [(0.7, 0.7), (10.0, 3.0), (-1.0, 0.1)])
def test_local_gain_is_limited(truth: np.ndarray, times: float, gain: float) -> None:
    view = _view(truth, 0)
    view = dataclasses.replace(view, cosines=GRID.place(view.cosines))
    shown = (times * unprojected.predict(view, truth)).astype(np.float32)
    seen = dataclasses.replace(view, modulation=view.modulation._replace(value=shown))
    gain_map = unprojected.with_gain(seen, truth).gain
    assert gain_map is not None
    np.testing.assert_allclose(gain_map[60:-60, 90:-60], gain, rtol=1e-3)
