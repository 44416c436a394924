"""All metrics of one method: by room, their mean and their worst."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from starling.learning.evaluation.figures import proper_scores
from starling.learning.evaluation.figures.judged import Judged, pool
from starling.learning.evaluation.figures.reliability import reliability
from starling.learning.evaluation.figures.roc import roc
from starling.patterns import errors

_LESS_IS_BETTER = frozenset({"brier", "log_loss", "ece"})


@dataclass(frozen=True, kw_only=True, slots=True)
class Classification:
    """Metrics of the pixels of one room, or of several rooms pooled."""

    auc: float  # Area under the ROC curve.
    tpr_at_fpr4: float  # True-positive rate at a false-positive rate of 4 %.
    tpr_at_fpr10: float  # True-positive rate at a false-positive rate of 10 %.
    brier: float
    brier_skill: float  # Relative to predicting the pixels' own share.
    log_loss: float  # [nat]
    ece: float  # Expected calibration error, 15 bins of equal count.


def classification(judged: Judged) -> Classification:
    """Compute all metrics.

    Raises:
        InputError: if all or none of the pixels have depth.
    """
    curve = roc(judged)
    return Classification(
        auc=curve.area,
        tpr_at_fpr4=curve.true_positive_rate_at(0.04),
        tpr_at_fpr10=curve.true_positive_rate_at(0.10),
        brier=proper_scores.brier(judged),
        brier_skill=proper_scores.brier_skill(judged),
        log_loss=proper_scores.log_loss(judged),
        ece=reliability(judged).expected_calibration_error,
    )


def by_room(scenes: Iterable[tuple[str, Judged]]) -> dict[str, Classification]:
    """Compute the metrics of each room over the pixels of all its scenes, in alphabetical order.

    Args:
        scenes: room and judged pixels of each scene.

    Raises:
        InputError: if all or none of a room's pixels have depth; the message names the room.
    """
    rooms: dict[str, list[Judged]] = {}
    for room, judged in scenes:
        rooms.setdefault(room, []).append(judged)
    figures = {}
    for room in sorted(rooms):
        try:
            figures[room] = classification(pool(rooms[room]))
        except errors.InputError as error:
            raise errors.InputError(f"room {room}: {error}") from error
    return figures


def mean(rooms: Mapping[str, Classification]) -> Classification:
    """Average over rooms with equal weights.

    Raises:
        InputError: if there is no room.
    """
    return Classification(
        **{name: sum(values) / len(values) for name, values in _columns(rooms).items()}
    )


def worst(rooms: Mapping[str, Classification]) -> Classification:
    """Return the worst room of each metric separately.

    Raises:
        InputError: if there is no room.
    """
    return Classification(
        **{
            name: max(values) if name in _LESS_IS_BETTER else min(values)
            for name, values in _columns(rooms).items()
        }
    )


def _columns(rooms: Mapping[str, Classification]) -> dict[str, list[float]]:
    if not rooms:
        raise errors.refuse("rooms", "must be at least one", 0, "Evaluate a room first.")
    names = [field.name for field in dataclasses.fields(Classification)]
    return {name: [getattr(room, name) for room in rooms.values()] for name in names}
