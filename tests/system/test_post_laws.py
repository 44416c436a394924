"""Laws of post-processing: effect of each filter on noise, edges, holes and steps.

Rationale: filters are linear between edges, so their recursion gives the effect on white noise.
Their thresholds give the effect on edges, dropouts and steps.
"""

from __future__ import annotations

import numpy as np
import pytest

from starling.sim.captures.capture import open_set
from starling.sim.stereo.depth import disparity_from_depth, from_code, to_code
from starling.sim.stereo.post import decimation, hole_filling, spatial, temporal, threshold

NAN = np.float32(np.nan)
DELTA_PX = 20 / 32  # librealsense's default.
STILL_PX = 20.0
STILL_CODE = 1250  # Depth codes.


def noise(shape, sigma_px=0.02, seed=0):
    """White noise around one disparity, far below the filters' delta."""
    rng = np.random.default_rng(seed)
    return STILL_PX + rng.normal(0, sigma_px, shape).astype(np.float32)


@pytest.mark.parametrize(("alpha", "iterations"), [(0.5, 1), (0.5, 2), (0.8, 3), (0.35, 2)])
def test_spatial_filter_reduces_white_noise_by_its_recursion(alpha, iterations):
    """Variance falls by (mean over w of |H|^(4 n))^2, |H|^2 = a^2 / (1 + b^2 - 2 b cos w), to 3 %.

    Real disparity noise is correlated over the matcher's window, so it falls less.
    """
    w = np.linspace(0, 2 * np.pi, 4096, endpoint=False)
    b = 1 - alpha
    gain = alpha**2 / (1 + b**2 - 2 * b * np.cos(w))
    expected = np.mean(gain ** (2 * iterations)) ** 2
    filtered = spatial.smooth(
        noise((1400, 1400)), alpha=alpha, delta_px=DELTA_PX, iterations=iterations
    )
    inside = filtered[100:-100, 100:-100].astype(np.float64)
    assert inside.var() / 0.02**2 == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("step_px", [0.7, 1.0, 10.0])
def test_spatial_filter_keeps_planes_and_edges(step_px):
    """A constant and a plane are kept to 1e-3 px, and so are edges above delta.

    The mean disparity of the columns at the edge stays within 0.05 px on both sides. An edge that
    the matcher has blurred into steps below delta would be smoothed like a slope.
    """
    flat = np.full((60, 80), STILL_PX, np.float32)
    settings = {"alpha": 0.5, "delta_px": DELTA_PX, "iterations": 2}
    np.testing.assert_allclose(spatial.smooth(flat, **settings), flat, atol=1e-4)
    y, x = np.mgrid[:60, :80]
    plane = (STILL_PX + 0.05 * x - 0.1 * y).astype(np.float32)
    middle = np.s_[20:-20, 20:-20]
    np.testing.assert_allclose(spatial.smooth(plane, **settings)[middle], plane[middle], atol=1e-3)
    edge = noise((200, 80))
    edge[:, 40:] += step_px
    filtered = spatial.smooth(edge, **settings)
    assert filtered[:, 39].mean() == pytest.approx(STILL_PX, abs=0.05)
    assert filtered[:, 40].mean() == pytest.approx(STILL_PX + step_px, abs=0.05)


def test_spatial_filter_rounds_an_edge_below_delta():
    """A step of half of delta is not an edge, so its corners are rounded.

    Does not prove the width of the rounding on a device.
    """
    edge = np.full((8, 80), STILL_PX, np.float32)
    edge[:, 40:] += DELTA_PX / 2
    filtered = spatial.smooth(edge, alpha=0.5, delta_px=DELTA_PX, iterations=2)
    assert filtered[0, 39] - STILL_PX > 0.1


@pytest.mark.parametrize("alpha", [0.2, 0.4, 0.7])
def test_temporal_filter_lowers_noise_and_correlates_frames(alpha):
    """A static scene's variance falls to a / (2 - a); lag-1 correlation is 1 - a; both to 3 %.

    Only noise that is independent in each frame falls. Static noise (speckle, fixed pattern) does
    not.
    """
    past, frames = None, []
    for number in range(120):
        frame = noise((96, 96), seed=number)
        filtered, past = temporal.smooth(frame, past, alpha=alpha, delta_px=DELTA_PX, persistence=3)
        if number >= 40:  # The first frame's noise has decayed: 0.8^80 < 1e-7.
            frames.append(filtered.astype(np.float64) - STILL_PX)
    series = np.array(frames)
    assert series.var() / 0.02**2 == pytest.approx(alpha / (2 - alpha), rel=0.03)
    lag = np.mean(series[1:] * series[:-1]) / np.mean(series**2)
    assert lag == pytest.approx(1 - alpha, rel=0.03)


