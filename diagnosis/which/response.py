"""Response of the features to effects: predicted changes, and signatures over an effect's range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.which.candidates import Candidate
from starling.diagnosis.which.table import FeatureTable, Row
from starling.sim.effects.effect import Value


@dataclass(frozen=True, slots=True, eq=False)
class PredictedChange:
    """Change of the features by effects, with its variance over devices and exposures."""

    change: NDArray[np.float64]  # (..., scenes, features)
    scatter: NDArray[np.float64] | float = 0.0  # Variance, (..., 1, features).

    def __add__(self, second: PredictedChange) -> PredictedChange:
        """Add the changes of two effects that do not interact."""
        return PredictedChange(self.change + second.change, self.scatter + second.scatter)


def stack_changes(changes: Sequence[PredictedChange]) -> PredictedChange:
    """Stack changes along a new first axis.

    Args:
        changes: changes of the same scenes, at least one.
    """
    width = changes[0].change.shape[-1]
    scatter = [np.broadcast_to(item.scatter, (1, width)) for item in changes]
    return PredictedChange(np.stack([item.change for item in changes]), np.stack(scatter))


@dataclass(frozen=True, slots=True, eq=False)
class Signature:
    """Change of the features by one candidate, at several values of its parameter.

    A position is a fractional index into the values: 0 is the first value, 1.5 lies halfway between
    the second and the third. Changes are interpolated linearly.
    """

    candidate: Candidate
    values: tuple[Value, ...]  # Simulated values, the base among them.
    change: NDArray[np.float64]  # (values, scenes, features); zeros at the base.
    # (values, features) standard deviation over devices and exposures; None without a random part.
    scatter: NDArray[np.float64] | None = None
    background: Mapping[str, Value] = field(default_factory=dict)  # Effects that act already.

    @property
    def name(self) -> str:
        """Name of the candidate."""
        return self.candidate.name

    def change_at(self, place: float) -> PredictedChange:
        """Interpolate the change at a position."""
        below = min(int(place), len(self.values) - 2)
        share = place - below
        change = (1 - share) * self.change[below] + share * self.change[below + 1]
        if self.scatter is None:
            return PredictedChange(change)
        return PredictedChange(
            change, ((1 - share) * self.scatter[below] + share * self.scatter[below + 1]) ** 2
        )

    def value(self, place: float) -> Value:
        """Interpolate the parameter at a position; a choice takes the nearest value."""
        if not self.candidate.numeric:
            return self.values[round(place)]
        below = min(int(place), len(self.values) - 2)
        share = place - below
        low, high = float(self.values[below]), float(self.values[below + 1])
        value = (1 - share) * low + share * high
        return float(round(value) if self.candidate.whole else value)


def simulate_signature(
    candidate: Candidate,
    table: FeatureTable,
    nodes: Sequence[Value],
    *,
    background: Mapping[str, Value] | None = None,
) -> Signature | None:
    """Simulate a candidate at some of its nodes; None if none of them can be simulated.

    Args:
        candidate: candidate of the table's segment.
        table: feature table.
        nodes: values to simulate, in the candidate's order.
        background: effects that act already; their own change is subtracted.
    """
    background = background or {}
    for node in nodes:
        table.prefetch({**background, candidate.name: node})
    already = table.change(background)
    if already is None:
        return None
    simulated = [(node, table.change({**background, candidate.name: node})) for node in nodes]
    known = [(node, change - already) for node, change in simulated if change is not None]
    if not known:
        return None
    values = [node for node, _ in known]
    changes = [change for _, change in known]
    scatter = [table.scatter({candidate.name: node}) for node in values]
    place = 0
    if candidate.numeric:
        place = int(np.searchsorted(np.array(values, float), float(candidate.base)))
    values.insert(place, candidate.base)
    changes.insert(place, np.zeros_like(changes[0]))
    scatter_rows = _with_base_row(scatter, place)
    return Signature(candidate, tuple(values), np.stack(changes), scatter_rows, background)


def _with_base_row(scatter: Sequence[Row | None], place: int) -> NDArray[np.float64] | None:
    """Stack the scatter of the values, with zeros at the base."""
    rows = [row for row in scatter if row is not None]
    return np.insert(np.stack(rows), place, 0.0, axis=0) if rows else None


def add_node(signature: Signature, value: Value, table: FeatureTable) -> Signature:
    """Simulate one more value; the signature is unchanged if that is not possible.

    Args:
        signature: signature of a numeric candidate.
        value: value to add.
        table: feature table.
    """
    nodes = [node for node in signature.values if node != signature.candidate.base]
    extended = simulate_signature(
        signature.candidate,
        table,
        sorted([*nodes, value], key=float),
        background=signature.background,
    )
    return extended or signature
