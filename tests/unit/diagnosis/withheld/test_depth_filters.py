"""Post-processing of depth."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.withheld import depth_filters as filters
from diagnosis.withheld.catalogue import Strengths
from diagnosis.withheld.nominal import Nominal

NAN = np.nan


def _depth(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    z = 1.0 + rng.normal(0, 0.005, (25, 33))
    z[rng.random(z.shape) < 0.2] = NAN
    return z


def test_off_is_the_very_maps(camera: Nominal) -> None:
    frames = [_depth(), _depth(1)]
    out = filters.process(frames, Strengths(nominal=camera, values={}))
    assert out[0] is frames[0] and out[1] is frames[1]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("median", 5),
        ("smoothing_mean", 9),
        ("subpixel_steps", 0.5),
        ("pixel_locking", 0.1),
        ("edge_jump", 0.05),
        ("speckle_filter", 60),
        ("range", 1.0),
        ("decimation", 4),
        ("spatial_filter", 0.5),
        ("temporal_filter", 0.4),
        ("hole_filling", 2),
        ("depth_unit", 0.01),
    ],
)
def test_every_effect_acts_by_its_name(name: str, value: float, camera: Nominal) -> None:
    frames = [_depth(), _depth(1)]
    values = {name: value}
    out = filters.process(frames, Strengths(nominal=camera, values=values))
    assert not np.array_equal(out[1], frames[1], equal_nan=True)


def test_range_includes_both_ends() -> None:
    z = np.array([[0.4, 0.5, 2.0, 2.1, NAN]])
    assert np.isfinite(filters.within(z, 0.5, 2.0)).tolist() == [[False, True, True, False, False]]


@pytest.mark.parametrize("side", [2, 3, 5])
def test_decimation_blocks(side: int) -> None:
    """Law: median to 3 px, of an even count the nearer; mean from 4 on; any depth makes a block."""
    z = _depth()
    z[: 2 * side, :side] = NAN
    z[side, 0] = 1.5
    out = filters.decimate(z, side)
    assert out.shape == z.shape
    assert np.isnan(out[:side, :side]).all()
    assert (out[side : 2 * side, :side] == 1.5).all()
    block = z[2 * side : 3 * side, side : 2 * side]
    known = np.sort(block[np.isfinite(block)])
    expected = known[(len(known) - 1) // 2] if side <= 3 else known.mean()
    assert out[2 * side, side] == pytest.approx(expected)


def test_spatial_filter_keeps_the_pages_noise() -> None:
    """Law: white noise keeps mean_w((alpha^2 / (1 + b^2 - 2 b cos w))^(2 n))^2 of its variance."""
    noise = 20.0 + np.random.default_rng(0).normal(0, 0.01, (300, 300))
    alpha, times = 0.5, 2
    out = filters.smooth_space(noise, alpha, 1.0, times)[50:-50, 50:-50]
    w, b = np.linspace(0, np.pi, 20001), 1 - alpha
    kept = np.mean((alpha**2 / (1 + b**2 - 2 * b * np.cos(w))) ** (2 * times)) ** 2
    assert out.var() / noise.var() == pytest.approx(kept, rel=0.1)


def test_spatial_filter_stops_at_jumps_and_holes() -> None:
    d = np.full((20, 20), 10.0)
    d[:, 10:] = 12.0
    d[7, 3] = NAN
    out = filters.smooth_space(d, 0.3, 1.0, 3)
    np.testing.assert_allclose(out, d, equal_nan=True)


def test_temporal_filter_keeps_the_pages_noise() -> None:
    """Law: variance over time alpha / (2 - alpha), successive frames correlate by 1 - alpha."""
    rng = np.random.default_rng(0)
    frames = [20.0 + rng.normal(0, 0.05, (40, 50)) for _ in range(60)]
    out = np.stack(filters.smooth_time(frames, 0.4, 1.0, 0))[10:]
    assert out.var() / 0.05**2 == pytest.approx(0.4 / 1.6, rel=0.05)
    away = out - 20.0
    assert np.mean(away[1:] * away[:-1]) / away.var() == pytest.approx(0.6, abs=0.03)


@pytest.mark.parametrize(
    ("persistence", "stands_in"), [(0, False), (2, True), (3, True), (5, True), (8, True)]
)
def test_persistence(persistence: int, stands_in: bool) -> None:
    seen, gone = np.full((2, 2), 9.0), np.full((2, 2), NAN)
    out = filters.smooth_time([seen, seen, gone], 0.5, 1.0, persistence)[2]
    assert np.isfinite(out).all() == stands_in
    first = filters.smooth_time([gone, gone], 0.5, 1.0, persistence)
    assert np.isnan(first[1]).all()


def test_persistence_counts_frames() -> None:
    seen, gone = np.full((1, 1), 9.0), np.full((1, 1), NAN)
    assert np.isfinite(filters.smooth_time([seen, gone, gone], 0.5, 1.0, 5)[2]).all()
    assert np.isnan(filters.smooth_time([seen, gone, gone, gone], 0.5, 1.0, 5)[3]).all()
    assert np.isnan(filters.smooth_time([seen] * 3 + [gone], 0.5, 1.0, 1)[3]).all()


def test_jumps_over_time_are_taken_as_they_are() -> None:
    frames = [np.full((2, 2), 9.0), np.full((2, 2), 12.0)]
    np.testing.assert_array_equal(filters.smooth_time(frames, 0.4, 1.0, 3)[1], 12.0)


def test_filling_from_the_left() -> None:
    z = np.array([[NAN, 1.0, NAN, NAN, 2.0, NAN]])
    out = filters.fill(z, filters.LEFT)
    assert np.isnan(out[0, 0])
    assert out[0, 1:].tolist() == [1.0, 1.0, 1.0, 2.0, 2.0]


def test_filling_from_neighbours() -> None:
    """What was filled fills the next; nearest fills under depth alone."""
    z = np.array([[1.0, 3.0, NAN], [2.0, NAN, NAN], [4.0, 5.0, 6.0]])
    far = filters.fill(z, filters.FARTHEST)
    assert far[0, 2] == 3.0  # Left 3, lower left and below missing.
    assert far[1, 1] == 5.0
    assert far[1, 2] == 6.0
    near = filters.fill(z, filters.NEAREST)
    assert np.isnan(near[0, 2])
    assert near[1, 1] == 1.0
    assert np.isnan(near[1, 2])
    np.testing.assert_array_equal(filters.fill(z, 0), z)
    assert np.isnan(filters.fill(np.full((2, 2), NAN), filters.FARTHEST)).all()


def test_units() -> None:
    z = np.array([[0.004, 0.0149, 1.0, 656.0, NAN]])
    out = filters.in_units(z, 0.01)
    assert np.isnan(out[0, [0, 3, 4]]).all()
    assert out[0, 1:3] == pytest.approx([0.01, 1.0])
