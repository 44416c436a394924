"""Parts of the normal equations of infrared images, against hand-computed values."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.calibration import parameters
from starling.calibration.geometry import residuals
from starling.calibration.geometry.residuals import LevelVariance, PredictedView, ViewEquations
from starling.calibration.least_squares import variable_projection
from starling.calibration.parameters import DOT_BLUR, FIELD, CalibrationParameter
from starling.sim.sensor import presets

SIZE = 16
SHAPE = (64, 640)  # Squares of three tiles.


def test_variance_grows_with_the_level_and_its_square() -> None:
    level = np.array([[-5.0, 0.0, 10.0]], np.float32)
    np.testing.assert_allclose(
        LevelVariance(2.0, 0.3, 0.04).at_level(level), [[2.0, 2.0, 9.0]], rtol=1e-6
    )
    assert (LevelVariance(0.0, 0.0, 0.0).at_level(level) > 0).all()


def test_stiffness_is_curvature_over_weight() -> None:
    """For residuals r and Cauchy scale c it is (1 - r^2/c^2) / (1 + r^2/c^2); 0 is ignored."""
    square = 0.25
    residual = np.array([[1.0, -1.0, 0.0, 1.0]], np.float32) * np.float32(2.5 * square**0.5)
    assert residuals._stiffness(residual) == pytest.approx((1 - square) / (1 + square), rel=1e-5)
    assert residuals._stiffness(np.zeros((2, 3), np.float32)) == 1.0
    assert residuals._stiffness(100 * residual) == 0.1


def clustered(side: str, tile: int, disparity_px: float) -> int:
    """Return the cluster number of a tile in the first row."""
    predicted: Any = SimpleNamespace(
        light=np.zeros(SHAPE, np.float32),
        view=SimpleNamespace(side=side),
        disparity_px=np.full(SHAPE, disparity_px, np.float32),
    )
    parts = np.zeros((SHAPE[0] // SIZE * SHAPE[1] // SIZE, 1))
    parts[tile] = 1.0
    summed = residuals._sum_clusters(parts, predicted, SIZE)
    (number,) = np.flatnonzero(summed[:, 0])
    return int(number)


@pytest.mark.parametrize("tiles_off", [3, 6])
def test_both_imagers_share_clusters(tiles_off: int) -> None:
    """A point at x in the right image is at x + d in the left."""
    for tile in (10, 17):
        right = clustered("right", tile, float(tiles_off * SIZE))
        assert right == clustered("left", tile + tiles_off, float(tiles_off * SIZE))
        assert right != clustered("left", tile, 0.0)
    assert clustered("right", 17, float("nan")) == clustered("left", 17, 0.0)


def test_a_cluster_spans_three_tiles_of_this_image() -> None:
    """Its side is 7.5 % of the width, in whole tiles."""
    numbers = [clustered("left", tile, 0.0) for tile in range(7)]
    assert numbers[0] == numbers[1] == numbers[2] < numbers[3] == numbers[5] < numbers[6]


def test_the_main_body_of_a_tile_is_used() -> None:
    body = np.full((SIZE, 2 * SIZE), 3, np.uint32)
    body[:, :6] = 1
    body[4:, SIZE:] = 0
    mask = residuals._main_body(body, SIZE)
    np.testing.assert_array_equal(mask[:, :SIZE], body[:, :SIZE] == 3)
    np.testing.assert_array_equal(mask[:, SIZE:], body[:, SIZE:] == 0)


def test_columns_use_the_parameters_variable() -> None:
    """The field uses a relative step, the width of dots its variance."""
    sensor = presets.load("d415")

    def row(name: str) -> CalibrationParameter:
        return CalibrationParameter(name=name, group="", unit="", tolerance=0.02)

    half = parameters.value(sensor, FIELD)
    assert residuals._per_tolerance(row(FIELD), sensor) == pytest.approx(0.02 / half)
    assert residuals._per_tolerance(row(DOT_BLUR), sensor) == pytest.approx(0.02**2)
    assert residuals._per_tolerance(row("baseline_m"), sensor) == 0.02


def test_robust_weight_and_cost_are_cauchys() -> None:
    """At 2.5 deviations the weight is a half; small residuals cost their square."""
    residual = np.array([[0.0, 2.5, -5.0]], np.float32)
    np.testing.assert_allclose(residuals._cauchy_weight(residual), [[1.0, 0.5, 0.2]], rtol=1e-6)
    assert residuals._cauchy_cost(residual) == pytest.approx(2.5**2 * np.log(2 * 5), rel=1e-6)
    small = np.full((3, 4), 0.01, np.float32)
    assert residuals._cauchy_cost(small) == pytest.approx(12e-4, rel=1e-3)


def test_margins_are_as_wide_as_requested() -> None:
    mask = np.ones((15, 17), bool)
    mask[7, 8] = False
    expected = mask.copy()
    expected[5:10, 6:11] = False
    np.testing.assert_array_equal(residuals._eroded(mask, 2), expected)
    np.testing.assert_array_equal(residuals._eroded(mask, 0), mask)


def test_blur_conserves_the_sum_and_zero_changes_nothing() -> None:
    image = np.zeros((21, 21), np.float32)
    image[10, 10] = 1
    blurred = residuals._blurred(image, 1.5)
    rows = np.indices(image.shape)[0] - 10
    assert blurred.sum() == pytest.approx(1, rel=1e-4)
    assert (blurred * rows**2).sum() == pytest.approx(1.5**2, rel=0.02)
    assert residuals._blurred(image, 0.0) is image


@pytest.mark.parametrize(("spacing_px", "side_px"), [(4, 12), (8, 20), (12, 32), (40, 48)])
def test_a_tile_holds_about_six_dots(spacing_px: int, side_px: int) -> None:
    """The side is 2.5 spacings, a multiple of 4 px between 12 and 48 px."""
    light = np.zeros((240, 320), np.float32)
    light[spacing_px // 2 :: spacing_px, spacing_px // 2 :: spacing_px] = 1
    light += np.random.default_rng(0).uniform(0, 1e-7, light.shape).astype(np.float32)
    peaks = np.zeros(light.shape, bool)
    peaks[spacing_px // 2 :: spacing_px, spacing_px // 2 :: spacing_px] = True
    usable = np.ones(light.shape, bool)
    if spacing_px > 8:  # Between distant dots, noise has peaks of its own.
        light = light + np.float32(0.1) * np.float32(residuals._blurred(light, spacing_px / 3.0))
    predicted: Any = SimpleNamespace(light=light, usable=usable)
    assert abs(residuals.tile_px([predicted, predicted]) - side_px) <= 4
    assert residuals.tile_px([predicted]) % 4 == 0


def eliminated(level: np.ndarray, deviation: np.ndarray, used: bool = True) -> Any:
    rng = np.random.default_rng(2)
    residual = (rng.standard_normal(level.shape) * deviation).astype(np.float32)
    return SimpleNamespace(residual=residual, used=np.full(level.shape[0], used))


def test_the_variance_of_residuals_is_measured_by_level() -> None:
    """Read noise, shot noise and speckle are separated; outliers do not count."""
    rng = np.random.default_rng(1)
    level = (150 * rng.random((200, 256)) ** 3).astype(np.float32)
    true = 2.0 + 0.3 * level + 0.004 * level**2
    fitted = eliminated(level, np.sqrt(true))
    fitted.residual[rng.random(level.shape) < 0.02] = 300.0
    variance = residuals._fit_variance(fitted, level, np.ones(level.shape, bool))
    for light in (1.0, 30.0, 120.0):
        expected = 2.0 + 0.3 * light + 0.004 * light**2
        result = float(variance.at_level(np.full((1, 1), light, np.float32))[0, 0])
        assert result == pytest.approx(expected, rel=0.12)


@pytest.mark.parametrize("count", [239, 240, 720])
def test_few_pixels_have_one_variance(count: int) -> None:
    """Up to 30 pixels a bin there is one variance, of all pixels, at all levels."""
    level = np.linspace(0, 100, 768, dtype=np.float32).reshape(3, 256)
    fitted = eliminated(level, np.full(level.shape, 3.0))
    counted = (np.arange(level.size) < count).reshape(level.shape)
    variance = residuals._fit_variance(fitted, level, counted)
    assert (variance.b, variance.c) == (0.0, 0.0)
    assert variance.a == pytest.approx(float(np.var(fitted.residual[counted])))
    fitted.used[:] = False
    assert residuals._fit_variance(fitted, level, counted) == LevelVariance(1.0, 0.0, 0.0)
    fitted.used[:], fitted.residual[:] = True, 0
    assert residuals._fit_variance(fitted, level, counted).a == 1e-3


@pytest.mark.parametrize("level_dn", [0.0, 40.0])
def test_pixels_of_one_level_have_a_variance_above_the_least_number(level_dn: float) -> None:
    level = np.full((3, 256), level_dn, np.float32)
    fitted = eliminated(level, np.full(level.shape, 9.0))
    counted = (np.arange(level.size) < 721).reshape(level.shape)
    variance = residuals._fit_variance(fitted, level, counted)
    result = float(variance.at_level(np.full((1, 1), level_dn, np.float32))[0, 0])
    assert result == pytest.approx(81.0, rel=0.25)


def equations(freedom: int, number: float, clusters: int) -> ViewEquations:
    return ViewEquations(
        information=np.full((2, 2), number),
        gradient=np.full(2, number),
        scores=np.full((clusters, 2), number),
        shares=np.full((clusters, 2, 2), number),
        stiffness=0.1 * number,
        cost=10 * number,
        freedom=freedom,
        deviation=number,
        variances=(LevelVariance(number, 0.0, 0.0),),
    )


def test_views_add_up() -> None:
    """Sums of information and cost; means by degrees of freedom; clusters side by side."""
    total = ViewEquations.total([equations(100, 1.0, 3), equations(300, 2.0, 4)])
    np.testing.assert_array_equal(total.information, np.full((2, 2), 3.0))
    np.testing.assert_array_equal(total.gradient, [3.0, 3.0])
    assert total.scores.shape == (7, 2) and total.shares.shape == (7, 2, 2)
    assert (total.scores[:3] == 1).all() and (total.shares[3:] == 2).all()
    assert total.stiffness == pytest.approx(0.175)
    assert (total.cost, total.freedom) == (30.0, 400)
    assert total.deviation == pytest.approx(1.75)
    assert [variance.a for variance in total.variances] == [1.0, 2.0]


RNG = np.random.default_rng(4)
LIGHT = residuals._blurred(RNG.uniform(10, 60, (96, 128)).astype(np.float32), 1.0)
COLUMN = residuals._blurred(RNG.normal(0, 10, (96, 128)).astype(np.float32), 1.0)


def predicted_view(level: np.ndarray, usable: np.ndarray | None = None) -> PredictedView:
    everywhere = np.ones(level.shape, bool)
    view: Any = SimpleNamespace(side="left", level=level.astype(np.float32), usable=everywhere)
    return PredictedView(
        view=view,
        light=LIGHT,
        columns={"a": COLUMN},
        usable=everywhere if usable is None else usable,
        disparity_px=np.full(level.shape, 4, np.float32),
        body=np.ones(level.shape, np.uint32),
    )


@pytest.mark.parametrize("blur_px", [0.0, 1.5])
def test_the_normal_equations_give_the_step(blur_px: float) -> None:
    """The image is that of a step of 0.3, with another reflectance and ambient light."""
    rows = np.indices(LIGHT.shape)[0]
    reflectance = 2.0 if blur_px else np.where(rows < 48, 0.5, 2.0)  # Blur mixes two tiles.
    level = reflectance * (LIGHT + 0.3 * COLUMN) + 20
    noise = RNG.normal(0, 0.1, level.shape)
    normal = residuals.normal_equations(
        predicted_view(level + noise),
        size_px=16,
        blur_px=blur_px,
        variance=LevelVariance(0.01, 0.0, 0.0),
    )
    step = -np.linalg.solve(normal.information, normal.gradient)
    assert step[0] == pytest.approx(0.3, abs=0.02)
    assert normal.deviation == pytest.approx(0.01)
    np.testing.assert_allclose(normal.scores.sum(axis=0), normal.gradient)
    np.testing.assert_allclose(normal.shares.sum(axis=0), normal.information)
    assert 0 < normal.stiffness < 1


def test_residuals_of_the_true_sensor_have_unit_variance() -> None:
    """The measured variance is that of the noise; the cost per degree of freedom is about 1."""
    level = 1.5 * LIGHT + 20 + RNG.normal(0, 2.0, LIGHT.shape)
    normal = residuals.normal_equations(
        predicted_view(level), size_px=16, blur_px=0.0, variance=None
    )
    (variance,) = normal.variances
    measured = float(variance.at_level(np.full((1, 1), 60, np.float32))[0, 0])
    assert measured == pytest.approx(4.0, rel=0.15)
    assert normal.deviation == pytest.approx(4.0, rel=0.15)
    assert 0.7 < normal.cost / normal.freedom < 1.05  # Robust: below the squares.
    assert abs(normal.gradient[0] / normal.information[0, 0]) < 0.02
    assert normal.freedom < LIGHT.size


def test_an_unusable_view_counts_nothing() -> None:
    dark = np.zeros(LIGHT.shape, bool)
    normal = residuals.normal_equations(
        predicted_view(LIGHT, dark), size_px=16, blur_px=0.0, variance=None
    )
    assert not normal.information.any() and not normal.gradient.any()
    assert (normal.freedom, normal.deviation) == (1, 1.0)


def test_blur_widens_the_margin_to_unusable_pixels() -> None:
    """Twice the blur: a wrong pixel within its mask changes nothing."""
    usable = np.ones(LIGHT.shape, bool)
    usable[40, 60] = False
    level = 1.5 * LIGHT + RNG.normal(0, 0.5, LIGHT.shape)
    wrong = level.copy()
    wrong[40, 60] += 1.0
    first, second = (
        residuals.normal_equations(
            predicted_view(image, usable), size_px=16, blur_px=0.0, variance=LevelVariance(1, 0, 0)
        )
        for image in (level, wrong)
    )
    np.testing.assert_allclose(first.gradient, second.gradient, rtol=1e-9)
    blurred = residuals.normal_equations(
        predicted_view(level, usable), size_px=16, blur_px=2.0, variance=LevelVariance(1, 0, 0)
    )
    everywhere = residuals.normal_equations(
        predicted_view(level), size_px=16, blur_px=2.0, variance=LevelVariance(1, 0, 0)
    )
    assert everywhere.freedom - blurred.freedom == 81  # A square of 9 x 9 px.


def test_a_tile_that_darkens_with_the_light_does_not_count() -> None:
    """A negative reflectance is a wrong match: the tile has no information."""
    level = 1.5 * LIGHT
    level[:16, :16] = 100 - LIGHT[:16, :16]
    bad, good = (
        residuals.normal_equations(
            predicted_view(image), size_px=16, blur_px=0.0, variance=LevelVariance(1, 0, 0)
        )
        for image in (level, 1.5 * LIGHT)
    )
    assert bad.information[0, 0] < good.information[0, 0]
    tile = replace(predicted_view(level), usable=np.zeros(LIGHT.shape, bool))
    tile.usable[:16, :16] = True
    alone = residuals.normal_equations(
        tile, size_px=16, blur_px=0.0, variance=LevelVariance(1, 0, 0)
    )
    assert not alone.information.any()


def test_saturated_pixels_of_a_view_are_unusable() -> None:
    """Levels from 98 % of the highest code are not used."""
    sensor = presets.load("d415")
    level = np.full((4, 4), 0.97 * sensor.left.saturation_dn, np.float32)
    level[0] = 0.985 * sensor.left.saturation_dn
    observation: Any = SimpleNamespace(
        name="a", scene="scene", left=level, right=level, stage="stage", metric=True, info=None
    )
    left, right = residuals.make_views([observation], sensor)
    assert (left.side, right.side) == ("left", "right")
    assert not left.usable[0].any() and left.usable[1:].all()
    assert left.reference is None and left.scene == "a"
    (view,) = residuals.make_views([observation], presets.load("kinect-v1"))
    assert view.side == "left"
    observation.right = None
    assert len(residuals.make_views([observation], sensor)) == 1


def test_tiles_join_to_the_image_they_were_cut_from() -> None:
    image = np.arange(96 * 128, dtype=np.float32).reshape(96, 128)
    joined = variable_projection.join(variable_projection.cut(image, 16), image.shape, 16)
    np.testing.assert_array_equal(joined, image)
