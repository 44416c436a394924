"""What an effect does to the features of every scene: at each of its nodes, less the base's."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from diagnosis.candidates import Arm, Candidate
from diagnosis.features import reading as features
from diagnosis.reading import Reading
from diagnosis.subject import Subject
from patterns.errors import InputError
from sim.effects.effect import Value

Table = NDArray[np.float64]  # (scenes, features); NaN where a feature has too few pixels.


@dataclass(frozen=True, slots=True, eq=False)
class Signature:
    """One candidate's."""

    candidate: Candidate
    values: tuple[Value, ...]  # Nodes that could be simulated, the base among them.
    change: NDArray[np.float64]  # (values, scenes, features), zeros at the base.

    def at(self, place: float) -> Table:
        """Change at a place between the values: 0 is the first, 1.5 halfway to the third."""
        below = min(int(place), len(self.values) - 2)
        share = place - below
        return (1 - share) * self.change[below] + share * self.change[below + 1]

    def value(self, place: float) -> Value:
        """Parameter at a place; of words the nearest."""
        if not self.candidate.numeric:
            return self.values[round(place)]
        below = min(int(place), len(self.values) - 2)
        share = place - below
        low, high = float(self.values[below]), float(self.values[below + 1])
        return (1 - share) * low + share * high


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """Subjects, one arm, and the order of its features."""

    subjects: tuple[Subject, ...]
    arm: Arm
    names: tuple[str, ...]
    ceiling: float

    def table(self, readings: Sequence[Reading]) -> Table:
        """Features of a reading of every subject."""
        rows = [
            _features(self.arm, reading, subject, self.ceiling)
            for reading, subject in zip(readings, self.subjects, strict=True)
        ]
        return np.array([[row.get(name, np.nan) for name in self.names] for row in rows])

    def real(self) -> Table:
        """What was captured."""
        return self.table([subject.real for subject in self.subjects])

    def simulated(self, settings: Mapping[str, Value], *, seed: int = 0) -> Table:
        """What is simulated with effects set."""
        if self.arm is Arm.DEPTH:
            return self.table([subject.rematch(settings) for subject in self.subjects])
        return self.table([subject.simulate(settings, seed=seed) for subject in self.subjects])


def bench(subjects: Sequence[Subject], arm: Arm) -> Bench:
    """Find out which features an arm of these subjects has."""
    first = subjects[0]
    ceiling = float(2**first.sensor.left.bit_depth - 1)
    reading = first.rematch({}) if arm is Arm.DEPTH else first.simulate({}, seed=0)
    names = tuple(sorted(_features(arm, reading, first, ceiling)))
    return Bench(tuple(subjects), arm, names, ceiling)


def _features(arm: Arm, reading: Reading, subject: Subject, ceiling: float) -> dict[str, float]:
    if arm is Arm.DEPTH:
        return features.of_depth(reading, subject.ground)
    return features.of_image(reading, subject.ground, ceiling=ceiling)


def signature(
    candidate: Candidate, bench: Bench, base: Table, *, cache: Path | None = None
) -> Signature | None:
    """Simulate a candidate's nodes with the base's noise; None where none can be simulated.

    Args:
        candidate: of the bench's arm.
        bench: the subjects.
        base: features of the base, seed 0.
        cache: folder that keeps it.
    """
    kept = cache / f"{candidate.name}-{_digest(candidate, bench)}.npz" if cache else None
    if kept is not None and kept.is_file():
        with np.load(kept, allow_pickle=False) as archive:
            used, change = archive["used"], archive["change"]
        values = [candidate.nodes[number] for number in used]
    else:
        used, values, changes = [], [], []
        for number, node in enumerate(candidate.nodes):
            try:
                changes.append(bench.simulated({candidate.name: node}) - base)
            except InputError:  # Not every sensor can have every value.
                continue
            used.append(number)
            values.append(node)
        change = np.array(changes)
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            np.savez_compressed(kept, used=np.array(used, np.int64), change=change)
    if not values:
        return None
    return _with_base(candidate, values, change)


def _with_base(
    candidate: Candidate, values: Sequence[Value], change: NDArray[np.float64]
) -> Signature:
    nothing = np.zeros((1, *change.shape[1:]))
    place = len(values)
    if candidate.numeric:
        place = int(np.searchsorted(np.array(values, float), float(candidate.base)))
    else:
        place = 0
    return Signature(
        candidate,
        (*values[:place], candidate.base, *values[place:]),
        np.concatenate([change[:place], nothing, change[place:]]),
    )


def _digest(candidate: Candidate, bench: Bench) -> str:
    found = hashlib.sha256(repr((candidate.nodes, bench.names)).encode())
    for subject in bench.subjects:
        found.update(repr((subject.name, subject.sensor)).encode())
        found.update(np.ascontiguousarray(subject.ground.expected).tobytes())
        if bench.arm is Arm.DEPTH and subject.real.left is not None:
            found.update(np.ascontiguousarray(subject.real.left).tobytes())
    return found.hexdigest()[:16]
