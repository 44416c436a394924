"""Simpler methods of attribution that the diagnosis must outperform."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.which.fit import places
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.table import Rows

_STEPS = 4  # Positions tried between two nodes.

SegmentGap = tuple[Sequence[Signature], Likelihood]  # All candidates of a segment, and its gap.


def largest_drop(segments: Sequence[SegmentGap]) -> str | None:
    """Name the effect that most reduces any single feature, on the scenes it is fitted to."""
    drops = {}
    for signatures, likelihood in segments:
        before = _mean_size(likelihood.residual(likelihood.no_change))
        for signature in signatures:
            after = [
                _mean_size(likelihood.residual(signature.change_at(place)))
                for place in places(signature, _STEPS)
            ]
            drops[signature.name] = float(np.max(before - np.stack(after)))
    return max(drops, key=lambda name: drops[name], default=None)


def nearest_direction(segments: Sequence[SegmentGap]) -> str | None:
    """Name the effect whose change has the largest projection of the gap on its direction."""
    projections = {}
    for signatures, likelihood in segments:
        gap = np.nan_to_num(likelihood.residual(likelihood.no_change))
        for signature in signatures:
            change = signature.change / likelihood.deviation
            length = np.sqrt((change**2).sum(axis=(1, 2)))
            along = (change * gap).sum(axis=(1, 2))[length > 0] / length[length > 0]
            projections[signature.name] = float(np.max(along, initial=-np.inf))
    return max(projections, key=lambda name: projections[name], default=None)


def random_choice(segments: Sequence[SegmentGap], *, seed: int) -> str | None:
    """Name one of the effects at random.

    Args:
        segments: candidates of each segment.
        seed: seed of the choice.
    """
    names = [signature.name for signatures, _ in segments for signature in signatures]
    return names[int(np.random.default_rng(seed).integers(len(names)))] if names else None


def _mean_size(residual: Rows) -> NDArray[np.float64]:
    """Average the absolute residual of each feature over scenes; 0 where unknown."""
    return np.nan_to_num(np.abs(residual)).mean(axis=0)
