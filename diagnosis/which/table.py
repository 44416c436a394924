"""Scenes under diagnosis as a table of features, simulated with whatever effects are asked for."""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.scene_model import Subject
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.rows import (
    Columns,
    Row,
    another_row,
    base_features,
    exposed_row,
    finer_row,
    in_order,
    other_row,
    otherwise_row,
    row_of,
    simulated_row,
)
from starling.diagnosis.workers import Crew
from starling.patterns.errors import refuse
from starling.sim.console import record
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Effect, Value
from starling.sim.statistics import mean_known

Table = NDArray[np.float64]  # (scenes, features); NaN where a feature has too few pixels.
Make = Callable[..., Row | None]  # Of a subject, columns and more.

_BASE = "[]"  # What rows without effects are kept as.
_OTHERS = (1, 2, 3)  # Devices, and seeds, in which effects are drawn anew,
_RENDERED = (1,)  # or where each of them has to be rendered, which takes most of the time.
# What rows follow from: where any of it is another, they are made again.
_HOUSE = Path(__file__).parents[2]
_SOURCES = tuple(
    _HOUSE / name
    for name in (
        "calibration",
        "patterns",
        "sim",
        "diagnosis/features",
        "diagnosis/scenes/estimated.py",
        "diagnosis/scenes/strata.py",
        "diagnosis/transfer/transfer.py",
        "diagnosis/transfer/tone_curve.py",
        "diagnosis/scenes/stability.py",
        "diagnosis/scenes/fit_scene.py",
        "diagnosis/scenes/pose.py",
        "diagnosis/scenes/projector_frame.py",
        "diagnosis/scenes/observation.py",
        "diagnosis/scenes/scene_model.py",
        "diagnosis/which/table.py",
        "diagnosis/which/rows.py",
        "diagnosis/transfer/dequantise.py",
    )
)

_Key = tuple[int, str, int]  # Number of a scene, what is simulated, and the noise's seed.
_Asked = tuple[str, int, Make, dict[str, Value]]  # What, the seed, by what, and with which effects.


