"""Feature table: features of all scenes in one pipeline segment, captured or simulated."""

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

from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.rows import (
    Columns,
    Row,
    against_row,
    base_features,
    device_row,
    estimate_row,
    extra_bits_row,
    in_order,
    observation_row,
    reexposed_row,
    simulated_row,
)
from starling.diagnosis.workers import WorkerPool
from starling.patterns.errors import refuse
from starling.sim.arrays import mean_known
from starling.sim.console import record
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Effect, Value

Rows = NDArray[np.float64]  # (scenes, features); NaN where a feature has too few pixels.
RowFunction = Callable[..., Row | None]  # Takes a scene model, columns and further arguments.

_BASE = "[]"  # Cache key of rows without effects.
_DEVICES = (1, 2, 3)  # Devices, and noise seeds, over which random effects are averaged.
_RENDERED_DEVICES = (1,)  # The same for effects that need rendering, which takes most of the time.
# Cached rows depend on these sources; a change of any of them invalidates the cache.
_ROOT = Path(__file__).parents[2]
_SOURCES = tuple(
    _ROOT / name
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

_Key = tuple[int, str, int]  # Index of the scene, what is simulated, seed of the noise.
_Job = tuple[str, int, RowFunction, dict[str, Value]]  # Cache text, seed, function, settings.


@dataclass(frozen=True, eq=False)
class FeatureTable:
    """Scene models, and the features that one segment has of them."""

    scene_models: tuple[SceneModel, ...]
    columns: Columns
    cache: Path | None = None  # Folder that keeps simulated rows; None: no cache on disk.
    pool: WorkerPool | None = None  # Workers that simulate; None: this process.
    _rows: dict[_Key, Row | None] = field(default_factory=dict, repr=False)
    _pending: dict[_Key, Future[Row | None]] = field(default_factory=dict, repr=False)

    @property
    def segment(self) -> Segment:
        """Segment of the pipeline."""
        return self.columns.segment

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the features."""
        return self.columns.names

    def with_captures(self, scene_models: Sequence[SceneModel]) -> FeatureTable:
        """Replace the captures of the scenes, and keep simulated rows.

        The number of repeats must be equal. In the depth segment simulated rows depend on the
        captures, so there this is not possible.
        """
        assert self.segment is not Segment.DEPTH
        return dataclasses.replace(self, scene_models=tuple(scene_models))

    def real(self) -> Rows:
        """Compute the features of the captured observations."""
        rows = [observation_row(scene.real, scene, self.columns) for scene in self.scene_models]
        return np.stack(rows)

    def against(self) -> Rows | None:
        """Compute the features of the captured reference; None if the reference is simulated.

        In the depth segment, our matcher is applied to the captured images. The difference of the
        reference device from our matcher is added.
        """
        rows = [
            against_row(scene.against, scene, self.columns)
            for scene in self.scene_models
            if scene.against is not None
        ]
        if not rows:
            return None
        if self.segment is not Segment.DEPTH:
            return np.stack(rows)
        rematched = self.simulate({})
        assert rematched is not None
        return rematched + np.stack(rows)

    def simulate(self, settings: Mapping[str, Value], *, seed: int = 0) -> Rows | None:
        """Simulate all scenes with effects; None if the sensor cannot have these values.

        Equal seeds give equal noise. Results are cached.
        """
        return self._compute(*_simulation(settings, seed))

    def simulate_device(self, settings: Mapping[str, Value], *, number: int) -> Rows | None:
        """Simulate another device of the same kind, with its own noise.

        Args:
            settings: as `simulate`.
            number: number of the device, from 1; also the seed of the noise.
        """
        return self._compute(*_device_simulation(settings, number))

    def prefetch(self, settings: Mapping[str, Value]) -> None:
        """Start the simulations that `change` needs, if there is a worker pool."""
        if self.pool is None:
            return
        jobs = [_simulation(settings, 0)]
        for number in self._devices(settings):
            jobs += [_device_simulation(settings, number), _device_simulation({}, number)]
        for text, seed, function, effects in jobs:
            for key in self._missing(text, seed):
                if key not in self._pending:
                    self._pending[key] = self._submit(self.pool, key, function, effects)

    def extra_bits(self, *, seed: int) -> Rows:
        """Compute what the bits change that the device's matcher reads and its images lack.

        This is the difference of the simulated device depth from our matcher's depth of the
        simulated output images.
        """
        rows = self._compute("finer", seed, extra_bits_row, {})
        assert rows is not None
        return rows

    def estimate_changes(self) -> list[Rows]:
        """Compute the change by each alternative estimate of the scenes, with equal noise."""
        base = self.simulate({})
        assert base is not None
        changes = []
        for number in range(max(len(scene.estimates) for scene in self.scene_models)):
            rows = self._compute("otherwise", number, estimate_row)
            assert rows is not None
            changes.append(rows - base)
        return changes

    def reexposed(self, *, seed: int) -> Rows:
        """Compute the features of the reference images with the noise of one more exposure."""
        rows = self._compute("exposed", seed, reexposed_row)
        assert rows is not None
        return rows

    def change(self, settings: Mapping[str, Value]) -> Rows | None:
        """Compute the change by effects, with equal noise; the mean over devices if it is random.

        If an effect leaves a feature too few pixels, its change is 0: the effect does not explain
        that feature.
        """
        changes = self._device_changes(settings)
        return None if changes is None else np.nan_to_num(mean_known(changes, axis=0))

    def scatter(self, settings: Mapping[str, Value]) -> Row | None:
        """Compute the standard deviation (features,) of one device's change from `change`.

        It is pooled over scenes; None if the effects have no random part.
        """
        changes = self._device_changes(settings)
        if changes is None or len(changes) < 2:
            return None
        count = len(changes)
        square = mean_known((changes - mean_known(changes, axis=0)) ** 2, axis=(0, 1))
        return np.sqrt(np.nan_to_num(square) * (count + 1) / (count - 1))

    def _device_changes(self, settings: Mapping[str, Value]) -> NDArray[np.float64] | None:
        """Compute the change in each of several devices (devices, scenes, features)."""
        with_effects, base = self.simulate(settings), self.simulate({})
        assert base is not None
        if with_effects is None:
            return None
        changes = [with_effects - base]
        for number in self._devices(settings):
            with_effects = self.simulate_device(settings, number=number)
            base = self.simulate_device({}, number=number)
            assert with_effects is not None and base is not None  # The first device could be.
            changes.append(with_effects - base)
        return np.stack(changes)

    def _devices(self, settings: Mapping[str, Value]) -> tuple[int, ...]:
        """Select the further devices over which a random change is averaged."""
        return () if self.segment is Segment.DEPTH else _random_devices(settings)

    def _compute(self, text: str, seed: int, function: RowFunction, *arguments: Any) -> Rows | None:
        """Return the rows of all scenes from the cache, and compute missing ones."""
        missing = self._missing(text, seed)
        for key, row in zip(missing, self._results(missing, function, *arguments), strict=True):
            self._rows[key] = row
            path = self._path(*key)
            if path is not None:
                _save(path, np.empty(0) if row is None else row)
        rows = [self._rows[number, text, seed] for number in range(len(self.scene_models))]
        known = [row for row in rows if row is not None]
        return np.stack(known) if len(known) == len(rows) else None

    def _missing(self, text: str, seed: int) -> list[_Key]:
        """List the keys found neither in memory nor on disk; rows on disk are loaded."""
        keys = [(number, text, seed) for number in range(len(self.scene_models))]
        unknown = [key for key in keys if key not in self._rows]
        for key in unknown:
            path = self._path(*key)
            if path is not None and path.is_file():
                row = np.load(path, allow_pickle=False)
                self._rows[key] = row if row.size else None
        return [key for key in unknown if key not in self._rows]

    def _results(
        self, keys: Sequence[_Key], function: RowFunction, *arguments: Any
    ) -> Iterator[Row | None]:
        if self.pool is None:
            for number, _, seed in keys:
                yield function(self.scene_models[number], self.columns, *arguments, seed)
        else:
            futures = [
                self._pending.pop(key, None) or self._submit(self.pool, key, function, *arguments)
                for key in keys
            ]
            yield from (future.result() for future in futures)

    def _submit(
        self, pool: WorkerPool, key: _Key, function: RowFunction, *arguments: Any
    ) -> Future[Row | None]:
        number, _, seed = key
        name = self.scene_models[number].name
        return pool.submit(name, function, self.columns, *arguments, seed)

    def _path(self, number: int, text: str, seed: int) -> Path | None:
        if self.cache is None:
            return None
        name = hashlib.sha256(f"{text} {seed}".encode()).hexdigest()[:16]
        return self.cache / self._digests[number] / f"{name}.npy"

    @cached_property
    def _digests(self) -> list[str]:
        return [
            _digest(scene, self.columns, self._base(number))
            for number, scene in enumerate(self.scene_models)
        ]

    def _base(self, number: int) -> Row:
        """Compute a scene's base row in each run: it is part of the digest of cached rows."""
        key = (number, _BASE, 0)
        if key not in self._rows:
            (self._rows[key],) = self._results([key], simulated_row, {})
        row = self._rows[key]
        assert row is not None
        return row


def _simulation(settings: Mapping[str, Value], seed: int) -> _Job:
    """Describe a simulation of the captured device."""
    effects = dict(sorted(settings.items()))
    return repr(list(effects.items())), seed, simulated_row, effects


def _device_simulation(settings: Mapping[str, Value], number: int) -> _Job:
    """Describe a simulation of another device; its number is the seed of its noise."""
    effects = dict(sorted(settings.items()))
    return f"another {list(effects.items())!r}", number, device_row, effects


def _random_devices(settings: Mapping[str, Value]) -> tuple[int, ...]:
    """Select further devices if an effect has a random part."""
    random_effects = [effect for effect in map(_effect, settings) if effect.drawn]
    if not random_effects:
        return ()
    return _RENDERED_DEVICES if any(effect.rerender for effect in random_effects) else _DEVICES


def _effect(name: str) -> Effect:
    return setting.parameter_of(name)[0]


def build_feature_table(
    scene_models: Sequence[SceneModel],
    segment: Segment,
    *,
    cache: Path | None = None,
    pool: WorkerPool | None = None,
) -> FeatureTable:
    """Build a feature table; its columns are all features that a simulated base has.

    Args:
        scene_models: at least one; all with one sensor.
        segment: segment of the pipeline.
        cache: folder that keeps simulated rows for later runs.
        pool: workers that simulate; None uses this process.
    """
    if cache is not None:
        _make_folder(cache)
    ceiling = float(2 ** scene_models[0].sensor.left.bit_depth - 1)
    if pool is None:
        features = [base_features(scene, segment, ceiling) for scene in scene_models]
    else:
        futures = [
            pool.submit(scene.name, base_features, segment, ceiling) for scene in scene_models
        ]
        features = [future.result() for future in futures]
    names = tuple(sorted(set().union(*features)))
    columns = Columns(segment=segment, names=names, ceiling=ceiling)
    base = {(number, _BASE, 0): in_order(row, columns) for number, row in enumerate(features)}
    return FeatureTable(tuple(scene_models), columns, cache, pool, {**base})


def _digest(scene: SceneModel, columns: Columns, base: Row) -> str:
    """Hash all that a scene's rows depend on; the base row covers further dependencies."""
    settings = (
        record.code(*_SOURCES),
        record.versions(),
        columns,
        scene.name,
        scene.frames,
        scene.sensor,
        record.content(scene.scene),
    )
    digest = hashlib.sha256(repr(settings).encode())
    for image in (scene.strata.expected, scene.strata.disparity_px, base):
        digest.update(np.ascontiguousarray(image).tobytes())
    observations = [scene.real] if columns.segment is Segment.DEPTH else []
    observations += [] if scene.against is None else [scene.against]
    for observation in observations:
        for images in (observation.left, observation.right, observation.device_px):
            if images is not None:
                digest.update(np.ascontiguousarray(images).tobytes())
    return digest.hexdigest()[:16]


def _make_folder(cache: Path) -> None:
    try:
        cache.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refuse("cache", "must be a folder", cache, f"{error.strerror}.") from error


def _save(path: Path, row: Row) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}.npy")  # Two processes may save the same row.
    np.save(part, row, allow_pickle=False)
    part.replace(path)
