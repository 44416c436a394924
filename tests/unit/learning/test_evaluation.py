"""Methods judged: figures by room and by kind of hole, and differences between methods."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from starling.learning.data.example import Example
from starling.learning.data.learnable import known_holes
from starling.learning.evaluation import evaluate
from starling.learning.evaluation.evaluate import Told
from starling.learning.evaluation.figures.judged import judge, pool
from starling.learning.evaluation.figures.roc import roc
from starling.learning.features.hole_kinds import KINDS
from starling.patterns.errors import InputError
from tests.unit.learning.seen import HEIGHT, WIDTH, example, flat
from tests.unit.learning.step_scenes import SHAPE, step_scene


def seen(number: int) -> Example:
    """Holes behind a pillar, and one pixel in fifty by chance."""
    scene = step_scene(number, room=f"room {number % 3}")
    assert scene.ndp is not None
    chance = np.random.default_rng(number).random(SHAPE) < 0.02
    return dataclasses.replace(scene, ndp=scene.ndp | chance)


SCENES = [seen(number) for number in range(6)]


def perfect() -> list[Told]:
    """What a method tells that knows the holes."""
    return [Told(example=s, probability=known_holes(s)[0].astype(np.float32)) for s in SCENES]


def noisy(seed: int, noise: float) -> list[Told]:
    """What one tells that sees them dimly."""
    rng = np.random.default_rng(seed)
    told = []
    for scene in SCENES:
        seen = known_holes(scene)[0] + rng.normal(0, noise, SHAPE)
        told.append(Told(example=scene, probability=np.clip(seen, 0, 1).astype(np.float32)))
    return told


def constant() -> list[Told]:
    return [Told(example=s, probability=np.full(SHAPE, 0.2, np.float32)) for s in SCENES]


def test_a_perfect_probability_ranks_and_tells_perfectly():
    found = evaluate.scores(perfect())
    assert list(found.rooms) == list(found.rooms_off_edges) == ["room 0", "room 1", "room 2"]
    for one in (found.mean, found.worst, *found.rooms.values(), *found.rooms_off_edges.values()):
        assert (one.auc, one.tpr_at_fpr4, one.tpr_at_fpr10) == (1, 1, 1)
        assert (one.brier, one.brier_skill, one.ece) == (0, 1, 0)
    assert all(one.sure == one.at_fpr10 == 1 for one in found.kinds.values() if one.share)


def test_telling_the_same_everywhere_ranks_as_chance_and_finds_nothing():
    found = evaluate.scores(constant())
    assert found.mean.auc == pytest.approx(0.5)
    assert found.mean.brier_skill < 0
    assert {(one.sure, one.at_fpr10) for one in found.kinds.values()} == {(0.0, 0.0)}


@settings(max_examples=3)
@given(seed=st.integers(0, 2**32), noise=st.floats(0.01, 2))
def test_shares_of_the_kinds_sum_to_one_and_found_holes_to_the_curve(seed, noise):
    found = evaluate.scores(noisy(seed, noise))
    kinds = found.kinds
    assert list(kinds) == list(KINDS)
    assert sum(one.share for one in kinds.values()) == pytest.approx(1)
    together = sum(one.share * one.at_fpr10 for one in kinds.values())
    curve = roc(
        pool(judge(one.probability, *known_holes(one.example)) for one in noisy(seed, noise))
    )
    within = curve.true_positive_rate[curve.false_positive_rate <= 0.1]
    assert together == pytest.approx(within[-1])


def made() -> Told:
    """A wall whose left quarter is dark: 100 holes there, 300 elsewhere, 6800 pixels with depth.

    Told: the dark holes 0.9; of the others 200 are told 0.4 and 100 0.05. Of the pixels with depth
    340, which is one in twenty, are told 0.4 too, and the rest 0.05.
    """
    light = np.full((HEIGHT, WIDTH), 0.6, np.float32)
    light[:, : WIDTH // 4] = 0.1
    dark = np.flatnonzero(light.ravel() < 0.5)
    bright = np.flatnonzero(light.ravel() > 0.5)
    ndp = np.zeros(HEIGHT * WIDTH, bool)
    ndp[dark[:100]] = ndp[bright[:300]] = True
    told = np.full(HEIGHT * WIDTH, 0.05, np.float32)
    told[dark[:100]] = 0.9
    told[bright[:200]] = 0.4
    told[bright[300:640]] = 0.4
    scene = example(
        flat(20.0),
        reflectance=light,
        ndp=ndp.reshape(HEIGHT, WIDTH),
        counted=np.ones((HEIGHT, WIDTH), bool),
    )
    return Told(example=scene, probability=told.reshape(HEIGHT, WIDTH))


def test_found_holes_of_each_kind_by_hand():
    found = evaluate.scores([made()]).kinds
    assert {name for name, one in found.items() if one.share} == {"dark", "other"}
    assert found["dark"] == evaluate.Found(share=0.25, sure=1.0, at_fpr10=1.0)
    assert (found["other"].share, found["other"].sure) == (0.75, 0.0)
    assert found["other"].at_fpr10 == pytest.approx(2 / 3)
    assert found["near"] == evaluate.Found(share=0.0, sure=0.0, at_fpr10=0.0)


def test_what_does_not_count_is_no_hole():
    """Without the dark quarter: holes are the others', and the false ones 340 of 5100."""
    one = made()
    light, counted = one.example.reflectance, one.example.counted
    assert light is not None and counted is not None
    scene = dataclasses.replace(one.example, counted=counted & (light > 0.5))
    found = evaluate.scores([Told(example=scene, probability=one.probability)])
    assert found.kinds["dark"].share == 0
    assert (found.kinds["other"].share, found.kinds["other"].sure) == (1, 0)
    assert found.kinds["other"].at_fpr10 == pytest.approx(2 / 3)
    # Corners (0, 0), (1/15, 2/3), (1, 1): a tenth lies 1/28 of the last stretch up.
    assert found.mean.tpr_at_fpr10 == pytest.approx(2 / 3 + 1 / 28 / 3)


