"""Local correlation, against its definition and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from starling.calibration.correlation import (
    STRIDE_PX,
    WINDOW_PX,
    high_passed,
    local_ncc,
    right_in_left,
)
from starling.patterns.errors import InputError

SHAPE = (96, 128)
ALL = np.ones(SHAPE, bool)


def _noise(seed: int, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    return np.random.default_rng(seed).normal(100, 20, shape).astype(np.float32)


def test_local_ncc_matches_its_definition() -> None:
    """The result equals numpy's correlation coefficient of each window."""
    first, second = _noise(0), _noise(1) + 0.5 * _noise(0)
    cuts = [
        (first[y : y + WINDOW_PX, x : x + WINDOW_PX], second[y : y + WINDOW_PX, x : x + WINDOW_PX])
        for y in range(0, SHAPE[0] - WINDOW_PX + 1, STRIDE_PX)
        for x in range(0, SHAPE[1] - WINDOW_PX + 1, STRIDE_PX)
    ]
    expected = [np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in cuts]
    np.testing.assert_allclose(local_ncc(first, second, ALL), expected, atol=1e-5)


@given(gain=st.floats(0.1, 10), offset=st.floats(-100, 100))
def test_gain_and_offset_drop_out(gain: float, offset: float) -> None:
    first, second = _noise(2), _noise(3) + _noise(2)
    same = local_ncc(first, np.float32(gain) * second + np.float32(offset), ALL)
    np.testing.assert_allclose(same, local_ncc(first, second, ALL), atol=1e-4)
    np.testing.assert_allclose(
        local_ncc(first, -second, ALL), -local_ncc(first, second, ALL), atol=1e-6
    )


@given(arrays.arrays(np.float32, SHAPE, elements=st.floats(-1e3, 1e3, width=32)))
def test_local_ncc_is_bounded(image: np.ndarray) -> None:
    ncc = local_ncc(image, _noise(4), ALL)
    assert np.isfinite(ncc).all() and (np.abs(ncc) <= 1).all()


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_noise_lowers_ncc_by_its_share(share: float) -> None:
    """Two images of one signal with a share n of independent noise each have NCC = 1 - n.

    The tolerance is 5 sigma of the mean over 200 windows of 961 samples. Real noise is neither
    white nor uniform, and is not covered.
    """
    shape = (300, 400)
    signal, first, second = (_noise(seed, shape) - 100 for seed in (5, 6, 7))
    keep, spoil = np.sqrt(1 - share), np.sqrt(share)
    ncc = local_ncc(
        keep * signal + spoil * first, keep * signal + spoil * second, np.ones(shape, bool)
    )
    assert np.mean(ncc) == pytest.approx(1 - share, abs=0.01)


def test_windows_with_unusable_pixels_are_skipped() -> None:
    usable = ALL.copy()
    usable[40, 60] = False
    spoilt = _noise(8)
    spoilt[40, 60] = np.nan
    whole, holed = local_ncc(_noise(8), _noise(8), ALL), local_ncc(spoilt, _noise(8), usable)
    touching = sum(
        y <= 40 < y + WINDOW_PX and x <= 60 < x + WINDOW_PX
        for y in range(0, SHAPE[0] - WINDOW_PX + 1, STRIDE_PX)
        for x in range(0, SHAPE[1] - WINDOW_PX + 1, STRIDE_PX)
    )
    assert len(whole) - len(holed) == touching > 0
    np.testing.assert_allclose(holed, 1, atol=1e-6)


def test_incomparable_images() -> None:
    assert len(local_ncc(_noise(9), _noise(9), ~ALL)) == 0
    assert len(local_ncc(_noise(9)[:30], _noise(9)[:30], ALL[:30])) == 0
    np.testing.assert_array_equal(local_ncc(np.full(SHAPE, 7.0), _noise(9), ALL), 0)
    with pytest.raises(InputError, match=r"must share one shape; got \(96, 128\), \(30, 128\)"):
        local_ncc(_noise(9), _noise(9)[:30], ALL)


def test_high_pass_keeps_dots_and_drops_shading() -> None:
    """Shading of 10:1 changes high-passed dots by less than 5 % of their deviation.

    The local deviation averages about 4 pi 10^2 x 0.03 = 38 dots, so the tolerance is 5 %.
    """
    rng = np.random.default_rng(10)
    dots = 1 + (rng.random((200, 300)) < 0.03)
    shading = np.exp(np.linspace(0, np.log(10), 300))[None, :]
    even, shaded = high_passed(dots), high_passed(dots * shading)
    inner = (slice(30, -30), slice(30, -30))
    assert np.std((even - shaded)[inner]) < 0.05 * np.std(even[inner])
    assert np.mean(even[inner] ** 2) == pytest.approx(1, abs=0.05)
    assert abs(np.mean(even[inner])) < 0.02


@given(gain=st.floats(1e-3, 1e3))
def test_high_pass_is_independent_of_gain(gain: float) -> None:
    image = _noise(11)
    np.testing.assert_allclose(high_passed(np.float32(gain) * image), high_passed(image), atol=1e-3)


def test_high_pass_of_a_constant_is_zero() -> None:
    assert np.abs(high_passed(np.full(SHAPE, 93.7))).max() < 0.05
    np.testing.assert_array_equal(high_passed(np.zeros(SHAPE)), 0)
    with pytest.raises(InputError, match="image must be finite; got 1 pixels that are not"):
        high_passed(np.where(np.arange(128) + np.zeros(SHAPE) == 5000, 0, np.nan)[:1, :1])


def test_right_image_is_warped_by_disparity() -> None:
    """A ramp shifted by 2.25 px is the ramp minus 2.25; pixels outside the image are masked.

    OpenCV's cubic kernel (a = -0.75) has an error of up to 0.05 on a ramp of 1 per px.
    """
    ramp = np.tile(np.arange(128, dtype=np.float32), (8, 1))
    disparity = np.full(ramp.shape, 2.25, np.float32)
    disparity[0, 50], disparity[1, 60] = np.nan, 1e12
    warped, inside = right_in_left(ramp, disparity)
    expected = ramp - 2.25
    settled = inside & (ramp >= 5)  # The border is repeated, not continued.
    np.testing.assert_allclose(warped[settled], expected[settled], atol=0.06)
    assert not inside[0, 50] and not inside[1, 60] and not inside[:, :3].any()
    assert inside[2:, 3:].all()
