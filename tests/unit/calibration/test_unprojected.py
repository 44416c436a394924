"""A pattern as an image, by least squares over views that are made of it."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from starling.calibration.pattern import cosine_image, unprojected
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.modulation import Modulation, high_passed
from starling.calibration.pattern.unprojected import PatternImage, Placed

GRID = Grid(half_a=0.32, half_b=0.2, step=2.5e-3)
SHAPE = (180, 280)
FOCAL_PX = 420.0
NOISE = 0.15  # Of a view, beside dots of unit deviation: the most weight that modulation gives.
BLUR_PX = 0.6
BLIND_PX = 60  # Columns at the left of every view that are not usable.
MARGIN_PX = 26  # Of the other borders: filters that reach over them are not their own transpose.


def _truth(seed: int = 0) -> np.ndarray:
    """Scattered dots two pixels wide, about their mean, of unit deviation."""
    rng = np.random.default_rng(seed)
    points = (rng.random(GRID.shape) < 1 / 60).astype(np.float32)
    image = cv2.GaussianBlur(points, (0, 0), 1.1)
    return ((image - image.mean()) / image.std()).astype(np.float32)


def _cosines(shift: float) -> np.ndarray:
    """Nominal cosines (h w, 2) of a view's pixels, sheared a little by how the surface lies."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    a = (x - SHAPE[1] / 2) / FOCAL_PX + shift + 0.03 * (y - SHAPE[0] / 2) / FOCAL_PX
    b = (y - SHAPE[0] / 2) / FOCAL_PX - 0.4 * shift
    return np.stack([a.ravel(), b.ravel()], axis=1).astype(np.float32)


def _view(value: np.ndarray, number: int, gain: float = 0.8) -> Placed:
    """A view of the pattern; its left part is not usable."""
    rng = np.random.default_rng([5, number])
    cosines = _cosines([-0.02, 0.013, 0.021, -0.008][number])
    image = np.zeros(SHAPE[0] * SHAPE[1], np.float32)
    cosine_image.read(value, GRID.place(cosines), image)
    blurred = np.asarray(cv2.GaussianBlur(image.reshape(SHAPE), (0, 0), BLUR_PX), np.float32)
    seen = gain * high_passed(blurred) + NOISE * rng.standard_normal(SHAPE)
    weight = np.full(SHAPE, 1 / NOISE**2, np.float32)
    weight[:, :BLIND_PX] = 0
    weight[:MARGIN_PX], weight[-MARGIN_PX:], weight[:, -MARGIN_PX:] = 0, 0, 0
    return Placed(
        modulation=Modulation(value=seen.astype(np.float32), weight=weight),
        cosines=cosines,
        blur_px=BLUR_PX,
    )


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    return _truth()


@pytest.fixture(scope="module")
def found(truth: np.ndarray) -> PatternImage:
    return unprojected.solve([_view(truth, number) for number in range(4)], GRID)


def _inside(found: PatternImage) -> np.ndarray:
    """Where all views looked, away from the border of any."""
    seen = (found.views >= found.views.max()).astype(np.uint8)
    return cv2.erode(seen, np.ones((15, 15), np.uint8)).astype(bool)


def _correlation(found: PatternImage, truth: np.ndarray) -> float:
    inside = _inside(found)
    return float(np.corrcoef(found.value[inside], truth[inside])[0, 1])


def test_the_pattern_is_recovered_where_views_looked(
    found: PatternImage, truth: np.ndarray
) -> None:
    """Noise through the imager's blur leaves 0.96; the mirrored pattern correlates by chance.

    Chance: a standard error of one over the root of the number of dots, here 0.06.
    """
    assert _inside(found).mean() > 0.3
    assert _correlation(found, truth) > 0.95
    assert abs(_correlation(found, truth[:, ::-1])) < 0.2


def test_a_local_gain_is_no_part_of_the_pattern(truth: np.ndarray) -> None:
    """One view twice as strong as another: the same pattern."""
    views = [_view(truth, n, gain) for n, gain in enumerate((0.5, 1.0, 0.7, 0.9))]
    assert _correlation(unprojected.solve(views, GRID), truth) > 0.95


