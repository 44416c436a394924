"""What an effect does to the features of every scene, at each of some strengths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.which.candidates import Candidate
from starling.diagnosis.which.predicted import Made
from starling.diagnosis.which.rows import Row
from starling.diagnosis.which.table import Bench
from starling.sim.effects.effect import Value


@dataclass(frozen=True, slots=True, eq=False)
class Signature:
    """One candidate's."""

    candidate: Candidate
    values: tuple[Value, ...]  # Nodes that could be simulated, the base among them.
    change: NDArray[np.float64]  # (values, scenes, features), zeros at the base.
    # (values, features) deviation of that from device to device and exposure to exposure; None of
    # what is the same in all.
    scatter: NDArray[np.float64] | None = None
    given: Mapping[str, Value] = field(default_factory=dict)  # Effects that act already.

    @property
    def name(self) -> str:
        """The candidate's."""
        return self.candidate.name

    def at(self, place: float) -> Made:
        """What it makes at a place between the values: 0 is the first, 1.5 halfway to the third."""
        below = min(int(place), len(self.values) - 2)
        share = place - below
        change = (1 - share) * self.change[below] + share * self.change[below + 1]
        if self.scatter is None:
            return Made(change)
        return Made(
            change, ((1 - share) * self.scatter[below] + share * self.scatter[below + 1]) ** 2
        )

    def value(self, place: float) -> Value:
        """Parameter at a place; of words the nearest."""
        if not self.candidate.numeric:
            return self.values[round(place)]
        below = min(int(place), len(self.values) - 2)
        share = place - below
        low, high = float(self.values[below]), float(self.values[below + 1])
        value = (1 - share) * low + share * high
        return float(round(value) if self.candidate.whole else value)


def signature(
    candidate: Candidate,
    bench: Bench,
    nodes: Sequence[Value],
    *,
    given: Mapping[str, Value] | None = None,
) -> Signature | None:
    """Simulate some of a candidate's nodes with the base's noise; None where none can be.

    Args:
        candidate: of the bench's arm.
        bench: the subjects.
        nodes: those of the candidate's that are simulated, in their order.
        given: effects that act already, of whose doing nothing counts.
    """
    given = given or {}
    for node in nodes:
        bench.begin({**given, candidate.name: node})
    already = bench.change(given)
    if already is None:
        return None
    made = [(node, bench.change({**given, candidate.name: node})) for node in nodes]
    known = [(node, change - already) for node, change in made if change is not None]
    if not known:
        return None
    values = [node for node, _ in known]
    changes = [change for _, change in known]
    scatter = [bench.scatter({candidate.name: node}) for node in values]
    place = 0
    if candidate.numeric:
        place = int(np.searchsorted(np.array(values, float), float(candidate.base)))
    values.insert(place, candidate.base)
    changes.insert(place, np.zeros_like(changes[0]))
    return Signature(candidate, tuple(values), np.stack(changes), _stacked(scatter, place), given)


def _stacked(scatter: Sequence[Row | None], place: int) -> NDArray[np.float64] | None:
    """One above the other, with zeros at the base's place."""
    told = [one for one in scatter if one is not None]
    return np.insert(np.stack(told), place, 0.0, axis=0) if told else None


def with_node(of: Signature, value: Value, bench: Bench) -> Signature:
    """The same with one more strength simulated; as it was where that cannot be.

    Args:
        of: with numbers for strengths.
        value: of the candidate.
        bench: the subjects.
    """
    nodes = [node for node in of.values if node != of.candidate.base]
    return signature(of.candidate, bench, sorted([*nodes, value], key=float), given=of.given) or of
