"""The judge: a classifier two-sample test of simulated against real captures, by room."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from starling.learning.judge.figures import RoomScores, pooled_auc
from starling.learning.judge.samples import ScenePair, counted_windows
from starling.learning.judge.training import JudgeSettings, scores, trained
from starling.patterns import errors
from starling.sim.console import progress
from starling.sim.randomness import generator

FOLDS = 5  # Groups of rooms, each judged by a network that saw none of its rooms.
_LEAST_ROOMS = 3  # One to learn from, one to stop by, one to judge.


@dataclass(frozen=True, kw_only=True, slots=True)
class Fold:
    """Rooms to learn from, to end the training by, and to judge; they share none."""

    learn: tuple[str, ...]
    stop: tuple[str, ...]
    held: tuple[str, ...]

    def __post_init__(self) -> None:
        listed = (*self.learn, *self.stop, *self.held)
        if len(set(listed)) < len(listed):
            repeated = sorted({room for room in listed if listed.count(room) > 1})
            rule, advice = "must be in one part of a fold only", "Split by room."
            raise errors.refuse("rooms", rule, ", ".join(repeated), advice)


def folds(rooms: Sequence[str], seed: int) -> tuple[Fold, ...]:
    """Split rooms in random order; the rooms of the next group end the training.

    Raises:
        InputError: if there are fewer than three rooms.
    """
    names = sorted(set(rooms))
    if len(names) < _LEAST_ROOMS:
        rule = f"must be at least {_LEAST_ROOMS} to be judged"
        raise errors.refuse("rooms", rule, len(names), "Take captures of more rooms.")
    order = [names[n] for n in generator(seed, 0, "judge", "folds").permutation(len(names))]
    count = min(FOLDS, len(order))
    groups = [tuple(order[number::count]) for number in range(count)]
    result = []
    for number, held in enumerate(groups):
        stop = groups[(number + 1) % count][:1]
        learn = tuple(name for name in order if name not in (*held, *stop))
        result.append(Fold(learn=learn, stop=stop, held=held))
    return tuple(result)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class JudgedScene:
    """Held-out scores of a scene's windows; NaN where a window is not judged."""

    pair: ScenePair
    scores: Tensor  # (2 sides, rows, columns)


def refuse_judges(judges: int) -> None:
    """Refuse a number of judges outside 1 to 100."""
    errors.whole_number("judges", judges, 1, 100, "Give 1, or 5 for a steadier figure.")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Judgement:
    """Scores of several judges, which differ by the groups of rooms and by the initial weights."""

    scenes: list[JudgedScene]  # Mean scores.
    areas: tuple[float, ...]  # Area under the ROC curve of each judge.


def judge(
    pairs: Sequence[ScenePair],
    *,
    judges: int = 1,
    settings: JudgeSettings | None = None,
    seed: int = 0,
    track: progress.Progress = progress.silent,
) -> Judgement:
    """Score every scene by networks that learned from other rooms.

    Args:
        pairs: scenes of at least three rooms.
        judges: number of judges, 1 to 100. A single one varies with its seed.
        settings: settings of the training.
        seed: seed of the first judge; the others have the following ones. Independent runs need
            seeds that are at least `judges` apart.
        track: wraps the long loops.

    Raises:
        InputError: if there are fewer than three rooms, or no judge.
    """
    refuse_judges(judges)
    settings = settings or JudgeSettings()
    verdicts = [_judge_once(pairs, settings, seed + number, track) for number in range(judges)]
    mean = [
        replace(same[0], scores=torch.stack([each.scores for each in same]).mean(dim=0))
        for same in zip(*verdicts, strict=True)
    ]
    areas = tuple(pooled_auc(room_scores(scenes)) for scenes in verdicts)
    return Judgement(scenes=mean, areas=areas)


def _judge_once(
    pairs: Sequence[ScenePair], settings: JudgeSettings, seed: int, track: progress.Progress
) -> list[JudgedScene]:
    result: dict[str, JudgedScene] = {}
    with _one_thread():
        for fold in track(folds([pair.room for pair in pairs], seed), "judge"):
            parts = [
                [pair for pair in pairs if pair.room in rooms]
                for rooms in (fold.learn, fold.stop, fold.held)
            ]
            network = trained(parts[0], parts[1], settings, seed=seed)
            for pair in parts[2]:
                score = scores(network, pair)
                score[:, ~counted_windows(pair.shown)[0]] = float("nan")
                result[pair.scene] = JudgedScene(pair=pair, scores=score)
    return [result[pair.scene] for pair in pairs]


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit PyTorch to one thread: its layers here are too small to share."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def room_scores(judged: Sequence[JudgedScene]) -> list[RoomScores]:
    """Collect the judged windows of each room."""
    rooms = dict.fromkeys(each.pair.room for each in judged)
    result = []
    for room in rooms:
        sides = []
        for side in (0, 1):
            values = [
                each.scores[side].flatten().numpy() for each in judged if each.pair.room == room
            ]
            joined = np.concatenate(values).astype(np.float64)
            sides.append(joined[np.isfinite(joined)])
        result.append(RoomScores(room=room, real=sides[0], sim=sides[1]))
    return result
