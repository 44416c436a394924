"""Scenes under diagnosis as a table of features, simulated with whatever effects are asked for."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from diagnosis.features import reading as features
from diagnosis.reading import Reading
from diagnosis.subject import Subject
from diagnosis.which.candidates import Arm
from patterns.errors import InputError
from sim.effects.effect import Value

Table = NDArray[np.float64]  # (scenes, features); NaN where a feature has too few pixels.

_MADE = 1  # Of the features: another number, and what is kept is made again.


@dataclass(frozen=True, eq=False)
class Bench:
    """Subjects, one arm, and the order of its features."""

    subjects: tuple[Subject, ...]
    arm: Arm
    names: tuple[str, ...]
    ceiling: float  # Largest code.
    cache: Path | None = None  # Folder that keeps what was simulated.
    _kept: dict[tuple[int, str, int], NDArray[np.float64] | None] = field(
        default_factory=dict, repr=False
    )

    def real(self) -> Table:
        """What was captured."""
        return np.stack([self._row(one.real, one) for one in self.subjects])

    def simulated(self, settings: Mapping[str, Value], *, seed: int = 0) -> Table | None:
        """What is simulated with effects set; None where they cannot be, all at once.

        Equal seeds share all noise. Nothing is simulated twice.
        """
        rows = [self._simulated(number, settings, seed) for number in range(len(self.subjects))]
        known = [row for row in rows if row is not None]
        return np.stack(known) if len(known) == len(rows) else None

    def change(self, settings: Mapping[str, Value]) -> Table | None:
        """What effects change, noise being equal."""
        with_effects, base = self.simulated(settings), self.simulated({})
        assert base is not None
        return None if with_effects is None else with_effects - base

    def _simulated(
        self, number: int, settings: Mapping[str, Value], seed: int
    ) -> NDArray[np.float64] | None:
        text = repr(sorted(settings.items()))
        key = (number, text, seed)
        if key not in self._kept:
            kept = self._path(number, text, seed)
            if kept is not None and kept.is_file():
                row = np.load(kept, allow_pickle=False)
                self._kept[key] = row if row.size else None
            else:
                row = self._kept[key] = self._made(number, settings, seed)
                if kept is not None:
                    _save(kept, np.empty(0) if row is None else row)
        return self._kept[key]

    def _made(
        self, number: int, settings: Mapping[str, Value], seed: int
    ) -> NDArray[np.float64] | None:
        subject = self.subjects[number]
        try:
            if self.arm is Arm.DEPTH:
                return self._row(subject.rematch(settings), subject)
            return self._row(subject.simulate(settings, seed=seed), subject)
        except InputError:  # Not every sensor can have every value.
            return None

    def _row(self, reading: Reading, subject: Subject) -> NDArray[np.float64]:
        found = _features(self.arm, reading, subject, self.ceiling)
        return np.array([found.get(name, np.nan) for name in self.names])

    def _path(self, number: int, text: str, seed: int) -> Path | None:
        if self.cache is None:
            return None
        name = hashlib.sha256(f"{text} {seed}".encode()).hexdigest()[:16]
        return self.cache / self._digests[number] / f"{name}.npy"

    @cached_property
    def _digests(self) -> list[str]:
        return [_digest(one, self.arm, self.names) for one in self.subjects]


def bench(subjects: Sequence[Subject], arm: Arm, *, cache: Path | None = None) -> Bench:
    """Find out which features an arm of these subjects has.

    Args:
        subjects: at least one; all of one sensor.
        arm: image or depth.
        cache: folder that keeps what is simulated, for other runs.
    """
    first = subjects[0]
    ceiling = float(2**first.sensor.left.bit_depth - 1)
    reading = first.rematch({}) if arm is Arm.DEPTH else first.simulate({}, seed=0)
    names = tuple(sorted(_features(arm, reading, first, ceiling)))
    return Bench(tuple(subjects), arm, names, ceiling, cache)


def _features(arm: Arm, reading: Reading, subject: Subject, ceiling: float) -> dict[str, float]:
    if arm is Arm.DEPTH:
        return features.of_depth(reading, subject.ground)
    return features.of_image(reading, subject.ground, ceiling=ceiling)


def _digest(subject: Subject, arm: Arm, names: tuple[str, ...]) -> str:
    found = hashlib.sha256(repr((_MADE, names, subject.frames, subject.sensor)).encode())
    for image in (subject.ground.expected, subject.ground.disparity_px):
        found.update(np.ascontiguousarray(image).tobytes())
    if arm is Arm.DEPTH and subject.real.left is not None and subject.real.right is not None:
        found.update(np.ascontiguousarray(subject.real.left).tobytes())
        found.update(np.ascontiguousarray(subject.real.right).tobytes())
    return found.hexdigest()[:16]


def _save(path: Path, row: NDArray[np.float64]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part.npy")
    np.save(part, row, allow_pickle=False)
    part.replace(path)