def test_scenes_of_a_room_are_judged_together_and_rooms_count_alike():
    told = noisy(1, 0.5)
    found = evaluate.scores(told)
    of_room = [one for one in told if one.example.room == "room 1"]
    alone = evaluate.scores(of_room)
    assert alone.mean == alone.worst == found.rooms["room 1"]
    aucs = [one.auc for one in found.rooms.values()]
    assert found.mean.auc == pytest.approx(np.mean(aucs))
    assert found.worst.auc == min(aucs)


def test_pixels_at_depth_edges_are_left_out_of_the_second_figures():
    """Told wrongly within 2 px of an edge alone, a method is perfect off the edges."""
    told = []
    for one in perfect():
        disparity = one.example.info.disparity_px(one.example.depth_m)
        near_step = np.zeros(SHAPE, bool)
        step = np.abs(np.diff(disparity, axis=1)) > 1
        for shift in (-2, -1, 0, 1, 2, 3):
            near_step |= np.roll(np.pad(step, ((0, 0), (0, 1))), shift, axis=1)
        wrong = np.where(near_step, 1 - one.probability, one.probability)
        told.append(Told(example=one.example, probability=wrong))
    found = evaluate.scores(told)
    assert found.worst.auc < 0.95
    assert {one.auc for one in found.rooms_off_edges.values()} == {1.0}


def test_the_kept_curve_is_short_and_nearly_the_whole_one():
    told = noisy(3, 0.4)
    found = evaluate.scores(told)
    whole = roc(pool(judge(one.probability, *known_holes(one.example)) for one in told))
    kept = found.curve
    assert len(kept.threshold) <= 400 < len(whole.threshold)
    for rate in (kept.false_positive_rate, kept.true_positive_rate):
        assert_array_equal(rate[[0, -1]], [0, 1])
    assert kept.area == pytest.approx(whole.area, abs=2e-3)
    assert (np.diff(kept.threshold) < 0).all()
    assert found.reliability.pixels.sum() == 6 * 48 * 32


def test_differences_are_later_less_earlier():
    scores = {
        "chance": evaluate.scores(constant()),
        "dim": evaluate.scores(noisy(0, 0.5)),
        "perfect": evaluate.scores(perfect()),
    }
    found = evaluate.differences(scores, seed=0)
    assert {later: list(row) for later, row in found.items()} == {
        "dim": ["chance"],
        "perfect": ["chance", "dim"],
    }
    gain = found["perfect"]["chance"]
    assert tuple(gain) == evaluate.COMPARED
    assert gain["auc"].mean == pytest.approx(0.5)
    assert (gain["auc"].rooms, gain["auc"].above) == (3, 3)
    assert gain["auc"].excludes_zero
    mean = {name: one.mean for name, one in scores.items()}
    for name in evaluate.COMPARED:
        expected = getattr(mean["perfect"], name) - getattr(mean["dim"], name)
        assert found["perfect"]["dim"][name].mean == pytest.approx(expected)
        assert expected > 0
    turned = evaluate.differences(dict(reversed(scores.items())), seed=0)
    assert turned["chance"]["perfect"]["auc"].mean == pytest.approx(-0.5)
    assert turned["chance"]["perfect"]["auc"].above == 0


def test_one_room_has_no_differences():
    one_room = {
        name: evaluate.scores([one for one in told if one.example.room == "room 0"])
        for name, told in (("perfect", perfect()), ("chance", constant()))
    }
    with pytest.raises(InputError, match=r"rooms must be at least 2; got 1\. One room tells no"):
        evaluate.differences(one_room, seed=0)


@pytest.mark.parametrize("fill", [False, True])
def test_a_room_of_one_kind_of_pixels_is_refused_by_its_name(fill):
    scene = dataclasses.replace(SCENES[0], room="cell", ndp=np.full(SHAPE, fill))
    told = [*perfect(), Told(example=scene, probability=np.zeros(SHAPE, np.float32))]
    rule = "room cell: no-depth pixels must be some and not all of the counted ones"
    line = f"{rule}; got {fill * 1536} of 1536"
    with pytest.raises(InputError, match=line) as caught:
        evaluate.scores(told)
    assert "\n" not in str(caught.value)


def test_rooms_whose_holes_all_lie_at_edges_count_there_alone():
    depth_m = np.full(SHAPE, 0.5, np.float32)
    depth_m[:, 30:] = 0.25
    at_edge = np.zeros(SHAPE, bool)
    at_edge[:, 30] = True
    everywhere = np.ones(SHAPE, bool)
    plain = dataclasses.replace(step_scene(0), depth_m=depth_m, ndp=at_edge, counted=everywhere)
    told = [
        Told(example=one, probability=known_holes(one)[0].astype(np.float32))
        for one in (plain, seen(1), seen(2))
    ]
    found = evaluate.scores(told)
    assert list(found.rooms) == ["room 1", "room 2", "room0"]
    assert list(found.rooms_off_edges) == ["room 1", "room 2"]
