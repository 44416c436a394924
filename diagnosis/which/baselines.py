"""Simpler ways to name an effect, which the diagnosis has to do better than."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.which.fit import places
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.table import Table

_STEPS = 4  # Strengths tried between two nodes.

Arm = tuple[Sequence[Signature], Likelihood]  # All candidates of one half, and the gap there.


def largest_drop(arms: Sequence[Arm]) -> str | None:
    """The effect that takes most off any one feature, on the scenes that it is fitted to."""
    drops = {}
    for signatures, likelihood in arms:
        before = _mean_size(likelihood.left(likelihood.nothing))
        for one in signatures:
            after = [_mean_size(likelihood.left(one.at(place))) for place in places(one, _STEPS)]
            drops[one.name] = float(np.max(before - np.stack(after)))
    return max(drops, key=lambda name: drops[name], default=None)


def nearest(arms: Sequence[Arm]) -> str | None:
    """The effect whose change points most as the gap does, each feature over its deviation."""
    likeness = {}
    for signatures, likelihood in arms:
        gap = np.nan_to_num(likelihood.left(likelihood.nothing))
        for one in signatures:
            made = one.change / likelihood.deviation
            length = np.sqrt((made**2).sum(axis=(1, 2)))
            along = (made * gap).sum(axis=(1, 2))[length > 0] / length[length > 0]
            likeness[one.name] = float(np.max(along, initial=-np.inf))
    return max(likeness, key=lambda name: likeness[name], default=None)


def by_lot(arms: Sequence[Arm], *, seed: int) -> str | None:
    """Any of the effects.

    Args:
        arms: whose effects.
        seed: of the lot.
    """
    names = [one.name for signatures, _ in arms for one in signatures]
    return names[int(np.random.default_rng(seed).integers(len(names)))] if names else None


def _mean_size(off: Table) -> NDArray[np.float64]:
    """Mean over scenes of each feature's size; 0 where it is not known."""
    return np.nan_to_num(np.abs(off)).mean(axis=0)