@dataclass(frozen=True, eq=False)
class Bench:
    """Subjects, and the features that one arm has of them."""

    subjects: tuple[Subject, ...]
    columns: Columns
    cache: Path | None = None  # Folder that keeps what was simulated.
    crew: Crew | None = None  # Who simulates; None: this process.
    _kept: dict[_Key, Row | None] = field(default_factory=dict, repr=False)
    _begun: dict[_Key, Future[Row | None]] = field(default_factory=dict, repr=False)

    @property
    def arm(self) -> Arm:
        """Half of the stage swap."""
        return self.columns.arm

    @property
    def names(self) -> tuple[str, ...]:
        """Of the features."""
        return self.columns.names

    def of(self, subjects: Sequence[Subject]) -> Bench:
        """The same scenes, captured otherwise, repeats being as many; in the arm of matcher and
        filters nothing of what was simulated would hold for them.
        """
        assert self.arm is not Arm.DEPTH
        return dataclasses.replace(self, subjects=tuple(subjects))

    def real(self) -> Table:
        """What was captured."""
        return np.stack([row_of(one.real, one, self.columns) for one in self.subjects])

    def against(self) -> Table | None:
        """What the captures are compared with; None where that is simulated.

        In the arm of matcher and filters it is what our matcher makes of the captured images and
        what the other device differs from our matcher by.
        """
        others = [
            other_row(one.against, one, self.columns)
            for one in self.subjects
            if one.against is not None
        ]
        if not others:
            return None
        if self.arm is not Arm.DEPTH:
            return np.stack(others)
        again = self.simulated({})
        assert again is not None
        return again + np.stack(others)

    def simulated(self, settings: Mapping[str, Value], *, seed: int = 0) -> Table | None:
        """What is simulated with effects set; None where they cannot be, all at once.

        Equal seeds share all noise. Nothing is simulated twice.
        """
        return self._rows(*_simulation(settings, seed))

    def another(self, settings: Mapping[str, Value], *, number: int) -> Table | None:
        """What is simulated of another device of the kind, with noise of its own.

        Args:
            settings: as `simulated`.
            number: of the device, from 1, and of the noise's seed.
        """
        return self._rows(*_another(settings, number))

    def begin(self, settings: Mapping[str, Value]) -> None:
        """Have the crew begin what `change` asks of these effects; one process alone waits."""
        if self.crew is None:
            return
        asked = [_simulation(settings, 0)]
        for number in self._devices(settings):
            asked += [_another(settings, number), _another({}, number)]
        for text, seed, make, effects in asked:
            for key in self._missing(text, seed):
                if key not in self._begun:
                    self._begun[key] = self._submitted(self.crew, key, make, effects)

    def finer(self, *, seed: int) -> Table:
        """What a device's own depth differs by from the depth of its images matched again, as its
        matcher reads bits that its images are put out without.
        """
        rows = self._rows("finer", seed, finer_row, {})
        assert rows is not None
        return rows

    def otherwise(self) -> list[Table]:
        """What each further estimate of the scenes changes, noise being equal; none of scenes that
        are known.
        """
        base = self.simulated({})
        assert base is not None
        found = []
        for number in range(max(len(one.estimates) for one in self.subjects)):
            rows = self._rows("otherwise", number, otherwise_row)
            assert rows is not None
            found.append(rows - base)
        return found

    def exposed(self, *, seed: int) -> Table:
        """What the captures are compared with, with the noise of one more exposure."""
        rows = self._rows("exposed", seed, exposed_row)
        assert rows is not None
        return rows

    def _rows(self, text: str, seed: int, make: Make, *arguments: Any) -> Table | None:
        missing = self._missing(text, seed)
        for key, row in zip(missing, self._made(missing, make, *arguments), strict=True):
            self._kept[key] = row
            kept = self._path(*key)
            if kept is not None:
                _save(kept, np.empty(0) if row is None else row)
        rows = [self._kept[number, text, seed] for number in range(len(self.subjects))]
        known = [row for row in rows if row is not None]
        return np.stack(known) if len(known) == len(rows) else None

    def _missing(self, text: str, seed: int) -> list[_Key]:
        """What is neither known nor kept of what all scenes are asked."""
        keys = [(number, text, seed) for number in range(len(self.subjects))]
        unknown = [key for key in keys if key not in self._kept]
        for key in unknown:
            kept = self._path(*key)
            if kept is not None and kept.is_file():
                row = np.load(kept, allow_pickle=False)
                self._kept[key] = row if row.size else None
        return [key for key in unknown if key not in self._kept]

    def change(self, settings: Mapping[str, Value]) -> Table | None:
        """What effects change, noise being equal; of what is drawn by lot, the mean of some.

        Of a feature that they make unknown they change nothing: what is not known is not explained.
        """
        drawn = self._drawn(settings)
        return None if drawn is None else np.nan_to_num(mean_known(drawn, axis=0))

    def scatter(self, settings: Mapping[str, Value]) -> Row | None:
        """Deviation (features,) of what one more draw changes from `change`, all scenes alike; None
        where nothing is drawn.
        """
        drawn = self._drawn(settings)
        if drawn is None or len(drawn) < 2:
            return None
        draws = len(drawn)
        square = mean_known((drawn - mean_known(drawn, axis=0)) ** 2, axis=(0, 1))
        return np.sqrt(np.nan_to_num(square) * (draws + 1) / (draws - 1))

    def _drawn(self, settings: Mapping[str, Value]) -> NDArray[np.float64] | None:
        """What effects change in each of some devices and exposures (draws, scenes, features)."""
        with_effects, base = self.simulated(settings), self.simulated({})
        assert base is not None
        if with_effects is None:
            return None
        found = [with_effects - base]
        for number in self._devices(settings):
            other, base = self.another(settings, number=number), self.another({}, number=number)
            assert other is not None and base is not None  # As the first could be simulated.
            found.append(other - base)
        return np.stack(found)

    def _devices(self, settings: Mapping[str, Value]) -> tuple[int, ...]:
        """Which other devices tell how much what effects change varies from one to the next."""
        return () if self.arm is Arm.DEPTH else _others(settings)

    def _made(self, keys: Sequence[_Key], make: Make, *arguments: Any) -> Iterator[Row | None]:
        if self.crew is None:
            for number, _, seed in keys:
                yield make(self.subjects[number], self.columns, *arguments, seed)
        else:
            futures = [
                self._begun.pop(key, None) or self._submitted(self.crew, key, make, *arguments)
                for key in keys
            ]
            yield from (future.result() for future in futures)

    def _submitted(self, crew: Crew, key: _Key, make: Make, *arguments: Any) -> Future[Row | None]:
        number, _, seed = key
        name = self.subjects[number].name
        return crew.submit(name, make, self.columns, *arguments, seed)

    def _path(self, number: int, text: str, seed: int) -> Path | None:
        if self.cache is None:
            return None
        name = hashlib.sha256(f"{text} {seed}".encode()).hexdigest()[:16]
        return self.cache / self._digests[number] / f"{name}.npy"

    @cached_property
    def _digests(self) -> list[str]:
        return [
            _digest(one, self.columns, self._base(number))
            for number, one in enumerate(self.subjects)
        ]

    def _base(self, number: int) -> Row:
        """A scene's base, simulated anew in each run, as all that is kept departs from it."""
        key = (number, _BASE, 0)
        if key not in self._kept:
            (self._kept[key],) = self._made([key], simulated_row, {})
        row = self._kept[key]
        assert row is not None
        return row


