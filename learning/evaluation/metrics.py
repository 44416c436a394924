"""Metrics of predicted probabilities: ranking, calibration, proper scores, by room.

Sources of the proper scores: Brier, Verification of forecasts expressed in terms of probability,
Monthly Weather Review 78, 1950; Gneiting and Raftery, Strictly proper scoring rules, JASA 102,
2007. Their expectation is best for the true probabilities.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.patterns.errors import refuse


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Pixels with known outcome, counted by their predicted probability."""

    probability: NDArray[np.float64]  # (k,) that a pixel has no depth, 0 to 1, ascending.
    holes: NDArray[np.int64]  # (k,) pixels of this probability without depth.
    pixels: NDArray[np.int64]  # (k,) pixels of this probability, > 0.

    @property
    def share(self) -> float:
        """Share of the pixels that have no depth, 0 to 1."""
        return float(self.holes.sum() / self.pixels.sum())


def judge(
    probability: NDArray[np.floating],
    ndp: NDArray[np.bool_],
    counted: NDArray[np.bool_] | None = None,
) -> Judged:
    """Select the counted pixels.

    Args:
        probability: any shape, 0 to 1 where counted.
        ndp: same shape, True where the device has no depth.
        counted: same shape, where the outcome counts; None = everywhere.

    Raises:
        InputError: if the shapes differ, no pixel counts, or a counted probability is outside
            [0, 1] or NaN.
    """
    where = np.ones(ndp.shape, bool) if counted is None else counted
    if not probability.shape == ndp.shape == where.shape:
        raise refuse(
            "probability, ndp and counted",
            "must share one shape",
            f"{probability.shape}, {ndp.shape} and {where.shape}",
            "Give three images of one view.",
        )
    if not where.any():
        raise refuse("counted", "must hold a pixel", 0, "Use a scene with known reference depth.")
    selected = probability[where].astype(np.float64)
    outside = ~((selected >= 0) & (selected <= 1))
    if outside.any():
        raise refuse(
            "probability",
            "must be in [0, 1] at every counted pixel",
            f"{selected[outside][0]:g} and {np.count_nonzero(outside) - 1} more",
            "Give a probability, not a logit.",
        )
    distinct, place, pixels = np.unique(selected, return_inverse=True, return_counts=True)
    holes = np.bincount(place[ndp[where]], minlength=distinct.size)
    return Judged(distinct, holes.astype(np.int64), pixels.astype(np.int64))


_CODES = 65535  # A probability is stored in 16 bits.


