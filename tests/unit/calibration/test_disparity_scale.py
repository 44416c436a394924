"""Regression of scale and offset of disparity, on synthetic maps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from starling.calibration.depth import disparity_scale
from starling.calibration.depth.disparity_scale import DisparityPair
from starling.patterns import InputError

SHAPE = (240, 320)
STEP_M = 1e-3
FOCAL_BASELINE = 24.0
BOTH = ("scale", "offset")


def _coded(disparity: np.ndarray) -> np.ndarray:
    """Quantise disparity to depth in whole millimetres."""
    return (FOCAL_BASELINE / (np.rint(FOCAL_BASELINE / disparity / STEP_M) * STEP_M)).astype("f4")


def _pair(
    *,
    scale: float = 0.0,
    offset_px: float = 0.0,
    seed: int = 0,
    slope_px: float = 30.0,
    outliers: float = 0.0,
    bend: np.ndarray | float = 0.0,
) -> DisparityPair:
    """Return a noisy reading of a plane with a range of `slope_px` of disparity.

    The direction of the slope depends on the seed, so that quantisation errors differ.
    """
    rng = np.random.default_rng(seed)
    down, along = np.mgrid[0:1:240j, 0:1:320j]
    share = rng.uniform(0.3, 0.7)
    truth = 12.0 + slope_px * (share * down + (1 - share) * along)
    noise = ndimage.uniform_filter(rng.normal(0, 1.0, SHAPE), 11) * 11 * 0.08
    device = (1 + scale) * truth + offset_px + noise + bend
    wrong = rng.random(SHAPE) < outliers
    device[wrong] += rng.uniform(1, 15, SHAPE)[wrong]  # All to one side, as at depth edges.
    return DisparityPair(
        name=f"plane {seed}",
        room=f"room {seed}",
        device_px=_coded(device),
        truth_px=_coded(truth),
        expected_px=_coded(truth),
        step_m=STEP_M,
        focal_baseline_px_m=FOCAL_BASELINE,
    )


@settings(max_examples=15)
@given(
    scale=st.floats(-0.02, 0.02),
    offset_px=st.floats(-0.5, 0.5),
    outliers=st.sampled_from([0.0, 0.1]),
)
def test_scale_and_offset_are_recovered(scale: float, offset_px: float, outliers: float) -> None:
    """The fit is within 0.1 % and 0.03 px, four standard deviations for these maps.

    The maps have no matcher bias; `test_depth_only` covers it.
    """
    pairs = [
        _pair(scale=scale, offset_px=offset_px, seed=seed, outliers=outliers) for seed in range(2)
    ]
    fitted = disparity_scale.fit(pairs, free=BOTH)
    assert fitted.separable
    assert fitted.scale == pytest.approx(scale, abs=1e-3)
    assert fitted.offset_px == pytest.approx(offset_px, abs=0.03)


def test_deviations_match_repeated_readings() -> None:
    """Errors over their reported deviation have RMS 1, or 0.75 to 1.35 (99 %) for 40 draws."""
    z = []
    for draw in range(40):
        fitted = disparity_scale.fit([_pair(seed=2 * draw), _pair(seed=2 * draw + 1)], free=BOTH)
        z.append([fitted.scale, fitted.offset_px] / np.sqrt(np.diagonal(fitted.covariance)))
    assert (np.sqrt(np.mean(np.square(z), axis=0)) > 0.75).all()
    assert (np.sqrt(np.mean(np.square(z), axis=0)) < 1.35).all()


def test_scatter_between_rooms_increases_the_deviation() -> None:
    """References with scale errors of 0.3 % by room increase the deviation."""
    alike = disparity_scale.fit([_pair(seed=seed) for seed in range(4)], free=BOTH)
    shares = (-0.003, 0.003, -0.003, 0.003)
    apart = disparity_scale.fit(
        [_pair(seed=seed, scale=share) for seed, share in enumerate(shares)], free=BOTH
    )
    assert apart.covariance[0, 0] > 4 * alike.covariance[0, 0]


@pytest.mark.parametrize(("free", "scale", "offset_px"), [("scale", 0.01, 0), ("offset", 0, 0.2)])
def test_a_single_free_parameter(free: str, scale: float, offset_px: float) -> None:
    fitted = disparity_scale.fit([_pair(scale=scale, offset_px=offset_px)], free=(free,))
    assert (fitted.scale, fitted.offset_px) == pytest.approx((scale, offset_px), abs=0.01)
    fixed = {"scale": 1, "offset": 0}[free]
    assert (fitted.scale, fitted.offset_px)[fixed] == 0
    assert fitted.covariance[fixed, fixed] == 0


def test_one_distance_does_not_separate_scale_from_offset() -> None:
    fitted = disparity_scale.fit([_pair(offset_px=0.2, slope_px=0.5)], free=BOTH)
    assert not fitted.separable
    assert np.isinf(np.diagonal(fitted.covariance)).all()
    assert fitted.offset_px + 12 * fitted.scale == pytest.approx(0.2, abs=0.02)


def test_a_smooth_bend_is_measured_not_fitted() -> None:
    """The RMS of x^2 - 1/3 over the square is sqrt(4/45)."""
    x = np.linspace(-1, 1, SHAPE[1]) * np.ones(SHAPE)
    fitted = disparity_scale.fit([_pair(bend=0.5 * (x**2 - 1 / 3))], free=BOTH)
    assert fitted.bend_px == pytest.approx(0.5 * np.sqrt(4 / 45), rel=0.15)
    assert fitted.bend_px > 3 * fitted.bend_sd_px
    plain = disparity_scale.fit([_pair()], free=BOTH)
    assert plain.bend_px < 3 * plain.bend_sd_px


def test_too_few_pixels_are_refused() -> None:
    pair = _pair()
    pair.device_px[:] = np.nan
    with pytest.raises(InputError, match=r"captures must share 500 pixels .*; got 0\."):
        disparity_scale.fit([pair], free=BOTH)
