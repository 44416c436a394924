"""Steps of a geometry fit without rendering: orchestration, window matching, initial values."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.calibration import parameters
from starling.calibration.geometry import geometry_fit, start
from starling.calibration.geometry.start import GeometryStart, _Windows
from starling.calibration.least_squares.solve import SolveResult
from starling.calibration.least_squares.uncertainty import Uncertainty
from starling.patterns.errors import InputError
from starling.sim.sensor import presets

SENSOR = presets.load("d435")
ROWS = parameters.free(("baseline", "focal"), SENSOR)
SPREAD = 0.7


def test_a_solution_is_in_the_units_of_the_parameters() -> None:
    """Deviations and covariance scale with the tolerances; open parameters are infinite."""
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    uncertainties = Uncertainty(
        covariance=covariance, open=np.array([False, True]), directions=np.array([[0.0, 0.3]])
    )
    step = np.array([0.5, -1.0])
    solved: Any = SolveResult(step=step, equations=None, costs=(1.5, 1.0))
    solution = geometry_fit.solution(solved, uncertainties, SENSOR, ROWS)
    unit = np.array([row.tolerance for row in ROWS])
    assert [estimate.name for estimate in solution.estimates] == [row.name for row in ROWS]
    for row, estimate, change in zip(ROWS, solution.estimates, step, strict=True):
        assert estimate.start == parameters.value(SENSOR, row.name)
        assert estimate.value == pytest.approx(estimate.start + change * row.tolerance)
        assert estimate.value == parameters.value(solution.sensor, row.name)
        assert estimate.unit == row.unit
    assert solution.estimates[0].sd == pytest.approx(0.2 * unit[0])
    assert np.isinf(solution.estimates[1].sd)
    expected = covariance * np.outer(unit, unit)
    expected[1, 1] = np.inf
    np.testing.assert_allclose(solution.covariance, expected)
    assert solution.cost == (1.5, 1.0)
    (sentence,) = solution.undetermined
    assert sentence.startswith(ROWS[1].name)
    assert "focal_baseline_px_m" in [estimate.name for estimate in solution.derived]


class Fit:
    """Replaces the renderer, the initial values and the solver of a fit."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, correlation: float) -> None:
        self.predicted: list[tuple[Any, Any, int]] = []
        self.equations: list[dict[str, Any]] = []
        self.inflation = 0.0
        self.reference: Any = None
        initial = GeometryStart(step=np.zeros(len(ROWS)), correlation=correlation)
        module = geometry_fit
        monkeypatch.setattr(module.residuals, "make_views", lambda *_: ("first", "second"))
        monkeypatch.setattr(module.start, "find_start", lambda *_: initial)
        monkeypatch.setattr(module.residuals, "predict", self.predict)
        monkeypatch.setattr(module.residuals, "tile_px", lambda parts: 10 + len(self.predicted))
        monkeypatch.setattr(module.residuals, "normal_equations", self.normal_equations)
        monkeypatch.setattr(module.ViewEquations, "total", staticmethod(lambda parts: parts))
        monkeypatch.setattr(module.solve, "solve", self.solve)
        monkeypatch.setattr(module.uncertainty, "estimate", self.estimate)

    def predict(self, view: str, sensor: Any, free: Any, *, subpixels: int) -> Any:
        self.predicted.append((view, sensor, subpixels))
        return (view, sensor.baseline_m)

    def normal_equations(self, view: Any, **options: Any) -> Any:
        self.equations.append({"view": view} | options)
        return view

    def solve(self, coarse: Any, fine: Any, step: Any, *, inflation: float) -> Any:
        self.inflation = inflation
        coarse(step, None)
        fine(step, self.reference)
        fine(step + 1.0, self.reference)
        return SolveResult(step=step, equations="equations", costs=(1.0,))

    def estimate(self, equations: Any) -> Uncertainty:
        assert equations == "equations"
        count = len(ROWS)
        return Uncertainty(
            covariance=np.eye(count), open=np.zeros(count, bool), directions=np.zeros((0, count))
        )