@pytest.mark.parametrize("alpha", [0.1, 0.4])
def test_a_jump_above_delta_passes_and_a_smaller_one_decays(alpha):
    """Steps above delta are adopted at once; smaller ones follow 1 - (1 - a)^n.

    A slow drift below delta per frame lags behind permanently.
    """
    for step_px, large in ((DELTA_PX * 1.01, True), (DELTA_PX / 2, False)):
        settings = {"alpha": alpha, "delta_px": DELTA_PX, "persistence": 3}
        before = np.full((1, 1), STILL_PX, np.float32)
        _, past = temporal.smooth(before, None, **settings)
        for n in range(1, 6):
            filtered, past = temporal.smooth(before + np.float32(step_px), past, **settings)
            share = 1.0 if large else 1 - (1 - alpha) ** n
            assert filtered[0, 0] - STILL_PX == pytest.approx(step_px * share, abs=1e-4)


WINDOWS = {1: (8, 8), 2: (2, 3), 3: (2, 4), 4: (2, 8), 5: (1, 2), 6: (1, 5), 7: (1, 8)}


@pytest.mark.parametrize("mode", range(9))
def test_persistence_follows_its_table_on_every_history(mode):
    """Persistence: one pixel per history of eight frames (256), followed by a dropout of all.

    Exact. The table is the library's; the test does not show that a device uses these modes.
    """
    history = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).astype(bool)
    still = np.full((1, 256), STILL_PX, np.float32)
    settings = {"alpha": 0.4, "delta_px": DELTA_PX, "persistence": mode}
    _, past = temporal.smooth(still, None, **settings)
    for seen in history.T[::-1]:  # The last column is the oldest frame.
        _, past = temporal.smooth(np.where(seen, still, NAN), past, **settings)
    filtered, after = temporal.smooth(still * NAN, past, **settings)
    needed, last = WINDOWS.get(mode, (0 if mode == 8 else 9, 8))
    expected = history[:, :last].sum(axis=1) >= needed
    np.testing.assert_array_equal(np.isfinite(filtered[0]), expected)
    assert not (after.seen & 1).any()  # A persistent value does not count as an observation.


def test_a_jump_resets_the_history():
    """A jump of depth resets the history of eight good frames.

    The test covers when values persist, not which ones.
    """
    settings = {"alpha": 0.4, "delta_px": DELTA_PX, "persistence": 3}
    past = None
    for disparity in [STILL_PX] * 8 + [STILL_PX + 5, np.nan]:
        filtered, past = temporal.smooth(np.full((1, 1), disparity, np.float32), past, **settings)
    assert np.isnan(filtered[0, 0])  # Mode: valid in 1 of the last 4 frames.


@pytest.mark.parametrize("side", [2, 3])
def test_decimation_takes_the_median_of_what_is_valid(side):
    """Blocks are constant, and one outlier or hole per block changes nothing.

    Does not cover the device's reduction of resolution before matching.
    """
    code = np.full((36, 48), STILL_CODE, np.uint16)
    code[::side, ::side] = 0
    code[1::side, 1::side] = 300 if side == 3 else STILL_CODE
    large = decimation.enlarge(decimation.decimate(code, side), side, code.shape)
    np.testing.assert_array_equal(large, np.full_like(code, STILL_CODE))


def test_decimation_by_the_mean_averages_noise():
    """A block of n pixels has 1 / n of the variance, to 5 %; it is rounded down, by half a unit."""
    spread = 40.0
    depth = STILL_CODE + np.random.default_rng(0).normal(0, spread, (1600, 1600))
    blocks = decimation.decimate(np.rint(depth).astype(np.uint16), 4).astype(np.float64)
    assert blocks.var() == pytest.approx(spread**2 / 16, rel=0.05)
    assert blocks.mean() == pytest.approx(STILL_CODE - 0.5, abs=0.1)


