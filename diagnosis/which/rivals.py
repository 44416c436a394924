"""Simpler ways to name an effect, which the diagnosis has to do better than."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from diagnosis.which.bench import Table
from diagnosis.which.fit import places
from diagnosis.which.likelihood import Likelihood
from diagnosis.which.signature import Signature

_STEPS = 4  # Strengths tried between two nodes.


def largest_drop(signatures: Sequence[Signature], likelihood: Likelihood) -> str | None:
    """The effect that takes most off any one feature, on the scenes that it is fitted to.

    Args:
        signatures: of all candidates.
        likelihood: of the gap.
    """
    before = _mean_size(likelihood.gap / likelihood.deviation)
    drops = {}
    for one in signatures:
        after = [
            _mean_size((likelihood.gap - one.at(place)) / likelihood.deviation)
            for place in places(one, _STEPS)
        ]
        drops[one.name] = float(np.max(before - np.stack(after)))
    return max(drops, key=lambda name: drops[name], default=None)


def nearest(signatures: Sequence[Signature], likelihood: Likelihood) -> str | None:
    """The effect whose change points most as the gap does, each feature over its deviation.

    Args:
        signatures: of all candidates.
        likelihood: of the gap.
    """
    gap = np.nan_to_num(likelihood.gap / likelihood.deviation)
    likeness = {}
    for one in signatures:
        made = np.nan_to_num(one.change / likelihood.deviation)
        length = np.sqrt((made**2).sum(axis=(1, 2)))
        along = (made * gap).sum(axis=(1, 2))[length > 0] / length[length > 0]
        likeness[one.name] = float(np.max(along, initial=-np.inf))
    return max(likeness, key=lambda name: likeness[name], default=None)


def by_lot(signatures: Sequence[Signature], *, seed: int) -> str | None:
    """Any of the effects.

    Args:
        signatures: of all candidates.
        seed: of the lot.
    """
    if not signatures:
        return None
    return signatures[int(np.random.default_rng(seed).integers(len(signatures)))].name


def _mean_size(off: Table) -> NDArray[np.float64]:
    """Mean over scenes of each feature's size; 0 where it is not known."""
    return np.nan_to_num(np.abs(off)).mean(axis=0)
