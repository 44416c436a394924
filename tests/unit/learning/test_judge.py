"""The judge separates what differs, and nothing else; no room is on both sides of a fold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy import stats

from starling.learning.judge import judge as judging
from starling.learning.judge.figures import RoomScores, auc, interval, p_value, pooled_auc, summary
from starling.learning.judge.judge import Fold, folds, judge, room_scores
from starling.learning.judge.samples import ScenePair
from starling.learning.judge.training import JudgeSettings
from starling.patterns.errors import InputError

ROOMS = ("attic", "barn", "cellar", "den", "hall", "kitchen")
SETTINGS = JudgeSettings(steps=20, pairs=2)
SHAPE = (12, 18)  # Cells: 2 x 3 windows.


def _pair(room: str, *, excess: float, seed: int) -> ScenePair:
    """Draw shares; those of the simulated side are higher by `excess` in one channel."""
    rng = np.random.default_rng(seed)
    shares = rng.uniform(0.2, 0.4, (2, 2, 4, *SHAPE))
    shares[1, :, 1] += excess
    cells = torch.from_numpy(shares.astype(np.float32))
    return ScenePair(scene=room, room=room, cells=cells, shown=torch.ones(2, 1, *SHAPE))


def _pairs(excess: float) -> list[ScenePair]:
    return [_pair(room, excess=excess, seed=number) for number, room in enumerate(ROOMS)]


def _rooms(excess: float, count: int = 8, windows: int = 30) -> list[RoomScores]:
    rng = np.random.default_rng(5)
    return [
        RoomScores(
            room=str(number),
            real=rng.standard_normal(windows) + excess,
            sim=rng.standard_normal(windows),
        )
        for number in range(count)
    ]


def test_a_difference_is_found_in_every_unseen_room():
    figures = summary(room_scores(judge(_pairs(0.1), settings=SETTINGS).scenes), seed=0)
    assert figures["auc"] > 0.99
    assert all(area > 0.95 for area in figures["rooms"].values())
    assert figures["windows"] == 6 * len(ROOMS)


def test_equal_distributions_cannot_be_told_apart():
    rooms = room_scores(judge(_pairs(0.0), settings=SETTINGS).scenes)
    low, high = interval(rooms, 0)
    assert low < 0.5 < high
    assert p_value(rooms, 0) > 0.05


def test_a_set_has_no_difference_from_itself():
    pairs = [replace(pair, cells=pair.cells[[0, 0]]) for pair in _pairs(0.0)]
    figures = summary(room_scores(judge(pairs, settings=SETTINGS).scenes), seed=0)
    assert figures["auc"] == 0.5
    assert figures["p_value"] == 1


def test_results_depend_on_the_seed_alone():
    first, again, changed = (
        judge(_pairs(0.0), settings=SETTINGS, seed=seed).scenes[0].scores for seed in (1, 1, 2)
    )
    assert torch.equal(first, again)
    assert not torch.equal(first, changed)


def test_several_judges_give_their_mean_score_and_each_area():
    first, second = (judge(_pairs(0.1), settings=SETTINGS, seed=seed) for seed in (1, 2))
    both = judge(_pairs(0.1), settings=SETTINGS, seed=1, judges=2)
    assert both.areas == (*first.areas, *second.areas)
    for mean, one, other in zip(both.scenes, first.scenes, second.scenes, strict=True):
        expected = (one.scores + other.scores) / 2
        torch.testing.assert_close(mean.scores, expected, equal_nan=True)


def test_torch_keeps_its_threads_and_random_numbers():
    threads, state = torch.get_num_threads(), torch.get_rng_state()
    judge(_pairs(0.0), settings=replace(SETTINGS, steps=2))
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.get_rng_state(), state)


def test_no_network_learns_from_a_room_that_it_judges(monkeypatch):
    learned: list[set[str]] = []
    judged: list[set[str]] = []
    train, score = judging.trained, judging.scores

    def recording(learn, stop, settings, *, seed):
        assert not {pair.room for pair in learn} & {pair.room for pair in stop}
        learned.append({pair.room for pair in (*learn, *stop)})
        judged.append(set())
        return train(learn, stop, settings, seed=seed)

    def scoring(network, pair):
        judged[-1].add(pair.room)
        return score(network, pair)

    monkeypatch.setattr(judging, "trained", recording)
    monkeypatch.setattr(judging, "scores", scoring)
    pairs = [*_pairs(0.0), replace(_pair("hall", excess=0, seed=9), scene="hall again")]
    judge(pairs, settings=replace(SETTINGS, steps=2))
    assert all(not known & held for known, held in zip(learned, judged, strict=True))
    assert sorted(room for held in judged for room in held) == sorted(ROOMS)


@pytest.mark.parametrize("count", [3, 4, 5, 7, 10])
def test_each_room_is_judged_once(count):
    rooms = [str(number) for number in range(count)]
    parts = folds(rooms * 2, seed=3)
    assert sorted(room for fold in parts for room in fold.held) == sorted(rooms)
    assert all(fold.learn and fold.stop for fold in parts)
    assert all({*fold.learn, *fold.stop, *fold.held} == set(rooms) for fold in parts)


def test_a_room_in_two_parts_of_a_fold_is_refused():
    with pytest.raises(InputError, match="one part of a fold only; got hall"):
        Fold(learn=("attic", "hall"), stop=("barn",), held=("hall",))


def test_two_rooms_are_refused():
    with pytest.raises(InputError, match="rooms must be at least 3 to be judged; got 2"):
        judge(_pairs(0.0)[:2])


def test_hidden_cells_do_not_count():
    pairs = _pairs(0.1)
    shown = torch.ones(2, 1, *SHAPE)
    shown[..., 6:] = 0  # Two of three columns of windows.
    hidden = [replace(pair, cells=pair.cells * shown, shown=shown) for pair in pairs]
    judged = judge(hidden, settings=SETTINGS).scenes
    assert all(torch.isnan(scene.scores[..., 1:]).all() for scene in judged)
    figures = summary(room_scores(judged), seed=0)
    assert figures["windows"] == 2 * len(ROOMS)
    assert figures["auc"] > 0.95


def test_area_is_the_share_of_ordered_pairs():
    assert auc(np.array([1.0, 2.0]), np.array([0.0, 1.0])) == 3.5 / 4
    assert np.isnan(auc(np.array([]), np.array([1.0])))


def test_area_of_two_normal_laws():
    rooms = _rooms(1.0, count=20, windows=400)
    assert pooled_auc(rooms) == pytest.approx(stats.norm.cdf(1 / np.sqrt(2)), abs=0.01)


def test_the_interval_narrows_with_more_rooms():
    widths = [np.ptp(interval(_rooms(1.0, count=count), 0)) for count in (4, 16)]
    assert widths[1] < widths[0] / 2


def test_the_interval_holds_the_true_area_in_most_draws():
    inside = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        rooms = []
        for number in range(8):
            shift = rng.normal(1.0, 0.3)  # Rooms differ.
            real, sim = rng.standard_normal((2, 60))
            rooms.append(RoomScores(room=str(number), real=real + shift, sim=sim))
        low, high = interval(rooms, seed)
        inside += low <= stats.norm.cdf(1 / np.sqrt(2 + 0.3**2)) <= high
    assert inside >= 17


def test_the_least_p_value_is_that_of_the_rooms_signs():
    rooms = _rooms(5.0, count=5)
    # All rooms swapped, or none: 2 of 32 draws.
    assert p_value(rooms, 0) == pytest.approx(2 / 32, abs=0.02)
    assert p_value(_rooms(0.0), 0) > 0.05