def test_a_fit_renders_each_step_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tiles keep the size of the first step; a reference fixes the variances."""
    fit = Fit(monkeypatch, correlation=0.1)
    fit.reference = SimpleNamespace(variances=("a", "b"))
    geometry_fit.fit_geometry((), SENSOR, free=("baseline", "focal"), subpixels=3)
    assert [(view, subpixels) for view, _, subpixels in fit.predicted] == [
        ("first", 3),
        ("second", 3),
    ] * 2
    moved = start.apply_step(SENSOR, ROWS, np.ones(len(ROWS)))
    assert [sensor.baseline_m for _, sensor, _ in fit.predicted] == pytest.approx(
        [SENSOR.baseline_m] * 2 + [moved.baseline_m] * 2
    )
    blur_px = SENSOR.width / 640
    assert [call["blur_px"] for call in fit.equations] == pytest.approx([blur_px] * 2 + [0.0] * 4)
    assert [call["variance"] for call in fit.equations] == [None, None, "a", "b", "a", "b"]
    assert [call["size_px"] for call in fit.equations] == [12] * 6
    assert fit.inflation == pytest.approx(4 * np.pi * blur_px**2)


def test_a_fit_has_two_samples_per_pixel_and_axis(monkeypatch: pytest.MonkeyPatch) -> None:
    fit = Fit(monkeypatch, correlation=1.0)
    geometry_fit.fit_geometry((), SENSOR, free=("baseline", "focal"))
    assert {subpixels for _, _, subpixels in fit.predicted} == {2}


def test_the_inflation_of_a_small_blur_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    fit = Fit(monkeypatch, correlation=1.0)
    monkeypatch.setattr(geometry_fit, "_BLUR_SHARE", 1e-6)
    geometry_fit.fit_geometry((), SENSOR, free=("baseline", "focal"))
    assert fit.inflation == 1.0


def test_windows_below_a_tenth_of_correlation_show_no_dots(monkeypatch: pytest.MonkeyPatch) -> None:
    Fit(monkeypatch, correlation=0.0999)
    with pytest.raises(
        InputError, match=r"must show the sensor.s dots; got a correlation of 0\.10"
    ):
        geometry_fit.fit_geometry((), SENSOR, free=("baseline", "focal"))


@pytest.mark.parametrize("metric", [False, True])
@pytest.mark.parametrize("field", [False, True])
def test_reference_depth_alone_leaves_the_scale_of_a_free_field_open(
    monkeypatch: pytest.MonkeyPatch, metric: bool, field: bool
) -> None:
    Fit(monkeypatch, correlation=1.0)
    names = {"baseline_m", parameters.FIELD if field else "fx_px"}
    rows = tuple(row for row in parameters.TABLE if row.name in names)
    monkeypatch.setattr(geometry_fit.parameters, "free", lambda *_: rows)
    solved = [SimpleNamespace(metric=False), SimpleNamespace(metric=metric)]
    solution = geometry_fit.fit_geometry(solved, SENSOR)  # pyright: ignore[reportArgumentType]
    assert bool(solution.undetermined) == (field and not metric)


def test_dot_width_has_a_unit_even_without_width() -> None:
    """The step is in variance: half a tolerance squared over the width, at least a tenth."""
    (row,) = parameters.free(("dots",), SENSOR)
    sharp = parameters.with_values(SENSOR, [(parameters.DOT_BLUR, 0.0)])
    assert geometry_fit._unit(row, sharp) == pytest.approx(5 * row.tolerance)
    assert geometry_fit._unit(ROWS[0], SENSOR) == ROWS[0].tolerance


def paraboloid(reach: int, peak: tuple[float, float], height: float = 0.9) -> np.ndarray:
    """Correlation of a window by shift, highest at `peak` (x, y)."""
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return height - 0.01 * ((x - peak[0]) ** 2 + (y - peak[1]) ** 2)


def windows(peaks: np.ndarray, slopes: np.ndarray, reach: int = 12) -> _Windows:
    maps = np.array([paraboloid(reach, (x, y)) for x, y in peaks], np.float32)
    return _Windows(maps=maps, slopes=slopes)


def test_a_step_weighs_shifts_against_the_prior() -> None:
    """A shift s of weight w gives s w / (w + 0.49), for a unit prior and a spread of 0.7 px."""
    slopes = np.eye(2)[None]
    shift = np.array([[3.0, -1.0]])
    for weight in (1.0, 4.0):
        step = start._solve_step(slopes, shift, np.array([weight]))
        np.testing.assert_allclose(step, shift[0] * weight / (weight + SPREAD**2))
    both = start._solve_step(np.repeat(slopes, 2, 0), np.repeat(shift, 2, 0), np.array([1.0, 3.0]))
    np.testing.assert_allclose(both, shift[0] * 4 / (4 + SPREAD**2))


def test_correlation_is_read_at_the_rounded_shift() -> None:
    """x is the last axis; shifts out of range have no correlation."""
    maps = np.arange(25, dtype=np.float32).reshape(1, 5, 5)
    window = _Windows(maps=maps, slopes=np.eye(2)[None])
    assert window.reach == 2
    shifts = [(0, 0), (1.4, -0.6), (2, 2), (-2, -2), (2.6, 0), (0, -2.6), (-2.6, 0), (0, 2.6)]
    values = [float(start._correlation_at(window, np.array(shift))[0]) for shift in shifts]
    assert values == [12, 8, 24, 0, 0, 0, 0, 0]
    maps[:] = 7
    assert start._correlation_at(window, np.array([-2, -2]))[0] == 7


@pytest.mark.parametrize("radius", [2, 4])
def test_the_nearest_peak_has_a_fraction_of_a_pixel(radius: int) -> None:
    peaks = np.array([[1.3, -0.4], [-2.2, 3.25]])
    near = np.rint(peaks) + np.array([[radius, -radius], [0, 0]])
    shift, height = start._nearest_peaks(windows(peaks, np.zeros((2, 2, 1))), near, radius)
    np.testing.assert_allclose(shift, peaks, atol=1e-3)
    np.testing.assert_allclose(height, [0.8975, 0.899], atol=1e-4)
    beyond = np.rint(peaks) + np.array([[radius + 2, 0], [0, -radius - 2]])
    shift, _ = start._nearest_peaks(windows(peaks, np.zeros((2, 2, 1))), beyond, radius)
    assert (np.abs(shift - peaks).max(axis=1) > 1).all()


def test_peaks_are_searched_inside_the_map() -> None:
    """The neighbourhood of a distant shift is moved inside; a peak at the border is whole."""
    outside = windows(np.array([[9.0, -9.0]]), np.zeros((1, 2, 1)), reach=6)
    shift, _ = start._nearest_peaks(outside, np.array([[30.0, -30.0]]), 2)
    assert shift[0].tolist() == [5.5, -5.5]
    shift, _ = start._nearest_peaks(outside, np.array([[-30.0, 30.0]]), 2)
    assert shift[0].tolist() == [-0.5, 0.5]


def consistent(count: int, step: np.ndarray, chance: int) -> _Windows:
    """Windows at the shifts of a step; the last `chance` ones have peaks anywhere."""
    rng = np.random.default_rng(1)
    slopes = rng.normal(0, 1.5, (count, 2, len(step)))
    peaks = slopes @ step
    peaks[count - chance :] = rng.uniform(-10, 10, (chance, 2))
    return windows(peaks, slopes)


def test_hypotheses_ignore_chance_peaks() -> None:
    true = np.array([1.2, -0.9])
    group = consistent(40, true, 12)
    step = start._best_hypothesis(group, np.random.default_rng(0))
    assert np.abs(step - true).max() < 0.4  # Few windows are pulled towards the prior.
    few = consistent(3, true, 0)
    assert np.abs(start._best_hypothesis(few, np.random.default_rng(0)) - true).max() < 0.5


def test_refinement_follows_the_nearest_peaks() -> None:
    """The total step is that of all windows; previous steps count in the prior."""
    true = np.array([1.2, -0.9])
    group = consistent(60, true, 15)
    total, height = start._refine(group, true + 0.2, np.zeros(2))
    assert np.abs(total - true).max() < 0.03
    assert height > 0.8
    previous = np.array([0.3, 0.3])
    total, _ = start._refine(group, true, previous)
    assert np.abs(total - previous - true).max() < 0.03


def test_windows_are_sampled_by_trust_if_enough_have_some() -> None:
    trust = np.array([0.5, 0.3, 0.2, 0.0])
    assert start._probabilities(trust, 2) is trust
    assert start._probabilities(trust, 3) is None


def test_normalised_images_ignore_brightness_and_contrast() -> None:
    rng = np.random.default_rng(0)
    image = rng.normal(100, 10, (80, 120)).astype(np.float32)
    plain = start._normalised(image)
    np.testing.assert_allclose(start._normalised(3 * image + 50), plain, atol=1e-3)
    assert plain.std() == pytest.approx(1 / np.sqrt(1.05), abs=0.03)
    assert abs(plain.mean()) < 0.01
    assert not start._normalised(np.full((80, 120), 7, np.float32)).any()
    slope = np.broadcast_to(np.linspace(0, 300, 120, dtype=np.float32), (80, 120))
    sloped = start._normalised(image + slope)
    np.testing.assert_allclose(sloped[25:-25, 25:-25], plain[25:-25, 25:-25], atol=0.15)


def test_downsampling_takes_means_of_whole_blocks() -> None:
    image = np.arange(35).reshape(5, 7)
    small = start._downsampled(image.astype(np.float32), 2)
    expected = image[:4, :6].reshape(2, 2, 3, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(small, expected)
    same = start._downsampled(image, 1)
    assert same.dtype == np.float32
    np.testing.assert_array_equal(same, image)


def test_rounds_of_matching_narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows shrink from round to round; only the first round needs hypotheses."""
    rounds: list[tuple[int, int, int]] = []
    hypotheses: list[int] = []
    steps: list[float] = []

    def match(views, sensor, free, *, window, reach, stride):
        rounds.append((window, reach, stride))
        steps.append((sensor.baseline_m - SENSOR.baseline_m) / ROWS[0].tolerance)
        return windows(np.zeros((2, 2)), np.zeros((2, 2, len(ROWS))), reach=6)

    def refine(group, change, step):
        hypotheses.append(int(change[0]))
        return step + 1.0, 0.1 * len(rounds)

    monkeypatch.setattr(start, "_match_windows", match)
    monkeypatch.setattr(start, "_best_hypothesis", lambda group, rng: np.full(len(ROWS), 5.0))
    monkeypatch.setattr(start, "_refine", refine)
    initial = start.find_start((), SENSOR, ROWS)
    assert hypotheses == [5, 0, 0]
    np.testing.assert_allclose(steps, [0, 1, 2], atol=1e-6)
    np.testing.assert_array_equal(initial.step, np.full(len(ROWS), 3.0))
    assert initial.correlation == pytest.approx(0.3)
    assert all(np.diff([size[0] for size in rounds]) < 0)


def test_without_windows_the_start_is_the_sensor(monkeypatch: pytest.MonkeyPatch) -> None:
    empty = _Windows(maps=np.zeros((0, 3, 3), np.float32), slopes=np.zeros((0, 2, len(ROWS))))
    monkeypatch.setattr(start, "_match_windows", lambda *_, **__: empty)
    initial = start.find_start((), SENSOR, ROWS)
    assert initial.correlation == 0.0 and not initial.step.any()
