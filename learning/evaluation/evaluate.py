"""Methods judged on rooms that they have not learnt from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from starling.learning.data.example import Example, Image
from starling.learning.data.learnable import known_holes
from starling.learning.evaluation.figures import classification
from starling.learning.evaluation.figures.bootstrap import Difference, paired_difference
from starling.learning.evaluation.figures.classification import Classification
from starling.learning.evaluation.figures.judged import Judged, judge, pool
from starling.learning.evaluation.figures.reliability import Reliability, reliability
from starling.learning.evaluation.figures.roc import Roc, roc
from starling.learning.features.hole_kinds import hole_kinds
from starling.sim.metrics import depth_edges

COMPARED = ("auc", "tpr_at_fpr10", "tpr_at_fpr4", "brier_skill")
_SURE = 0.5  # The seed's threshold: at or above it a pixel has no depth.
_FALSE = 0.10  # False-positive rate at which holes are counted as found.
_CORNERS = 400  # Of a curve that is kept.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Told:
    """What a method says of a scene that it has not learnt from."""

    example: Example  # With its holes.
    probability: Image  # (h, w)


@dataclass(frozen=True, kw_only=True, slots=True)
class Found:
    """Holes of one kind (`starling.learning.features.hole_kinds`) in all rooms."""

    share: float  # Of all holes.
    sure: float  # Share of them that is told with a probability of 0.5 or more.
    at_fpr10: float  # Share found where one in ten pixels with depth is taken for a hole.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Scores:
    """How well one method does."""

    rooms: dict[str, Classification]
    # Without pixels within 3 px of a depth edge; rooms whose holes all lie there are left out.
    rooms_off_edges: dict[str, Classification]
    curve: Roc  # Of all pixels together, thinned.
    reliability: Reliability  # Likewise.
    kinds: dict[str, Found]

    @property
    def mean(self) -> Classification:
        """Average over rooms."""
        return classification.mean(self.rooms)

    @property
    def worst(self) -> Classification:
        """Worst room of each figure."""
        return classification.worst(self.rooms)


def scores(told: Sequence[Told]) -> Scores:
    """Judge one method on all scenes.

    Raises:
        InputError: if a room's counted pixels all have depth, or none has.
    """
    everywhere = [(one.example.room, _judged(one)) for one in told]
    off_edges = _with_both_kinds([(one.example.room, _judged(one, off_edges=True)) for one in told])
    together = pool(judged for _, judged in everywhere)
    curve = roc(together)
    return Scores(
        rooms=classification.by_room(everywhere),
        rooms_off_edges=classification.by_room(off_edges),
        curve=_thinned(curve),
        reliability=reliability(together),
        kinds=_kinds(told, _threshold(curve)),
    )


def differences(
    methods: Mapping[str, Scores], *, seed: int
) -> dict[str, dict[str, dict[str, Difference]]]:
    """Paired differences over rooms, later method less earlier: {later: {earlier: {figure: ...}}}.

    Args:
        methods: judged on the same rooms, two at least.
        seed: fixes the bootstrap.

    Raises:
        InputError: if there is one room only.
    """
    found: dict[str, dict[str, dict[str, Difference]]] = {}
    for earlier, later in combinations(methods, 2):
        first, second = methods[later].rooms, methods[earlier].rooms
        found.setdefault(later, {})[earlier] = {
            name: paired_difference(
                [getattr(first[room], name) for room in first],
                [getattr(second[room], name) for room in first],
                list(first),
                seed=seed,
            )
            for name in COMPARED
        }
    return found


def _judged(told: Told, *, off_edges: bool = False) -> Judged:
    ndp, counted = known_holes(told.example)
    if off_edges:
        counted = counted & ~depth_edges(told.example.info.disparity_px(told.example.depth_m))
    return judge(told.probability, ndp, counted)


def _with_both_kinds(scenes: Sequence[tuple[str, Judged]]) -> list[tuple[str, Judged]]:
    """Scenes of rooms that have pixels with depth and without."""
    of_room: dict[str, list[Judged]] = {}
    for room, judged in scenes:
        of_room.setdefault(room, []).append(judged)
    mixed = {room for room, its in of_room.items() if 0 < pool(its).share < 1}
    return [(room, judged) for room, judged in scenes if room in mixed]


def _threshold(curve: Roc) -> float:
    """Least probability told that keeps false positives within their share."""
    within = curve.false_positive_rate <= _FALSE
    return float(curve.threshold[np.flatnonzero(within)[-1]])


def _kinds(told: Sequence[Told], threshold: float) -> dict[str, Found]:
    counts: dict[str, list[int]] = {}
    for one in told:
        ndp, counted = known_holes(one.example)
        for name, mask in hole_kinds(one.example).items():
            told_there = one.probability[mask & ndp & counted]
            row = counts.setdefault(name, [0, 0, 0])
            row[0] += told_there.size
            row[1] += int(np.count_nonzero(told_there >= _SURE))
            row[2] += int(np.count_nonzero(told_there >= threshold))
    holes = sum(row[0] for row in counts.values())
    return {
        name: Found(
            share=number / max(holes, 1),
            sure=sure / max(number, 1),
            at_fpr10=found / max(number, 1),
        )
        for name, (number, sure, found) in counts.items()
    }


def _thinned(curve: Roc) -> Roc:
    """Fewer corners, evenly along the curve's length, with both ends."""
    across, up = curve.false_positive_rate, curve.true_positive_rate
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(across), np.diff(up)))])
    wanted = np.linspace(0, length[-1], _CORNERS)
    kept = np.unique(np.clip(np.searchsorted(length, wanted), 0, len(across) - 1))
    return Roc(across[kept], up[kept], curve.threshold[kept])
