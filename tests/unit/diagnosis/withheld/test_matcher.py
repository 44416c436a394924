"""The matcher: finds shifts, refuses what it should, and each setting acts."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest

from diagnosis.withheld import matcher
from diagnosis.withheld.case import Case
from diagnosis.withheld.chain import Pair
from diagnosis.withheld.errors import WithheldError
from diagnosis.withheld.light import Light
from diagnosis.withheld.matcher import Settings
from diagnosis.withheld.nominal import Nominal

SETTINGS = Settings(search_range=32)


def _textured(shape: tuple[int, int] = (48, 90), seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 200, shape).astype(np.uint8)


@pytest.mark.parametrize("shift", [3, 11])
def test_a_shifted_image_has_its_shift(shift: int) -> None:
    image = _textured()
    d = matcher.match(image, np.roll(image, -shift, 1), SETTINGS)
    assert np.isfinite(d[:, 40:-4]).mean() > 0.98
    assert np.nanmedian(d) == pytest.approx(shift, abs=0.05)
    assert np.nanstd(d[:, 40:-4]) < 0.3


def test_no_depth_outside_the_overlap() -> None:
    image = _textured()
    d = matcher.match(image, np.roll(image, -20, 1), SETTINGS)
    assert np.isnan(d[:, :14]).mean() > 0.9


def test_search_begins_where_it_is_told() -> None:
    image = _textured()
    right = np.roll(image, -20, 1)
    later = dataclasses.replace(SETTINGS, search_range=16, disparity_shift=12)
    assert np.nanmedian(matcher.match(image, right, later)) == pytest.approx(20.0, abs=0.05)
    beyond = dataclasses.replace(SETTINGS, disparity_shift=80, search_range=16)
    assert np.isfinite(matcher.match(image, right, beyond)).mean() < 0.2


def test_depth_of_the_small_scene(take, light: Light, camera: Nominal) -> None:
    """Results: fill above nine tenths of what can have depth; median error below 0.1 px."""
    pair: Pair = take(projector_power=0.45)
    z = matcher.depth(pair.left, pair.right, camera, settings=SETTINGS)
    assert z.dtype == np.float32
    truth = light.left.depth_m
    inner = np.s_[4:-4, 20:80]
    error = 6.0 / z[inner] - 6.0 / truth[inner]
    assert np.isfinite(error).mean() > 0.8
    assert abs(np.nanmedian(error)) < 0.1
    assert np.nanmedian(np.abs(error)) < 0.25


def test_an_offset_of_the_right_image_takes_disparity_away(
    take, light: Light, camera: Nominal
) -> None:
    """Law: d' = d - offset, from light to depth, with the conventions' sign."""
    errors = []
    for offset in (0.0, 1.0):
        pair: Pair = take(projector_power=0.45, disparity_offset=offset)
        z = matcher.depth(pair.left, pair.right, camera, settings=SETTINGS)
        errors.append(np.nanmedian(6.0 / z - 6.0 / light.left.depth_m))
    assert errors[1] - errors[0] == pytest.approx(-1.0, abs=0.15)


@pytest.mark.parametrize(
    ("name", "value"), [("uniqueness", 60), ("left_right_threshold", 0.5), ("texture_threshold", 3)]
)
def test_checks_make_holes_and_nothing_else(name: str, value: float, take, camera: Nominal) -> None:
    pair: Pair = take(projector_power=0.02)
    loose = dataclasses.replace(
        SETTINGS, uniqueness=0.0, left_right_threshold=64.0, speckle_count=0
    )
    before = matcher.depth(pair.left, pair.right, camera, settings=loose)
    strict = dataclasses.replace(loose, **{name: value})
    after = matcher.depth(pair.left, pair.right, camera, settings=strict)
    assert np.isnan(after).sum() > np.isnan(before).sum()
    kept = np.isfinite(after)
    np.testing.assert_array_equal(after[kept], before[kept])


@pytest.mark.parametrize(
    ("name", "value"),
    [("census_window", 3), ("census_window", 11), ("small_penalty", 20), ("large_penalty", 100)],
)
def test_settings_of_the_cost_act(name: str, value: int, take, camera: Nominal) -> None:
    pair: Pair = take()
    plain = matcher.depth(pair.left, pair.right, camera, settings=SETTINGS)
    case = Case(number=0, kind="single", settings={name: value, "gain": 1.0}, seed=1)
    settings = matcher.settings_for(case, SETTINGS)
    assert getattr(settings, name) == value
    changed = matcher.depth(pair.left, pair.right, camera, settings=settings)
    assert not np.array_equal(plain, changed, equal_nan=True)


def test_wide_search_on_full_size_is_quick() -> None:
    """640 x 360 at 128 disparities: below 1.5 s of one core, with room for a slow machine here."""
    image = _textured((360, 640))
    start = time.process_time()
    matcher.match(image, np.roll(image, -30, 1), Settings())
    assert time.process_time() - start < 6.0


def test_refusals() -> None:
    image = _textured()
    with pytest.raises(WithheldError, match="pair must share one shape"):
        matcher.match(image, image[:-1], SETTINGS)
    with pytest.raises(WithheldError, match="images must be wider"):
        matcher.match(image, image, Settings(search_range=200))
    with pytest.raises(WithheldError, match="census_window must be odd"):
        Settings(census_window=4)
    with pytest.raises(WithheldError, match="penalties must be"):
        Settings(small_penalty=90, large_penalty=110)
    with pytest.raises(WithheldError, match="search must be"):
        Settings(search_range=2)
