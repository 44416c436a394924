"""Share, place and scale of what no known effect explains."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.howfar.evaluation import Evaluation
from starling.diagnosis.howfar.reduction import GapReduction
from starling.diagnosis.howfar.remainder import Remainder, remainder
from starling.diagnosis.scenes.observation import DepthObservation, StereoObservation
from starling.diagnosis.where import maps
from starling.diagnosis.where.maps import CAMERA, PROJECTOR, GapMap
from starling.diagnosis.where.remainder import (
    _LEAST_RATIO,
    difference,
    dominant_scale,
    remainder_places,
    strongest_zone,
)
from starling.diagnosis.which.candidates import Segment
from tests.unit.diagnosis.test_features import DISPARITY, EXPECTED, GROUND

SHAPE = (96, 160)
ALL = np.ones(SHAPE, bool)
NOTHING = np.zeros(SHAPE)


def segment(*, before: float = 10.0, unexplained: float = 3.0, below: float = 1.0) -> Any:
    return SimpleNamespace(
        sizes=(before, unexplained),
        unexplained_size=unexplained,
        explained_below=below,
        table=SimpleNamespace(segment=Segment.IMAGE),
        screening=SimpleNamespace(noise=0.5),
    )


def evaluation(closed_pct: float | None, interval: tuple[float, float] | None = None) -> Evaluation:
    figure = GapReduction(
        before=1.0, after=0.5, floor=0.0, closed_pct=closed_pct, interval=interval
    )
    return Evaluation(figures={"features of the image": figure}, alone={}, shares={})


@given(closed_pct=st.floats(-50, 150))
def test_the_remainder_is_what_the_effects_do_not_close(closed_pct: float):
    result = remainder(segment(), True, evaluation(closed_pct))
    assert result.share == pytest.approx(np.clip(1 - closed_pct / 100, 0, 1), abs=1e-12)
    assert result.interval is None


def test_the_interval_of_the_remainder_is_reversed():
    result = remainder(segment(), True, evaluation(70, (60, 110)))
    assert result.share == pytest.approx(0.3) and result.interval == pytest.approx((0, 0.4))


def test_all_of_a_gap_without_a_reported_effect_is_unexplained():
    assert remainder(segment(), False, evaluation(70)) == Remainder(share=1.0, interval=None)


@pytest.mark.parametrize("before, share", [(1.0, None), (1.001, 1.0)])
def test_no_evident_gap_has_no_remainder(before: float, share: float | None):
    assert remainder(segment(before=before), False, None).share == share


@pytest.mark.parametrize("howfar", [None, evaluation(None)])
def test_training_scenes_give_the_remainder_without_a_figure(howfar: Evaluation | None):
    assert remainder(segment(), True, howfar).share == pytest.approx(2.5 / 9.5)
    assert remainder(segment(unexplained=0.2), True, howfar).share == 0


def wave(length_px: float) -> np.ndarray:
    return np.sin(2 * np.pi * np.arange(SHAPE[1]) / length_px) * np.ones(SHAPE)


@pytest.mark.parametrize(
    "gap, scale",
    [
        (np.random.default_rng(0).standard_normal(SHAPE), "pixels"),
        (wave(4), "pixels"),
        (wave(30), "dots"),
        (wave(400), "image"),
        (np.ones(SHAPE), "image"),
        (NOTHING, None),
    ],
)
def test_a_difference_has_its_scale(gap: np.ndarray, scale: str | None):
    assert dominant_scale([(gap, NOTHING)], [ALL]) == scale


def test_noise_does_not_count_for_the_scale():
    noise = [np.random.default_rng(seed).standard_normal(SHAPE) for seed in range(2)]
    gap = noise[0] + 0.3 * wave(30)
    assert dominant_scale([(gap, NOTHING)], [ALL]) == "pixels"
    assert dominant_scale([(gap, noise[1])], [ALL]) == "dots"
    assert dominant_scale([(0.9 * noise[0], noise[0])], [ALL]) is None


def test_pixels_that_do_not_count_have_no_scale():
    left = np.arange(SHAPE[1]) < 80
    gap = np.where(left, wave(30), 100 * wave(4))
    assert dominant_scale([(gap, NOTHING)], [ALL & left]) == "dots"


def gap_map(mean: np.ndarray, frame: maps.Frame = CAMERA) -> GapMap:
    return GapMap(
        quantity="infrared", frame=frame, mean=mean, deviations=mean, agreement=np.ones(3)
    )


@pytest.mark.parametrize("row, row_name", [*enumerate(("top", "", "bottom"))])
@pytest.mark.parametrize("column, column_name", [*enumerate(("left", "", "right"))])
def test_the_strongest_zone_is_named(row: int, row_name: str, column: int, column_name: str):
    mean = 0.1 * np.ones((18, 33))
    mean[6 * row : 6 * row + 6, 11 * column : 11 * column + 11] = -1
    name = f"{row_name} {column_name}".strip() or "centre"
    assert strongest_zone([gap_map(mean)], "infrared") == name
    assert strongest_zone([gap_map(mean)], "holes") is None
    assert strongest_zone([gap_map(mean, PROJECTOR)], "infrared") is None


@pytest.mark.parametrize("step, zone", [(-0.01, None), (0.01, "top left")])
def test_a_zone_must_stand_out(step: float, zone: str | None):
    """The zone covers a ninth; its mean square is a ratio `r` of the mean over the image."""
    ratio = _LEAST_RATIO + step
    mean = np.ones((18, 33))
    mean[:6, :11] = np.sqrt(ratio * (8 / 9) / (1 - ratio / 9))
    assert strongest_zone([gap_map(mean)], "infrared") == zone
    mean[12:] = np.nan
    assert strongest_zone([gap_map(np.full_like(mean, np.nan))], "infrared") is None


def test_differences_are_of_levels_or_of_holes():
    dark = np.full((1, *SHAPE), 5, np.uint8)
    depth = np.full((1, *SHAPE), 9.0, np.float32)
    holes = depth.copy()
    holes[0, 0, 0] = np.nan
    first = StereoObservation(left=dark, right=dark, ours_px=depth)
    second = StereoObservation(left=dark - 2, right=dark, ours_px=holes)
    assert (difference(second, first, "image") == -2).all()
    for pair in ((second, first), (DepthObservation(device_px=holes), first)):
        assert difference(*pair, "depth").sum() == 1 == difference(*pair, "depth")[0, 0]


def observation(seed: int, *, corner: float = 0.0) -> StereoObservation:
    rng = np.random.default_rng(seed)
    level = EXPECTED + 0.5 * rng.standard_normal((1, *EXPECTED.shape))
    rows, columns = (size // 3 for size in EXPECTED.shape)
    level[:, :rows, :columns] += corner
    image = np.clip(np.rint(level), 0, 255).astype(np.uint8)
    return StereoObservation(left=image, right=image, ours_px=DISPARITY[None].astype(np.float32))


def scene(number: int, against: object = None) -> Any:
    return SimpleNamespace(
        room=f"room {number}",
        against=against,
        strata=GROUND,
        real=observation(50 + number, corner=30.0),
        request=lambda settings, seed: (settings, seed),
        observe=lambda request: observation(100 * request[1] + number, corner=request[0]["veil"]),
    )


def test_the_remainder_lies_where_the_effects_leave_it():
    scenes = [scene(number) for number in range(4)]
    place = remainder_places(scenes, {"veil": 0.0}, ["image"])["image"]
    assert place.zone == "top left" and place.scale == "image"
    assert place.frame is not None
    explained = remainder_places(scenes, {"veil": 30.0}, ["image"])["image"]
    assert explained.zone is None and explained.scale != "image"
    single = remainder_places(scenes[:1], {"veil": 0.0}, ["image"])["image"]
    assert single.zone is None and single.frame is None


def test_two_compared_captures_have_no_place():
    assert remainder_places([scene(0, against=observation(1))], {}, ["image"]) == {}
    assert remainder_places([scene(0)], {}, []) == {}
