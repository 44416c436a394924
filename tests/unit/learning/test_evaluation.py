"""Scores of methods by room and kind of hole, and differences between methods."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from starling.learning.data.example import Example, known_holes
from starling.learning.evaluation import evaluate
from starling.learning.evaluation.evaluate import HolePrediction
from starling.learning.evaluation.metrics import judge, pool, roc
from starling.learning.features.holes import KINDS
from starling.patterns.errors import InputError
from tests.unit.learning.seen import HEIGHT, WIDTH, example, flat
from tests.unit.learning.step_scenes import SHAPE, step_scene


def seen(number: int) -> Example:
    """Half-occlusion next to a pillar, and one random pixel in fifty."""
    scene = step_scene(number, room=f"room {number % 3}")
    assert scene.ndp is not None
    chance = np.random.default_rng(number).random(SHAPE) < 0.02
    return dataclasses.replace(scene, ndp=scene.ndp | chance)


SCENES = [seen(number) for number in range(6)]


def perfect() -> list[HolePrediction]:
    """Prediction of a method that knows the holes."""
    return [
        HolePrediction(example=s, probability=known_holes(s)[0].astype(np.float32)) for s in SCENES
    ]


def noisy(seed: int, noise: float) -> list[HolePrediction]:
    """Prediction of a method that knows the holes roughly."""
    rng = np.random.default_rng(seed)
    report = []
    for scene in SCENES:
        seen = known_holes(scene)[0] + rng.normal(0, noise, SHAPE)
        report.append(
            HolePrediction(example=scene, probability=np.clip(seen, 0, 1).astype(np.float32))
        )
    return report


def constant() -> list[HolePrediction]:
    return [HolePrediction(example=s, probability=np.full(SHAPE, 0.2, np.float32)) for s in SCENES]


def test_a_perfect_probability_has_perfect_scores():
    result = evaluate.scores(perfect())
    assert list(result.rooms) == list(result.rooms_off_edges) == ["room 0", "room 1", "room 2"]
    for rooms_off_edge in (
        result.mean,
        result.worst,
        *result.rooms.values(),
        *result.rooms_off_edges.values(),
    ):
        assert (rooms_off_edge.auc, rooms_off_edge.tpr_at_fpr4, rooms_off_edge.tpr_at_fpr10) == (
            1,
            1,
            1,
        )
        assert (rooms_off_edge.brier, rooms_off_edge.brier_skill, rooms_off_edge.ece) == (0, 1, 0)
    assert all(kind.sure == kind.at_fpr10 == 1 for kind in result.kinds.values() if kind.share)


def test_a_constant_probability_has_the_scores_of_chance():
    result = evaluate.scores(constant())
    assert result.mean.auc == pytest.approx(0.5)
    assert result.mean.brier_skill < 0
    assert {(kind.sure, kind.at_fpr10) for kind in result.kinds.values()} == {(0.0, 0.0)}


@settings(max_examples=3)
@given(seed=st.integers(0, 2**32), noise=st.floats(0.01, 2))
def test_shares_of_the_kinds_sum_to_one_and_detections_to_the_curve(seed, noise):
    result = evaluate.scores(noisy(seed, noise))
    kinds = result.kinds
    assert list(kinds) == list(KINDS)
    assert sum(kind.share for kind in kinds.values()) == pytest.approx(1)
    together = sum(kind.share * kind.at_fpr10 for kind in kinds.values())
    curve = roc(
        pool(judge(item.probability, *known_holes(item.example)) for item in noisy(seed, noise))
    )
    within = curve.true_positive_rate[curve.false_positive_rate <= 0.1]
    assert together == pytest.approx(within[-1])


def dark_quarter() -> HolePrediction:
    """A wall whose left quarter is dark: 100 holes there, 300 elsewhere, 6800 pixels with depth.

    Predicted: 0.9 for the dark holes; 0.4 for 200 of the others and 0.05 for 100. Of the pixels
    with depth, 340 (one in twenty) have 0.4 too, and the rest 0.05.
    """
    light = np.full((HEIGHT, WIDTH), 0.6, np.float32)
    light[:, : WIDTH // 4] = 0.1
    dark = np.flatnonzero(light.ravel() < 0.5)
    bright = np.flatnonzero(light.ravel() > 0.5)
    ndp = np.zeros(HEIGHT * WIDTH, bool)
    ndp[dark[:100]] = ndp[bright[:300]] = True
    report = np.full(HEIGHT * WIDTH, 0.05, np.float32)
    report[dark[:100]] = 0.9
    report[bright[:200]] = 0.4
    report[bright[300:640]] = 0.4
    scene = example(
        flat(20.0),
        reflectance=light,
        ndp=ndp.reshape(HEIGHT, WIDTH),
        counted=np.ones((HEIGHT, WIDTH), bool),
    )
    return HolePrediction(example=scene, probability=report.reshape(HEIGHT, WIDTH))


def test_detected_holes_of_each_kind_by_hand():
    result = evaluate.scores([dark_quarter()]).kinds
    assert {name for name, item in result.items() if item.share} == {"dark", "other"}
    assert result["dark"] == evaluate.KindScore(share=0.25, sure=1.0, at_fpr10=1.0)
    assert (result["other"].share, result["other"].sure) == (0.75, 0.0)
    assert result["other"].at_fpr10 == pytest.approx(2 / 3)
    assert result["near"] == evaluate.KindScore(share=0.0, sure=0.0, at_fpr10=0.0)


def test_uncounted_pixels_are_not_holes():
    """Without the dark quarter: holes are the others', and the false ones 340 of 5100."""
    item = dark_quarter()
    light, counted = item.example.reflectance, item.example.counted
    assert light is not None and counted is not None
    scene = dataclasses.replace(item.example, counted=counted & (light > 0.5))
    result = evaluate.scores([HolePrediction(example=scene, probability=item.probability)])
    assert result.kinds["dark"].share == 0
    assert (result.kinds["other"].share, result.kinds["other"].sure) == (1, 0)
    assert result.kinds["other"].at_fpr10 == pytest.approx(2 / 3)
    # Corners (0, 0), (1/15, 2/3), (1, 1): 0.1 is 1/28 along the last segment.
    assert result.mean.tpr_at_fpr10 == pytest.approx(2 / 3 + 1 / 28 / 3)


