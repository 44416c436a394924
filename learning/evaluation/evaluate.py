"""Scores of methods on held-out rooms, and their figures as plain values."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from starling.learning.data.example import Example, Image, known_holes
from starling.learning.evaluation import metrics
from starling.learning.evaluation.bootstrap import Difference, paired_difference
from starling.learning.evaluation.metrics import (
    Classification,
    Judged,
    Reliability,
    Roc,
    judge,
    pool,
    reliability,
    roc,
)
from starling.learning.features.holes import hole_kinds
from starling.sim.metrics import depth_edges

COMPARED = ("auc", "tpr_at_fpr10", "tpr_at_fpr4", "brier_skill")
_SURE = 0.5  # Threshold of the seed paper: at or above it a pixel has no depth.
_FALSE = 0.10  # False-positive rate at which detected holes are counted.
_CORNERS = 400  # Number of stored points of a curve.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class HolePrediction:
    """Predicted probability of a held-out scene."""

    example: Example  # With known holes.
    probability: Image  # (h, w)


@dataclass(frozen=True, kw_only=True, slots=True)
class KindScore:
    """Holes of one kind (`starling.learning.features.holes`) in all rooms."""

    share: float  # Share of all holes.
    sure: float  # Share of these holes with a probability of 0.5 or more.
    at_fpr10: float  # Share of these holes detected at a false-positive rate of 10 %.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Scores:
    """Scores of one method."""

    rooms: dict[str, Classification]
    # Without pixels within 3 px of a depth edge; rooms with no other holes are left out.
    rooms_off_edges: dict[str, Classification]
    curve: Roc  # Pooled over all pixels, reduced to fewer points.
    reliability: Reliability  # Pooled over all pixels.
    kinds: dict[str, KindScore]

    @property
    def mean(self) -> Classification:
        """Mean over rooms."""
        return metrics.mean(self.rooms)

    @property
    def worst(self) -> Classification:
        """Worst room of each metric."""
        return metrics.worst(self.rooms)


def scores(predictions: Sequence[HolePrediction]) -> Scores:
    """Score one method on all scenes.

    Raises:
        InputError: if all or none of a room's counted pixels have depth.
    """
    everywhere: dict[str, Judged] = {}
    off_edges: dict[str, Judged] = {}
    for scene in predictions:
        room = scene.example.room
        for rooms, judged in (
            (everywhere, _judged(scene)),
            (off_edges, _judged(scene, off_edges=True)),
        ):
            rooms[room] = pool([rooms[room], judged]) if room in rooms else judged
    together = pool(everywhere.values())
    curve = roc(together)
    mixed = {room: judged for room, judged in off_edges.items() if 0 < judged.share < 1}
    return Scores(
        rooms=metrics.by_room(everywhere.items()),
        rooms_off_edges=metrics.by_room(mixed.items()),
        curve=_thinned(curve),
        reliability=reliability(together),
        kinds=_kinds(predictions, _threshold(curve)),
    )


def differences(
    methods: Mapping[str, Scores], *, seed: int
) -> dict[str, dict[str, dict[str, Difference]]]:
    """Paired differences over rooms, later method less earlier: {later: {earlier: {metric: ...}}}.

    Args:
        methods: two or more methods scored on the same rooms.
        seed: seed of the bootstrap.

    Raises:
        InputError: if there is only one room.
    """
    result: dict[str, dict[str, dict[str, Difference]]] = {}
    for earlier, later in combinations(methods, 2):
        first, second = methods[later].rooms, methods[earlier].rooms
        result.setdefault(later, {})[earlier] = {
            name: paired_difference(
                [getattr(first[room], name) for room in first],
                [getattr(second[room], name) for room in first],
                list(first),
                seed=seed,
            )
            for name in COMPARED
        }
    return result


def _judged(scene: HolePrediction, *, off_edges: bool = False) -> Judged:
    ndp, counted = known_holes(scene.example)
    if off_edges:
        counted = counted & ~depth_edges(scene.example.info.disparity_px(scene.example.depth_m))
    return judge(scene.probability, ndp, counted)


def _threshold(curve: Roc) -> float:
    """Return the least probability that keeps the false-positive rate within its limit."""
    within = curve.false_positive_rate <= _FALSE
    return float(curve.threshold[np.flatnonzero(within)[-1]])


def _kinds(predictions: Sequence[HolePrediction], threshold: float) -> dict[str, KindScore]:
    counts: dict[str, list[int]] = {}
    for scene in predictions:
        ndp, counted = known_holes(scene.example)
        for name, mask in hole_kinds(scene.example).items():
            probability = scene.probability[mask & ndp & counted]
            row = counts.setdefault(name, [0, 0, 0])
            row[0] += probability.size
            row[1] += int(np.count_nonzero(probability >= _SURE))
            row[2] += int(np.count_nonzero(probability >= threshold))
    holes = sum(row[0] for row in counts.values())
    return {
        name: KindScore(
            share=number / max(holes, 1),
            sure=sure / max(number, 1),
            at_fpr10=detected / max(number, 1),
        )
        for name, (number, sure, detected) in counts.items()
    }


def _thinned(curve: Roc) -> Roc:
    """Reduce a curve to fewer points, evenly spaced along its length, with both ends."""
    across, up = curve.false_positive_rate, curve.true_positive_rate
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(across), np.diff(up)))])
    wanted = np.linspace(0, length[-1], _CORNERS)
    chosen = np.unique(np.clip(np.searchsorted(length, wanted), 0, len(across) - 1))
    return Roc(across[chosen], up[chosen], curve.threshold[chosen])


def figures(methods: Mapping[str, Scores], *, seed: int) -> dict[str, Any]:
    """Collect all metrics by method.

    Args:
        methods: methods scored on the same rooms.
        seed: seed of the bootstrap.

    Returns:
        `{"methods": {NAME: {FIGURE, ..., "worst", "off_edges", "kinds"}}, "rooms": {ROOM: {NAME:
        {FIGURE, ...}}}, "differences": {NAME: {EARLIER NAME: {FIGURE: {"mean", "low", "high",
        "rooms", "above"}}}}}`: means over rooms, worst room of each metric, and the mean off depth
        edges. `differences` is missing if there is only one room.
    """
    result: dict[str, Any] = {
        "methods": {
            name: {
                **dataclasses.asdict(scores.mean),
                "worst": dataclasses.asdict(scores.worst),
                "off_edges": _mean(scores.rooms_off_edges),
                "kinds": {kind: dataclasses.asdict(score) for kind, score in scores.kinds.items()},
            }
            for name, scores in methods.items()
        },
        "rooms": {},
    }
    for name, scores in methods.items():
        for room, score in scores.rooms.items():
            result["rooms"].setdefault(room, {})[name] = dataclasses.asdict(score)
    if all(len(scores.rooms) > 1 for scores in methods.values()):
        result["differences"] = {
            later: {
                earlier: {name: dataclasses.asdict(value) for name, value in by_figure.items()}
                for earlier, by_figure in by_earlier.items()
            }
            for later, by_earlier in differences(methods, seed=seed).items()
        }
    return result


def _mean(rooms: Mapping[str, Classification]) -> dict[str, float] | None:
    return dataclasses.asdict(metrics.mean(rooms)) if rooms else None
