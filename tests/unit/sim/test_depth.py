"""Disparity to depth and back, the 16-bit code, and reasons in order of cause."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns import InputError
from starling.sim.reason import LABELS, Reason, first_cause
from starling.sim.sensor import presets
from starling.sim.stereo.depth import depth_from_disparity, disparity_from_depth, from_code, to_code
from starling.sim.stereo.measurement import measure


@given(st.floats(0.01, 500.0), st.floats(100, 2000), st.floats(0.01, 0.2))
def test_depth_and_disparity_are_inverse(disparity, focal_px, baseline_m):
    known = depth_from_disparity(np.array([disparity]), focal_px=focal_px, baseline_m=baseline_m)
    back = disparity_from_depth(known, focal_px=focal_px, baseline_m=baseline_m)
    assert back[0] == pytest.approx(disparity, rel=1e-5)


def test_no_disparity_no_depth():
    disparity = np.array([np.nan, 0.0, -3.0, 4.0])
    depth = depth_from_disparity(disparity, focal_px=100.0, baseline_m=0.1)
    assert np.isnan(depth).tolist() == [True, True, True, False]


@pytest.mark.parametrize("bad", [0.0, -0.05, float("nan"), float("inf")])
def test_refusals(bad):
    with pytest.raises(InputError, match="baseline_m must be > 0"):
        depth_from_disparity(np.ones(2), focal_px=100.0, baseline_m=bad)
    with pytest.raises(InputError, match="focal_px must be > 0"):
        depth_from_disparity(np.ones(2), focal_px=bad, baseline_m=0.1)
    with pytest.raises(InputError, match="depth_unit_m must be > 0"):
        to_code(np.ones(2), bad)
    with pytest.raises(InputError, match="depth_unit_m must be > 0"):
        from_code(np.ones(2, np.uint16), bad)


@given(st.integers(0, 65535), st.sampled_from([1e-3, 1e-4, 2.5e-4]))
def test_code_round_trip(code, unit):
    codes = np.array([code], np.uint16)
    assert to_code(from_code(codes, unit), unit)[0] == code


def test_depth_beyond_the_code_is_missing():
    depth = np.array([np.nan, 70.0, -1.0, 0.0004, 1.0])
    assert to_code(depth, 1e-3).tolist() == [0, 0, 0, 0, 1000]


def test_first_cause_wins_and_valid_stays_valid():
    valid = np.array([True, False, False, False])
    causes = {
        Reason.SPECKLE: np.array([True, True, False, False]),
        Reason.OCCLUDED: np.array([True, True, True, False]),
    }
    result = first_cause(valid, causes)
    assert result.tolist() == [0, Reason.OCCLUDED, Reason.OCCLUDED, Reason.UNKNOWN]
    assert result.dtype == np.uint32


def test_every_reason_has_a_label():
    assert set(LABELS) == set(Reason)


def test_a_stereo_sensor_needs_both_images():
    image = np.zeros((32, 64), np.uint8)
    with pytest.raises(InputError, match="ir_right must be given; got None"):
        measure(image, None, presets.load("d435"), causes={})