def test_coverage_counts_views(found: PatternImage) -> None:
    assert found.views.max() == 4 and found.views.min() == 0
    assert (np.rint(found.views) == found.views).all()
    one = unprojected.solve([_view(_truth(), 0)], GRID)
    assert set(np.unique(one.views)) == {0, 1}
    # Columns that are not usable: the pattern's own there were not looked at.
    at = GRID.place(np.stack([_cosines(-0.02)[:, 0], _cosines(-0.02)[:, 1]], axis=1))
    middle = (SHAPE[0] // 2) * SHAPE[1]
    row, column = round(at[middle + BLIND_PX, 1]), at[middle + BLIND_PX, 0]
    assert not one.views[row, : int(column) - 2].any()
    assert one.views[row, int(column) + 3]


def test_where_nothing_looked_nothing_is_known(found: PatternImage) -> None:
    blind = found.views == 0
    assert blind.any()
    assert np.isinf(found.sd[blind]).all()
    assert np.isfinite(found.sd[~blind]).mean() > 0.99


def test_the_deviation_is_that_of_the_errors(found: PatternImage, truth: np.ndarray) -> None:
    """Errors as the imager blurs them, over their stated deviation: unit width within two.

    Single pixels of the pattern err more; no more than this is promised.
    """
    # What the views' high-pass takes off is of no view's business.
    error = cv2.GaussianBlur(high_passed(found.value - truth), (0, 0), BLUR_PX)
    off = (error / found.sd)[_inside(found)]
    assert 0.5 < float(np.sqrt(np.mean(off**2))) < 2


def test_a_start_is_gone_on_from(found: PatternImage, truth: np.ndarray) -> None:
    """One more round from what was found changes little; one round from nothing is worse."""
    views = [_view(truth, number) for number in range(4)]
    more = unprojected.solve(views, GRID, start=found.value, rounds=1)
    less = unprojected.solve(views, GRID, rounds=1, steps=2)
    assert _correlation(more, truth) > _correlation(found, truth) - 0.01
    assert _correlation(less, truth) < _correlation(more, truth)


def test_the_transposed_model_is_the_model_s_transpose(truth: np.ndarray) -> None:
    """<w g A p, r> = <p, A' g w r> for a view's model A; single precision, 1e-4."""
    rng = np.random.default_rng(8)
    one = dataclasses.replace(_view(truth, 1), gain=np.full(SHAPE, 0.7, np.float32))
    one = dataclasses.replace(one, cosines=GRID.place(one.cosines))
    residual = rng.standard_normal(SHAPE).astype(np.float32)
    back = np.zeros(GRID.shape, np.float32)
    unprojected._transposed(one, residual, back)
    model = 0.7 * unprojected.predicted(one, truth)
    forth = np.vdot((one.modulation.weight * model).astype(np.float64), residual)
    assert forth == pytest.approx(float(np.vdot(truth.astype(np.float64), back)), rel=1e-3)


def test_noise_that_weights_do_not_know_of_is_in_the_deviation(truth: np.ndarray) -> None:
    """Weights four times too large: residuals show it, and deviations are what they were."""
    plain = _view(truth, 0)
    sure = plain.modulation._replace(weight=4 * plain.modulation.weight)
    one, other = (
        unprojected.solve([view], GRID, rounds=1)
        for view in (plain, dataclasses.replace(plain, modulation=sure))
    )
    looked = np.isfinite(one.sd)
    np.testing.assert_allclose(other.sd[looked], one.sd[looked], rtol=0.02)


@pytest.mark.parametrize(("times", "gain"), [(0.7, 0.7), (10.0, 3.0), (-1.0, 0.1)])
def test_a_local_gain_is_one_that_surfaces_have(
    truth: np.ndarray, times: float, gain: float
) -> None:
    view = _view(truth, 0)
    view = dataclasses.replace(view, cosines=GRID.place(view.cosines))
    shown = (times * unprojected.predicted(view, truth)).astype(np.float32)
    seen = dataclasses.replace(view, modulation=view.modulation._replace(value=shown))
    found = unprojected.with_gain(seen, truth).gain
    assert found is not None
    np.testing.assert_allclose(found[60:-60, 90:-60], gain, rtol=1e-3)