def test_scenes_of_a_room_are_pooled_and_rooms_weighted_equally():
    report = noisy(1, 0.5)
    result = evaluate.scores(report)
    of_room = [item for item in report if item.example.room == "room 1"]
    alone = evaluate.scores(of_room)
    assert alone.mean == alone.worst == result.rooms["room 1"]
    aucs = [room.auc for room in result.rooms.values()]
    assert result.mean.auc == pytest.approx(np.mean(aucs))
    assert result.worst.auc == min(aucs)


def test_scores_off_edges_exclude_pixels_at_edges():
    """A method that is wrong only within 2 px of an edge is perfect off the edges."""
    report = []
    for item in perfect():
        disparity = item.example.info.disparity_px(item.example.depth_m)
        near_step = np.zeros(SHAPE, bool)
        step = np.abs(np.diff(disparity, axis=1)) > 1
        for shift in (-2, -1, 0, 1, 2, 3):
            near_step |= np.roll(np.pad(step, ((0, 0), (0, 1))), shift, axis=1)
        wrong = np.where(near_step, 1 - item.probability, item.probability)
        report.append(HolePrediction(example=item.example, probability=wrong))
    result = evaluate.scores(report)
    assert result.worst.auc < 0.95
    assert {rooms_off_edge.auc for rooms_off_edge in result.rooms_off_edges.values()} == {1.0}


def test_the_reduced_curve_is_close_to_the_full_one():
    report = noisy(3, 0.4)
    result = evaluate.scores(report)
    whole = roc(pool(judge(item.probability, *known_holes(item.example)) for item in report))
    remaining = result.curve
    assert len(remaining.threshold) <= 400 < len(whole.threshold)
    for rate in (remaining.false_positive_rate, remaining.true_positive_rate):
        assert_array_equal(rate[[0, -1]], [0, 1])
    assert remaining.area == pytest.approx(whole.area, abs=2e-3)
    assert (np.diff(remaining.threshold) < 0).all()
    assert result.reliability.pixels.sum() == 6 * 48 * 32


def test_differences_are_later_less_earlier():
    scores = {
        "chance": evaluate.scores(constant()),
        "dim": evaluate.scores(noisy(0, 0.5)),
        "perfect": evaluate.scores(perfect()),
    }
    result = evaluate.differences(scores, seed=0)
    assert {later: list(row) for later, row in result.items()} == {
        "dim": ["chance"],
        "perfect": ["chance", "dim"],
    }
    gain = result["perfect"]["chance"]
    assert tuple(gain) == evaluate.COMPARED
    assert gain["auc"].mean == pytest.approx(0.5)
    assert (gain["auc"].rooms, gain["auc"].above) == (3, 3)
    assert gain["auc"].low > 0
    mean = {name: item.mean for name, item in scores.items()}
    for name in evaluate.COMPARED:
        expected = getattr(mean["perfect"], name) - getattr(mean["dim"], name)
        assert result["perfect"]["dim"][name].mean == pytest.approx(expected)
        assert expected > 0
    turned = evaluate.differences(dict(reversed(scores.items())), seed=0)
    assert turned["chance"]["perfect"]["auc"].mean == pytest.approx(-0.5)
    assert turned["chance"]["perfect"]["auc"].above == 0


def test_one_room_has_no_differences():
    one_room = {
        name: evaluate.scores([item for item in report if item.example.room == "room 0"])
        for name, report in (("perfect", perfect()), ("chance", constant()))
    }
    with pytest.raises(InputError, match=r"rooms must be at least 2; got 1\. One room has no"):
        evaluate.differences(one_room, seed=0)


@pytest.mark.parametrize("fill", [False, True])
def test_a_room_of_one_kind_of_pixels_is_named_in_the_refusal(fill):
    scene = dataclasses.replace(SCENES[0], room="cell", ndp=np.full(SHAPE, fill))
    report = [*perfect(), HolePrediction(example=scene, probability=np.zeros(SHAPE, np.float32))]
    rule = "room cell: no-depth pixels must be some and not all of the counted ones"
    line = f"{rule}; got {fill * 1536} of 1536"
    with pytest.raises(InputError, match=line) as caught:
        evaluate.scores(report)
    assert "\n" not in str(caught.value)


def test_rooms_with_holes_at_edges_only_have_no_scores_off_edges():
    depth_m = np.full(SHAPE, 0.5, np.float32)
    depth_m[:, 30:] = 0.25
    at_edge = np.zeros(SHAPE, bool)
    at_edge[:, 30] = True
    everywhere = np.ones(SHAPE, bool)
    plain = dataclasses.replace(step_scene(0), depth_m=depth_m, ndp=at_edge, counted=everywhere)
    report = [
        HolePrediction(example=item, probability=known_holes(item)[0].astype(np.float32))
        for item in (plain, seen(1), seen(2))
    ]
    result = evaluate.scores(report)
    assert list(result.rooms) == ["room 1", "room 2", "room0"]
    assert list(result.rooms_off_edges) == ["room 1", "room 2"]
