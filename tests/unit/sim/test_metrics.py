"""Error figures of a disparity map."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim import metrics
from starling.sim.arrays import filled


def step_scene() -> np.ndarray:
    truth = np.full((40, 300), 10, np.float32)
    truth[:, 200:] = 14
    return truth


def test_edges_reach_two_pixels_and_holes_are_no_edges():
    truth = step_scene()
    truth[5:9, 150:160] = np.nan
    np.testing.assert_array_equal(
        np.unique(np.nonzero(metrics.depth_edges(truth))[1]), range(197, 203)
    )
    assert not metrics.depth_edges(np.full((5, 5), np.nan)).any()
    vertical = metrics.depth_edges(step_scene().T)
    np.testing.assert_array_equal(np.unique(np.nonzero(vertical)[0]), range(197, 203))


@pytest.mark.parametrize("columns", [128, 129])
def test_images_within_the_left_band_are_reported(columns: int):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        reached = metrics.reached_pixels(np.ones((4, columns)))
    assert reached.any() == (columns == 129)
    assert [str(w.message)[:21] for w in caught] == ["images of 128 columns"] * (columns == 128)


def test_no_overlap_without_pixels_to_compare():
    holes = np.full((2, 2), np.nan)
    assert np.isnan(metrics.hole_overlap(holes, holes, np.zeros((2, 2), bool)))
    assert metrics.hole_overlap(np.ones((2, 2)), np.ones((2, 2)), np.ones((2, 2), bool)) == 1


def test_scored_pixels_are_known_right_of_the_band_and_off_the_edges():
    truth = step_scene()
    truth[0, 140] = np.nan
    scored = metrics.scored_pixels(truth)
    assert not scored[:, :128].any()
    assert not scored[0, 140]
    assert not scored[:, 197:203].any()
    assert scored.sum() == 40 * (300 - 128 - 6) - 1
    assert metrics.reached_pixels(truth).sum() == 40 * (300 - 128) - 1


@given(bias=st.floats(-3, 3), sigma=st.floats(0.05, 0.5), seed=st.integers(0, 9))
def test_figures_recover_bias_and_spread(bias, sigma, seed):
    truth = np.full((60, 400), 20.0)
    noise = np.random.default_rng(seed).normal(bias, sigma, truth.shape)
    figures = metrics.disparity_figures(truth + noise, truth, metrics.scored_pixels(truth))
    assert figures.bias_px == pytest.approx(bias, abs=0.03)
    assert figures.nmad_px == pytest.approx(sigma, rel=0.05)
    assert figures.fill == 1.0
    assert figures.ndp_iou is None


def test_bad_fill_and_overlap_count_pixels():
    truth = np.full((10, 228), 5.0)
    ours, device = truth.copy(), truth.copy()
    ours[:, 128:138] += 2
    ours[:, 208:] = np.nan
    device[:, 218:] = np.nan
    figures = metrics.disparity_figures(
        ours, truth, metrics.scored_pixels(truth), holes_of_px=device,
        holes_where=metrics.reached_pixels(truth),
    )  # fmt: skip
    assert figures.bad1_pct == pytest.approx(12.5)
    assert figures.fill == pytest.approx(0.8)
    assert figures.ndp_iou == pytest.approx(0.5)
    alone = metrics.disparity_figures(truth, truth, metrics.scored_pixels(truth), holes_of_px=truth)
    assert alone.ndp_iou == 1.0


def test_no_valid_pixel_gives_nan_and_no_fill():
    truth = np.full((10, 228), 5.0)
    figures = metrics.disparity_figures(truth * np.nan, truth, metrics.scored_pixels(truth))
    assert np.isnan([figures.bias_px, figures.nmad_px, figures.bad1_pct]).all()
    assert figures.fill == 0


def test_what_cannot_be_compared_is_refused():
    truth = np.full((10, 228), 5.0)
    scored = metrics.scored_pixels(truth)
    with pytest.raises(InputError, match="must share one shape; got"):
        metrics.disparity_figures(truth[:5], truth, scored)
    with pytest.raises(InputError, match="scored must hold a pixel; got 0"):
        metrics.disparity_figures(truth, truth, np.zeros(truth.shape, bool))
    with pytest.raises(InputError, match="must share one shape"):
        metrics.disparity_figures(truth, truth, scored, holes_of_px=truth[:5])


def test_errors_below_are_bad_and_holes_count_where_asked() -> None:
    reference = np.full((4, 200), 10.0)
    ours = reference.copy()
    ours[0, :50], ours[3, 0] = 8.0, np.nan
    scored, everywhere = np.ones(reference.shape, bool), np.ones(reference.shape, bool)
    scored[3] = False
    whole = metrics.disparity_figures(
        ours, reference, scored, holes_of_px=reference, holes_where=everywhere
    )
    assert whole.bad1_pct == pytest.approx(100 * 50 / 600)
    assert whole.ndp_iou == 0.0
    part = metrics.disparity_figures(ours, reference, scored, holes_of_px=reference)
    assert part.ndp_iou == 1.0


def test_unknown_pixels_take_the_nearest_known_value() -> None:
    values = np.array([[1.0, np.nan, np.nan, np.nan, 5.0]], np.float32)
    np.testing.assert_array_equal(
        filled(values, np.isfinite(values))[0, [0, 1, 3, 4]], [1.0, 1.0, 5.0, 5.0]
    )
    known = np.ones((2, 2), np.float32)
    assert filled(known, np.ones((2, 2), bool)) is known


def test_a_map_without_a_known_pixel_cannot_be_filled() -> None:
    message = "reference depth must be known somewhere; got no pixel. Check truth.png."
    with pytest.raises(InputError, match=re.escape(message)):
        filled(np.zeros((2, 2), np.float32), np.zeros((2, 2), bool))


@pytest.mark.parametrize(("step_px", "edge"), [(1.0, False), (-1.0, False), (1.01, True)])
def test_a_step_of_one_pixel_is_no_edge(step_px: float, edge: bool) -> None:
    truth = np.full((12, 20), 10, np.float64)
    truth[:, 10:] += step_px
    assert metrics.depth_edges(truth).any() == edge
    assert metrics.depth_edges(truth.T).any() == edge


@pytest.mark.parametrize(("off_px", "bad"), [(1.0, False), (1.01, True)])
def test_an_error_of_one_pixel_is_not_bad(off_px: float, bad: bool) -> None:
    reference = np.full((4, 200), 10.0)
    ours = reference.copy()
    ours[0] += off_px
    figures = metrics.disparity_figures(ours, reference, np.ones(reference.shape, bool))
    assert figures.bad1_pct == (25 if bad else 0)


def test_a_shift_is_found_without_a_matcher() -> None:
    """The excluded border may hold anything."""
    wide = np.random.default_rng(0).random((40, 90))
    wide = np.apply_along_axis(np.convolve, 1, wide, np.hanning(9), mode="same")
    left, right = wide[:, 3:83].copy(), wide[:, :80].copy()
    left[:, :6] = right[:6] = 50.0
    shift_px = metrics.shift_px(left, right, near_px=-2.7, margin_px=12)
    assert shift_px == pytest.approx(-3.0, abs=1e-3)


def test_refusals_name_all_arrays_and_a_remedy() -> None:
    truth = np.full((10, 228), 5.0)
    scored = metrics.scored_pixels(truth)
    shapes = "got (5, 228) and (10, 228) and (10, 228). Compare maps of one view."
    names = "disparity_px and reference_px and scored must share one shape; "
    with pytest.raises(InputError, match=re.escape(names + shapes)):
        metrics.disparity_figures(truth[:5], truth, scored)
    with pytest.raises(InputError, match=r"got 0\. Take a scene with known truth\."):
        metrics.disparity_figures(truth, truth, np.zeros(truth.shape, bool))
    with pytest.raises(InputError, match="disparity_px and holes_of_px and holes_where must"):
        metrics.disparity_figures(truth, truth, scored, holes_of_px=truth[:5])


@pytest.mark.parametrize(
    ("factor", "offset_px", "wanted"),
    [(1.02, 0.0, 1.02), (0.97, 0.0, 0.97), (1.0, 0.4, None), (1.001, 0.0, None)],
)
def test_a_constant_ratio_is_told_from_an_offset(
    factor: float, offset_px: float, wanted: float | None
) -> None:
    rng = np.random.default_rng(0)
    reference = np.linspace(8, 60, 40000).reshape(200, 200)
    disparity = factor * reference + offset_px + rng.normal(0, 0.1, reference.shape)
    disparity[:20] = np.nan
    ratio = metrics.constant_ratio(disparity, reference)
    assert ratio == (None if wanted is None else pytest.approx(wanted, abs=1e-3))


def test_a_ratio_of_few_pixels_is_unknown() -> None:
    reference = np.full((200, 200), np.nan)
    reference[:4, :4] = 20.0
    assert metrics.constant_ratio(1.1 * reference, reference) is None
