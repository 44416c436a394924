"""Laws of the sub-pixel effects: pixel locking, quantisation, uniqueness."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.sim.reason import Reason
from starling.sim.sensor import structure
from starling.sim.sensor.matcher import (
    D4XX,
    FAST,
    OAK,
    CensusSemiGlobal,
    Matcher,
    Refinement,
)
from starling.sim.stereo import semiglobal, subpixel
from starling.sim.stereo.matching import match

FINE = replace(
    D4XX, search_px=32, refinement=replace(D4XX.refinement, quantum_px=0.0, locking_px=0.0)
)


@pytest.fixture(scope="module")
def slanted() -> tuple[np.ndarray, np.ndarray]:
    """A textured plane whose disparity falls from 12 to 8 px along the row, 8 bits."""
    rng = np.random.default_rng(3)
    w, h = 320, 64
    spectrum = np.fft.rfft2(rng.standard_normal((h, 512)))
    fy, fx = np.fft.fftfreq(h)[:, None], np.fft.rfftfreq(512)[None]
    texture = np.fft.irfft2(spectrum * np.exp(-(fx**2 + fy**2) * 60), s=(h, 512))
    texture = 128 + 40 * texture / texture.std()
    columns = np.arange(w)
    disparity = 12 - 4 * columns / w
    left = np.stack([np.interp(columns + 40, np.arange(512), row) for row in texture])
    # Right pixel x_r sees the surface point of left column x with x - d(x) = x_r.
    source = np.interp(columns, columns - disparity, columns)
    right = np.stack([np.interp(source + 40, np.arange(512), row) for row in texture])
    return np.clip(left, 0, 255).astype(np.uint8), np.clip(right, 0, 255).astype(np.uint8)


@given(amplitude=st.floats(-0.15, 0.15), start=st.floats(0, 90))
def test_locking_has_the_set_amplitude_and_the_period_of_a_pixel(amplitude, start):
    """Error = -a sin(2 pi d) over six pixels of disparity.

    Does not prove that a real fit's error is a pure sine; only that ours is.
    """
    true_px = (start + np.arange(0, 6, 1 / 64)).astype(np.float32)[None]
    error = subpixel.apply_pixel_locking(true_px, amplitude) - true_px
    expected = -amplitude * np.sin(2 * np.pi * true_px.astype(float))
    np.testing.assert_allclose(error, expected, atol=3e-5)
    np.testing.assert_allclose(error[:, 64:], error[:, :-64], atol=3e-5)


@given(amplitude=st.floats(-0.15, 0.15))
def test_locking_keeps_the_order_of_disparities(amplitude):
    true_px = np.arange(0, 4, 1 / 256, dtype=np.float32)[None]
    assert (np.diff(subpixel.apply_pixel_locking(true_px, amplitude)) > 0).all()


def test_neutral_values_return_the_array_itself():
    values = np.array([[1.3, np.nan]], np.float32)
    assert subpixel.apply_pixel_locking(values, 0.0) is values
    assert subpixel.quantise(values, 0.0) is values
    assert subpixel.refine(values, Refinement()) is values


def test_locking_has_its_full_amplitude_in_the_result(slanted):
    """On matched images: with and without differ by -a sin(2 pi d) at every valid pixel.

    Does not prove that the matcher's intrinsic non-linearity is small; see
    `benchmarks/matcher/physics.py`.
    """
    plain = match(slanted[0], slanted[1], FINE)
    pulled = match(
        slanted[0], slanted[1], replace(FINE, refinement=replace(FINE.refinement, locking_px=0.1))
    )
    np.testing.assert_array_equal(plain.valid, pulled.valid)
    result = plain.disparity_px[plain.valid].astype(float)
    assert result.size > 10_000 and np.ptp(result) > 2.5
    error = pulled.disparity_px[plain.valid] - result
    np.testing.assert_allclose(error, -0.1 * np.sin(2 * np.pi * result), atol=1e-5)


@pytest.mark.parametrize("quantum", [1 / 32, 1 / 8, 0.5])
def test_disparities_come_in_steps_and_move_by_half_a_step_at_most(slanted, quantum):
    """Holds for a matched slanted plane; says nothing of the steps of depth, which post makes."""
    plain = match(slanted[0], slanted[1], FINE)
    stepped = match(
        slanted[0],
        slanted[1],
        replace(FINE, refinement=replace(FINE.refinement, quantum_px=quantum)),
    )
    both = plain.valid & stepped.valid
    steps = stepped.disparity_px[both] / quantum
    np.testing.assert_array_equal(steps, np.rint(steps))
    moved = np.abs(stepped.disparity_px[both] - plain.disparity_px[both])
    assert 0.45 * quantum < moved.max() <= quantum / 2 + 1e-5
    assert len(np.unique(steps)) >= 3 / quantum


def test_the_mean_along_columns_shifts_by_whole_steps():
    """The mean along rows is not rounded."""
    disparity = np.random.default_rng(0).uniform(5, 5.9, (5, 5)).astype(np.float32)
    setting = Refinement(smooth_px=3, smooth_rows_px=3, mean_quantum_px=1 / 8)
    near = [slice(max(place - 1, 0), place + 2) for place in range(5)]
    across = np.stack([disparity[:, part].mean(axis=1) for part in near], axis=1)
    shift = np.stack([across[part].mean(axis=0) for part in near]) - across
    expected = across + np.rint(8 * shift) / 8
    np.testing.assert_allclose(subpixel.refine(disparity, setting), expected, atol=1e-6)


@given(offset=st.floats(-0.5, 0.5), rise=st.integers(50, 1000))
def test_equal_slopes_find_the_vertex_of_a_v(offset, rise):
    """A parabola through a V finds o / (2 - 2 |o|), which is nearer to the whole pixel."""
    vertices = []
    for fit in ("equal_slopes", "parabola"):
        cost = np.rint(rise * np.abs(np.arange(16) - 8 - offset)).astype(np.uint16)

        def fill(start: int, out: np.ndarray, cost: np.ndarray = cost) -> None:
            out[:] = cost

        winners = semiglobal.select(fill, (1, 40, 16), p1=0, p2=0, shift=0, fit=fit)
        vertices.append(winners.best[0, 30] - 8 + winners.offset[0, 30])
    assert vertices[0] == pytest.approx(offset, abs=1 / rise)
    assert vertices[1] == pytest.approx(offset / (2 - 2 * abs(offset)), abs=1 / rise)


def test_equal_slopes_of_sums_spread_disparities_of_an_unsmoothed_census(slanted):
    """Steps of 1/8 px on a slanted plane: a parabola through bits prefers whole pixels.

    Does not prove which device has which fit; docs/results/matcher.md compares one.
    """
    whole, spread = [], []
    for fit in ("parabola", "equal_slopes_of_sums"):
        engine = structure.edit(OAK.engine, "subpixel_fit", fit)
        result = match(*slanted, replace(OAK, engine=engine, search_px=32))
        disparity = result.disparity_px[:, 40:]
        known = disparity[np.isfinite(disparity)]
        assert known.size > 10_000
        whole.append((known == np.rint(known)).mean())
        truth = np.broadcast_to(12 - 4 * np.arange(40, 320) / 320, disparity.shape)
        spread.append(np.abs(known - truth[np.isfinite(disparity)]).mean())
    assert whole[0] > 0.4 and whole[1] < 0.3  # 1/8 if all steps are equally frequent.
    assert spread[1] < 0.8 * spread[0]


@pytest.mark.parametrize("field", ["second_peak", "neighbour_peak"])
def test_winners_are_rejected_by_margin_in_bits(slanted, field):
    """A higher threshold rejects a superset, as AMBIGUOUS; 0 rejects no pixel."""
    refused = []
    for bits in (0.0, 20.0, 60.0, 1000.0):
        setting = replace(FINE, engine=structure.edit(CensusSemiGlobal(), field, bits))
        result = match(slanted[0], slanted[1], setting)
        refused.append(result.reason == Reason.AMBIGUOUS)
    shares = [mask[:, 40:].mean() for mask in refused]
    assert shares[0] < 0.01 and shares[3] > 0.99
    assert shares == sorted(shares) and shares[2] > shares[0]
    for less, more in itertools.pairwise(refused):
        assert not (less & ~more).any()


def test_opencv_disparities_are_locked_and_quantised(slanted):
    fast: Matcher = replace(FAST, search_px=32)
    plain = match(slanted[0], slanted[1], fast)
    pulled = match(slanted[0], slanted[1], replace(fast, refinement=Refinement(locking_px=0.1)))
    result = plain.disparity_px[plain.valid].astype(float)
    error = pulled.disparity_px[plain.valid] - result
    np.testing.assert_allclose(error, -0.1 * np.sin(2 * np.pi * result), atol=1e-5)


def test_isolated_disparity_survives_the_median() -> None:
    alone = np.full((9, 9), np.nan, np.float32)
    alone[4, 4] = 12.0
    out = subpixel.refine(alone, Refinement(median_px=3, smooth_px=1))
    assert out[4, 4] == 12.0 and np.isnan(out).sum() == 80