def probability_code(probability: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Round probabilities to 16 bits, so that their number of distinct values is bounded."""
    return np.round(probability * _CODES).astype(np.uint16)


def probability_of_code(code: NDArray[np.unsignedinteger]) -> NDArray[np.float32]:
    """Invert `probability_code`."""
    return code.astype(np.float32) / np.float32(_CODES)


def pool(scenes: Iterable[Judged]) -> Judged:
    """Pool the pixels of several scenes.

    Raises:
        InputError: if there is none.
    """
    pooled: Judged | None = None
    for judged in scenes:
        pooled = judged if pooled is None else _merged(pooled, judged)
    if pooled is None:
        raise refuse("judged scenes", "must be at least one", 0, "Give a scene.")
    return pooled


def _merged(first: Judged, second: Judged) -> Judged:
    both = np.concatenate([first.probability, second.probability])
    distinct, place = np.unique(both, return_inverse=True)
    counts = np.zeros((2, distinct.size), np.int64)
    np.add.at(counts[0], place, np.concatenate([first.holes, second.holes]))
    np.add.at(counts[1], place, np.concatenate([first.pixels, second.pixels]))
    return Judged(distinct, *counts)


@dataclass(frozen=True, slots=True, eq=False)
class Roc:
    """Corners of the curve, from (0, 0) to (1, 1), connected by straight lines."""

    false_positive_rate: NDArray[np.float64]  # (k,) ascending.
    true_positive_rate: NDArray[np.float64]  # (k,) ascending.
    threshold: NDArray[np.float64]  # (k,) descending; pixels at or above it are positive.

    @property
    def area(self) -> float:
        """Area under the curve (AUC), 0.5 by chance, ties counted half."""
        return float(np.trapezoid(self.true_positive_rate, self.false_positive_rate))

    def true_positive_rate_at(self, false_positive_rate: float) -> float:
        """True-positive rate at a false-positive rate, both 0 to 1; the highest one if not unique.

        Values between two corners are the expectation of a random choice among tied pixels.

        Raises:
            InputError: if the rate is outside [0, 1].
        """
        errors.in_interval("false_positive_rate", false_positive_rate, 0.0, 1.0)
        across, up = self.false_positive_rate, self.true_positive_rate
        # np.interp would use the lower end of vertical segments.
        last = int(np.searchsorted(across, false_positive_rate, side="right")) - 1
        if last == len(across) - 1:
            return float(up[last])
        part = (false_positive_rate - across[last]) / (across[last + 1] - across[last])
        return float(up[last] + part * (up[last + 1] - up[last]))


def roc(judged: Judged) -> Roc:
    """Compute the curve, with one corner for each distinct probability.

    Source: Fawcett, An introduction to ROC analysis, Pattern Recognition Letters 27, 2006.

    Raises:
        InputError: if all or none of the pixels have depth.
    """
    positives = int(judged.holes.sum())
    negatives = int(judged.pixels.sum()) - positives
    if not positives or not negatives:
        raise errors.refuse(
            "no-depth pixels",
            "must be some and not all of the counted ones",
            f"{positives} of {positives + negatives}",
            "A curve needs both kinds; use more scenes.",
        )
    true_positives = np.cumsum(judged.holes[::-1])
    false_positives = np.cumsum((judged.pixels - judged.holes)[::-1])
    return Roc(
        false_positive_rate=np.append(0.0, false_positives / negatives),
        true_positive_rate=np.append(0.0, true_positives / positives),
        threshold=np.append(np.inf, judged.probability[::-1]),
    )


BINS = 15


@dataclass(frozen=True, slots=True, eq=False)
class Reliability:
    """Predicted and observed shares in bins of equally many pixels, by ascending probability."""

    predicted: NDArray[np.float64]  # (bins,) mean probability.
    observed: NDArray[np.float64]  # (bins,) share without depth.
    pixels: NDArray[np.int64]  # (bins,)

    @property
    def expected_calibration_error(self) -> float:
        """Mean absolute difference of predicted and observed (ECE), weighted by pixels."""
        gap = np.abs(self.predicted - self.observed)
        return float(np.average(gap, weights=self.pixels))


def reliability(judged: Judged, bins: int = BINS) -> Reliability:
    """Sort pixels into bins of equal count. Pixels of one probability stay in one bin.

    The curve thus does not depend on the order of pixels, and there are fewer bins where many
    pixels share a probability. Bins of equal width would hold almost all pixels of a depth image in
    one bin, because most probabilities are nearly 0.

    Source: Nguyen and O'Connor, Posterior calibration and exploratory analysis for natural language
    processing models, EMNLP 2015, sec. 3.

    Raises:
        InputError: if `bins` is not in [1, 10000].
    """
    errors.in_interval("bins", bins, 1, 10_000)
    below = np.cumsum(judged.pixels)  # Pixels of at most this probability.
    wanted = np.arange(1, bins + 1) * below[-1] // bins
    last = np.unique(np.searchsorted(below, wanted[wanted > 0]))  # Last probability of each bin.
    starts = np.append(0, last[:-1] + 1)
    pixels = np.add.reduceat(judged.pixels, starts)
    return Reliability(
        predicted=np.add.reduceat(judged.probability * judged.pixels, starts) / pixels,
        observed=np.add.reduceat(judged.holes, starts) / pixels,
        pixels=pixels,
    )


_SUREST = 1e-6  # A wrong probability of 0 would have an infinite log loss.


def brier(judged: Judged) -> float:
    """Mean squared difference of probability and outcome; 0 is best."""
    wrong = judged.holes * (1 - judged.probability) ** 2
    wrong += (judged.pixels - judged.holes) * judged.probability**2
    return float(wrong.sum() / judged.pixels.sum())


def brier_skill(judged: Judged) -> float:
    """1 - Brier score over that of always predicting these pixels' own share; 1 is best.

    0 is no better than the share alone, which no method knows. NaN if all or none of the pixels
    have depth.
    """
    uncertainty = judged.share * (1 - judged.share)
    return 1 - brier(judged) / uncertainty if uncertainty else float("nan")


def log_loss(judged: Judged) -> float:
    """Mean negative logarithm of the probability of the outcome [nat]; 0 is best.

    Probabilities are clipped to [1e-6, 1 - 1e-6].
    """
    probability = np.clip(judged.probability, _SUREST, 1 - _SUREST)
    logarithm = judged.holes * np.log(probability)
    logarithm += (judged.pixels - judged.holes) * np.log(1 - probability)
    return float(-logarithm.sum() / judged.pixels.sum())


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
        brier=brier(judged),
        brier_skill=brier_skill(judged),
        log_loss=log_loss(judged),
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
        with errors.naming(f"room {room}"):
            figures[room] = classification(pool(rooms[room]))
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