@pytest.mark.parametrize("mode", ["left", "farthest", "nearest"])
def test_hole_at_an_edge_is_filled_from_the_side_that_the_mode_names(mode):
    """A shadow of 6 px between a near left and a far right half.

    Mode left fills it with the near side. The modes farthest and nearest use only pixels to the
    left, above and below. A hole that is open to the right is therefore filled with the near side
    by all three. Below a roof of far depth, farthest takes the roof.
    """
    near, far = 800, 2400
    code = np.full((12, 40), far, np.uint16)
    code[:, :20] = near
    code[1:, 20:26] = 0
    filtered = hole_filling.fill(code, mode)
    assert np.unique(filtered[5, 20:26]).tolist() == [far if mode == "farthest" else near]


@pytest.mark.parametrize("unit_m", [1e-4, 1e-3, 1e-2])
def test_codes_step_by_the_depth_unit(unit_m):
    """Depths read back lie on multiples of the unit, all used; error uniform, std unit / sqrt(12).

    To 3 %.
    """
    depth = np.linspace(0.5, 0.5 + 200 * unit_m, 100_003, dtype=np.float64)
    code = to_code(depth, unit_m)
    assert set(np.diff(np.unique(code))) == {1}
    error = from_code(code, unit_m).astype(np.float64) - depth
    assert np.abs(error).max() <= unit_m / 2 * 1.001
    assert error.std() == pytest.approx(unit_m / np.sqrt(12), rel=0.03)


def test_threshold_cuts_a_slope_at_its_ends():
    """On a slope of depth exactly the pixels outside [near, far] go.

    A device clips codes, the program clips depth; they differ by half a unit at the ends.
    """
    depth = np.linspace(0.2, 4.0, 5000, dtype=np.float32)[None]
    geometry = {"focal_px": 600.0, "baseline_m": 0.05}
    disparity = disparity_from_depth(depth, **geometry)
    filtered = threshold.limit(disparity, **geometry, near_m=0.5, far_m=3.0)
    inside = (depth > 0.5001) & (depth < 2.9999)
    outside = (depth < 0.4999) | (depth > 3.0001)
    assert np.isfinite(filtered[inside]).all() and np.isnan(filtered[outside]).all()


def test_a_real_devices_depth_is_unfiltered(captures):
    """Beyond 2.5 m, where codes are sparser than millimetres, a D415's depth is a comb.

    Each code is round(f b / (k / 32 px)) for a whole k and one f b in all rooms. So depth is not
    averaged after the matcher. The default spatial filter would leave only chance coincidences
    with the comb (to 0.05). Does not exclude smoothing in the device before this rounding.
    """
    folder = captures / "d415-faro"
    if not folder.is_dir():
        pytest.skip(f"no captures at {folder}; set STARLING_CAPTURES to the folder above it")
    opened = open_set(str(folder))
    info = opened.info
    depths = [scene.frame(scene.frames[0]).depth_m for scene in opened.scenes]
    far = [np.asarray(depth > 2.5) & np.asarray(depth < 9.0) for depth in depths]
    codes = [to_code(depth, info.depth_unit_m) for depth in depths]
    counts = np.bincount(
        np.concatenate([code[where] for code, where in zip(codes, far, strict=True)])
    )

    def comb(focal_baseline):
        steps = np.arange(32 * 5, 32 * 25)
        return np.rint(focal_baseline * 32 / steps / info.depth_unit_m).astype(int)

    def hits(focal_baseline):
        on = np.unique(comb(focal_baseline))
        return counts[on[on < counts.size]].sum()

    # The capture file gives f and b to four digits; the comb determines their product to 1e-6.
    tried = info.fx_px * info.baseline_m * (1 + np.arange(-80, 81) * 5e-7)
    product = max(tried, key=hits)
    assert hits(product) == counts.sum()
    geometry = {"focal_px": info.fx_px, "baseline_m": product / info.fx_px}
    for depth, where in zip(depths, far, strict=True):
        if where.sum() < 20_000:
            continue
        disparity = disparity_from_depth(depth, **geometry)
        smoothed = spatial.smooth(disparity, alpha=0.5, delta_px=DELTA_PX, iterations=2)
        code = to_code(disparity_from_depth(smoothed, **geometry), info.depth_unit_m)
        chance = np.mean(32 * product * info.depth_unit_m / np.square(depth[where]))
        assert np.isin(code[where], comb(product)).mean() == pytest.approx(chance, abs=0.05)