def _simulation(settings: Mapping[str, Value], seed: int) -> _Asked:
    """Of the captured device."""
    asked = dict(sorted(settings.items()))
    return repr(list(asked.items())), seed, simulated_row, asked


def _another(settings: Mapping[str, Value], number: int) -> _Asked:
    """Of another device, whose number is the seed of its noise."""
    asked = dict(sorted(settings.items()))
    return f"another {list(asked.items())!r}", number, another_row, asked


def _others(settings: Mapping[str, Value]) -> tuple[int, ...]:
    """In which other devices, and with which seeds, effects are drawn anew."""
    drawn = [effect for effect in map(_effect, settings) if effect.drawn]
    if not drawn:
        return ()
    return _RENDERED if any(effect.rerender for effect in drawn) else _OTHERS


def _effect(name: str) -> Effect:
    return setting.parameter_of(name)[0]


def bench(
    subjects: Sequence[Subject], arm: Arm, *, cache: Path | None = None, crew: Crew | None = None
) -> Bench:
    """Find out which features an arm of these subjects has.

    Args:
        subjects: at least one; all of one sensor.
        arm: that is asked about.
        cache: folder that keeps what is simulated, for other runs.
        crew: who simulates; None: this process.
    """
    if cache is not None:
        _make(cache)
    ceiling = float(2 ** subjects[0].sensor.left.bit_depth - 1)
    if crew is None:
        told = [base_features(one, arm, ceiling) for one in subjects]
    else:
        futures = [crew.submit(one.name, base_features, arm, ceiling) for one in subjects]
        told = [future.result() for future in futures]
    columns = Columns(arm=arm, names=tuple(sorted(set().union(*told))), ceiling=ceiling)
    base = {(number, _BASE, 0): in_order(found, columns) for number, found in enumerate(told)}
    return Bench(tuple(subjects), columns, cache, crew, {**base})


def _digest(subject: Subject, columns: Columns, base: Row) -> str:
    """Name of all that rows of a scene follow from; by the base's row also what else has a part."""
    what = (
        record.code(*_SOURCES),
        record.versions(),
        columns,
        subject.name,
        subject.frames,
        subject.sensor,
        record.content(subject.scene),
    )
    found = hashlib.sha256(repr(what).encode())
    for image in (subject.ground.expected, subject.ground.disparity_px, base):
        found.update(np.ascontiguousarray(image).tobytes())
    pairs = [subject.real] if columns.arm is Arm.DEPTH else []
    pairs += [] if subject.against is None else [subject.against]
    for pair in pairs:
        for maps in (pair.left, pair.right, pair.device_px):
            if maps is not None:
                found.update(np.ascontiguousarray(maps).tobytes())
    return found.hexdigest()[:16]


def _make(cache: Path) -> None:
    try:
        cache.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refuse("cache", "must be a folder", cache, f"{error.strerror}.") from error


def _save(path: Path, row: Row) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}.npy")  # Two may keep the same at once.
    np.save(part, row, allow_pickle=False)
    part.replace(path)
