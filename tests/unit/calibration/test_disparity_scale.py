"""Scale and offset of disparity by regression, on maps made without a camera."""

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
    """Disparity that depth in whole millimetres means."""
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
    """A plane that leans by `slope_px` of disparity over the image, read with scatter.

    Each leans its own way, or the reference's rounding would be the same in all.
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
def test_scale_and_offset_come_back(scale: float, offset_px: float, outliers: float) -> None:
    """Within 0.1 % and 0.03 px, four times the deviation of these maps' scatter.

    It does not prove that a matcher's own pull stays out: see `test_depth_only`.
    """
    pairs = [
        _pair(scale=scale, offset_px=offset_px, seed=seed, outliers=outliers) for seed in range(2)
    ]
    found = disparity_scale.fit(pairs, free=BOTH)
    assert found.told_apart
    assert found.scale == pytest.approx(scale, abs=1e-3)
    assert found.offset_px == pytest.approx(offset_px, abs=0.03)


def test_deviations_are_those_of_repeated_readings() -> None:
    """Errors over their stated deviation have RMS 1; of 40 draws 0.75 to 1.35 with 99 %."""
    z = []
    for draw in range(40):
        found = disparity_scale.fit([_pair(seed=2 * draw), _pair(seed=2 * draw + 1)], free=BOTH)
        z.append([found.scale, found.offset_px] / np.sqrt(np.diagonal(found.covariance)))
    assert (np.sqrt(np.mean(np.square(z), axis=0)) > 0.75).all()
    assert (np.sqrt(np.mean(np.square(z), axis=0)) < 1.35).all()


def test_rooms_that_disagree_widen_the_deviation() -> None:
    """References placed 0.3 % apart from room to room: tiles alone would not show it."""
    alike = disparity_scale.fit([_pair(seed=seed) for seed in range(4)], free=BOTH)
    shares = (-0.003, 0.003, -0.003, 0.003)
    apart = disparity_scale.fit(
        [_pair(seed=seed, scale=share) for seed, share in enumerate(shares)], free=BOTH
    )
    assert apart.covariance[0, 0] > 4 * alike.covariance[0, 0]


@pytest.mark.parametrize(("free", "scale", "offset_px"), [("scale", 0.01, 0), ("offset", 0, 0.2)])
def test_one_alone(free: str, scale: float, offset_px: float) -> None:
    found = disparity_scale.fit([_pair(scale=scale, offset_px=offset_px)], free=(free,))
    assert (found.scale, found.offset_px) == pytest.approx((scale, offset_px), abs=0.01)
    other = {"scale": 1, "offset": 0}[free]
    assert (found.scale, found.offset_px)[other] == 0
    assert found.covariance[other, other] == 0


def test_one_distance_does_not_tell_scale_from_offset() -> None:
    found = disparity_scale.fit([_pair(offset_px=0.2, slope_px=0.5)], free=BOTH)
    assert not found.told_apart
    assert np.isinf(np.diagonal(found.covariance)).all()
    assert found.offset_px + 12 * found.scale == pytest.approx(0.2, abs=0.02)


def test_a_smooth_bend_is_measured_not_fitted() -> None:
    """x^2 - 1/3 over the square has RMS sqrt(4/45)."""
    x = np.linspace(-1, 1, SHAPE[1]) * np.ones(SHAPE)
    found = disparity_scale.fit([_pair(bend=0.5 * (x**2 - 1 / 3))], free=BOTH)
    assert found.bend_px == pytest.approx(0.5 * np.sqrt(4 / 45), rel=0.15)
    assert found.bend_px > 3 * found.bend_sd_px
    plain = disparity_scale.fit([_pair()], free=BOTH)
    assert plain.bend_px < 3 * plain.bend_sd_px


def test_too_few_pixels_are_refused() -> None:
    pair = _pair()
    pair.device_px[:] = np.nan
    with pytest.raises(InputError, match=r"captures must share 500 pixels .*; got 0\."):
        disparity_scale.fit([pair], free=BOTH)
