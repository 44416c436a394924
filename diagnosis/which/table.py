"""Feature table: features of all scenes in one pipeline segment, captured or simulated."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.features.depth import depth_features, matched_depth_features
from starling.diagnosis.features.infrared import image_features
from starling.diagnosis.scenes.observation import (
    DepthObservation,
    FullObservation,
    SceneObservation,
    StereoObservation,
    expect,
)
from starling.diagnosis.scenes.request import CAPTURED, Request, Source, simulation
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.workers import WorkerPool
from starling.patterns.errors import InputError, refuse
from starling.sim.arrays import mean_known
from starling.sim.console import record
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Value

# Raise it when code changes rows of equal contents. It invalidates all rows cached on disk.
FEATURES_VERSION = 3
BITS = "dropped_bits"  # Effect: bits that the device's matcher reads and its images lack.
_DEVICES = (1, 2, 3)  # Devices, and noise seeds, over which random effects are averaged.
_RENDERED_DEVICES = (1,)  # The same for effects that need rendering, which takes most of the time.
_IMPOSSIBLE = np.empty(0)  # Row of effects that the sensor cannot have.
_SOURCES = {  # What effects change in a segment; in the depth segment it is matched again.
    Segment.IMAGE: Source.INFRARED,
    Segment.DEPTH: Source.REMATCHED,
    Segment.WHOLE: Source.DEPTH,
}
# Sources whose images differ from the captured ones, so that only differences of depth compare.
_OTHER_IMAGES = {Source.BOTH, Source.REFERENCE}

Row = NDArray[np.float64]  # (features,)
Rows = NDArray[np.float64]  # (scenes, features); NaN where a feature has too few pixels.

Result = TypeVar("Result")

_Key = tuple[int, Request]  # Index of the scene, and what is requested of it.


@dataclass(frozen=True, kw_only=True, slots=True)
class Columns:
    """Features of a table, the same for all scenes."""

    segment: Segment
    names: tuple[str, ...]
    ceiling: float  # Largest code [DN].

    def row(self, values: Mapping[str, float]) -> Row:
        """Arrange features in the order of the columns; NaN where a feature is missing."""
        return np.array([values.get(name, np.nan) for name in self.names])


@dataclass(frozen=True, eq=False)
class FeatureTable:
    """Scene models, and the features that one segment has of them."""

    scene_models: tuple[SceneModel, ...]
    columns: Columns
    cache: Path | None = None  # Folder that keeps rows; None: no cache on disk.
    pool: WorkerPool | None = None  # Workers that simulate; None: this process.
    _rows: dict[_Key, Row] = field(default_factory=dict, repr=False)
    _pending: dict[_Key, Future[Row]] = field(default_factory=dict, repr=False)

    @property
    def segment(self) -> Segment:
        """Segment of the pipeline."""
        return self.columns.segment

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the features."""
        return self.columns.names

    @property
    def compared(self) -> bool:
        """Whether the captures are compared with a captured reference."""
        return any(scene.against is not None for scene in self.scene_models)

    def with_scenes(self, scene_models: Sequence[SceneModel]) -> FeatureTable:
        """Replace the scenes."""
        return dataclasses.replace(self, scene_models=tuple(scene_models), _rows={}, _pending={})

    def with_captures(self, scene_models: Sequence[SceneModel]) -> FeatureTable:
        """Replace the captures of the scenes, and keep simulated rows.

        The number of repeats must be equal. In the depth segment simulated rows depend on the
        captures, so there this is not possible.
        """
        assert self.segment is not Segment.DEPTH
        return dataclasses.replace(self, scene_models=tuple(scene_models))

    def request(self, settings: Mapping[str, Value], *, seed: int = 0, device: int = 0) -> Request:
        """Request a simulation of what the segment compares (see `request.simulation`)."""
        return simulation(_SOURCES[self.segment], settings, seed=seed, device=device)

    def rows(self, request: Request) -> Rows:
        """Compute the features of all scenes in requested observations; results are cached.

        Depth is compared for equal images. In the depth segment, the features of other images
        are therefore those of the device's depth less those of our matcher's depth.

        Raises:
            InputError: if the sensor of a scene cannot have the requested effects.
        """
        missing = self._missing(request)
        for key, row in zip(missing, self._results(missing), strict=True):
            self._rows[key] = row
            path = self._path(key)
            if path is not None:
                _save(path, row)
        rows = [self._rows[number, request] for number in range(len(self.scene_models))]
        if not all(row.size for row in rows):
            rule = "must be possible in one sensor"
            raise refuse("effects", rule, request.settings, "Choose other values.")
        return np.stack(rows)

    def prefetch(self, settings: Mapping[str, Value]) -> None:
        """Start the simulations that `change` needs, if there is a worker pool."""
        if self.pool is None:
            return
        for request in itertools.chain(*self._device_pairs(settings)):
            for key in self._missing(request):
                if key not in self._pending:
                    self._pending[key] = self._submit(self.pool, key)

    def change(self, settings: Mapping[str, Value]) -> Rows | None:
        """Compute the change by effects, with equal noise; the mean over devices if it is random.

        If an effect leaves a feature too few pixels, its change is 0: the effect does not explain
        that feature.

        Returns:
            None if the sensor cannot have these values.
        """
        changes = self._device_changes(settings)
        return np.nan_to_num(mean_known(changes, axis=0)) if len(changes) else None

    def scatter(self, settings: Mapping[str, Value]) -> Row | None:
        """Compute the standard deviation (features,) of one device's change from `change`.

        It is pooled over scenes; None if the effects have no random part.
        """
        changes = self._device_changes(settings)
        count = len(changes)
        if count < 2:
            return None
        square = mean_known((changes - mean_known(changes, axis=0)) ** 2, axis=(0, 1))
        return np.sqrt(np.nan_to_num(square) * (count + 1) / (count - 1))

    def _device_changes(self, settings: Mapping[str, Value]) -> NDArray[np.float64]:
        """Compute the change in each of several devices (devices, scenes, features).

        There are no devices if the sensor cannot have these values.
        """
        pairs = self._device_pairs(settings)
        try:
            return np.stack([self.rows(effects) - self.rows(base) for effects, base in pairs])
        except InputError:
            return np.empty((0, len(self.scene_models), len(self.names)))

    def _device_pairs(self, settings: Mapping[str, Value]) -> list[tuple[Request, Request]]:
        """List the requests with and without effects, for each device; its number is the seed."""
        further = () if self.segment is Segment.DEPTH else _random_devices(settings)
        return [
            (
                self.request(settings, seed=number, device=number),
                self.request({}, seed=number, device=number),
            )
            for number in (0, *further)
        ]

    def _missing(self, request: Request) -> list[_Key]:
        """List the keys found neither in memory nor on disk; rows on disk are loaded.

        Rows of captures are computed again: captures may be replaced, and reading them is quick.
        """
        keys = [(number, request) for number in range(len(self.scene_models))]
        if request == CAPTURED:
            return keys
        unknown = [key for key in keys if key not in self._rows]
        for key in unknown:
            path = self._path(key)
            row = None if path is None else _load(path, self._base(key[0]).size)
            if row is not None:
                self._rows[key] = row
        return [key for key in unknown if key not in self._rows]

    def _results(self, keys: Sequence[_Key]) -> Iterator[Row]:
        if self.pool is None:
            for number, request in keys:
                yield compute_row(self.scene_models[number], self.columns, request)
        else:
            futures = [self._pending.pop(key, None) or self._submit(self.pool, key) for key in keys]
            yield from (future.result() for future in futures)

    def _submit(self, pool: WorkerPool, key: _Key) -> Future[Row]:
        number, request = key
        return pool.submit(self.scene_models[number].name, compute_row, self.columns, request)

    def _path(self, key: _Key) -> Path | None:
        """Return the file of a row; None if it is not kept."""
        number, request = key
        if self.cache is None or request == CAPTURED:
            return None
        name = hashlib.sha256(repr(request).encode()).hexdigest()[:16]
        return self.cache / self._digests[number] / f"{name}.npy"

    @cached_property
    def _digests(self) -> list[str]:
        return [
            _digest(scene, self.columns, self._base(number))
            for number, scene in enumerate(self.scene_models)
        ]

    def _base(self, number: int) -> Row:
        """Compute a scene's base row in each run: it is part of the digest of cached rows."""
        key = (number, self.request({}))
        if key not in self._rows:
            (self._rows[key],) = self._results([key])
        return self._rows[key]


def _random_devices(settings: Mapping[str, Value]) -> tuple[int, ...]:
    """Select further devices if an effect has a random part."""
    effects = [setting.parameter_of(name)[0] for name in settings]
    random_effects = [effect for effect in effects if effect.drawn]
    if not random_effects:
        return ()
    return _RENDERED_DEVICES if any(effect.rerender for effect in random_effects) else _DEVICES


def compute_row(scene: SceneModel, columns: Columns, request: Request) -> Row:
    """Compute one scene's row of `FeatureTable.rows`; empty if its sensor cannot have the effects.

    In the depth segment, the captured images are matched again. They lack bits that only the
    device's matcher reads, so the change by these bits is taken from simulated images.
    """
    try:
        observation = scene.observe(request)
    except InputError:
        return _IMPOSSIBLE
    if columns.segment is Segment.DEPTH and request.source in _OTHER_IMAGES:
        device = dataclasses.replace(scene, real=observation)
        requests = (CAPTURED, simulation(Source.REMATCHED, {}))
        measured, rematched = (compute_row(device, columns, each) for each in requests)
        return measured - rematched
    row = columns.row(_features(columns.segment, observation, scene, columns.ceiling))
    if request.source is Source.REMATCHED and BITS in request.settings:
        requests = (
            simulation(Source.BOTH, bits, seed=request.seed)
            for bits in ({BITS: request.settings[BITS]}, {})
        )
        with_bits, without = (compute_row(scene, columns, each) for each in requests)
        row = row + (with_bits - without)
    return row


def _features(
    segment: Segment, observation: SceneObservation, scene: SceneModel, ceiling: float
) -> dict[str, float]:
    if segment is Segment.IMAGE:
        pairs = expect(observation, StereoObservation)
        return image_features(pairs, scene.strata, ceiling=ceiling)
    if segment is Segment.WHOLE:
        return depth_features(expect(observation, DepthObservation), scene.strata)
    captured_px = expect(scene.real, DepthObservation).device_px[0]
    full = expect(observation, FullObservation)
    return matched_depth_features(full, scene.strata, captured_px)


def base_features(scene: SceneModel, segment: Segment, ceiling: float) -> dict[str, float]:
    """Compute the features of one scene in a segment, simulated without effects."""
    observation = scene.observe(simulation(_SOURCES[segment], {}))
    return _features(segment, observation, scene, ceiling)


def on_scenes(
    scene_models: Sequence[SceneModel],
    pool: WorkerPool | None,
    work: Callable[..., Result],
    *arguments: Any,
) -> list[Result]:
    """Run `work(scene_model, *arguments)` on each scene, on the workers of a pool if given."""
    if pool is None:
        return [work(scene, *arguments) for scene in scene_models]
    futures = [pool.submit(scene.name, work, *arguments) for scene in scene_models]
    return [future.result() for future in futures]


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
        cache: folder that keeps rows for later runs.
        pool: workers that simulate; None uses this process.
    """
    if cache is not None:
        _make_folder(cache)
    ceiling = float(2 ** scene_models[0].sensor.left.bit_depth - 1)
    values = on_scenes(scene_models, pool, base_features, segment, ceiling)
    names = tuple(sorted(set().union(*values)))
    columns = Columns(segment=segment, names=names, ceiling=ceiling)
    base = simulation(_SOURCES[segment], {})
    rows = {(number, base): columns.row(value) for number, value in enumerate(values)}
    return FeatureTable(tuple(scene_models), columns, cache, pool, rows)


def _digest(scene: SceneModel, columns: Columns, base: Row) -> str:
    """Hash all that a scene's rows depend on; the base row covers further dependencies."""
    images = [scene.strata.expected, scene.strata.disparity_px, base]
    observations = [scene.real] if columns.segment is Segment.DEPTH else []
    observations += [] if scene.against is None else [scene.against]
    for observation in observations:
        if isinstance(observation, StereoObservation):
            images += [observation.left, observation.right]
        if isinstance(observation, DepthObservation):
            images.append(observation.device_px)
    contents = (
        FEATURES_VERSION,
        record.versions(),
        columns,
        scene.name,
        scene.frames,
        scene.sensor,
        record.content(scene.scene),
        record.content(images),
    )
    return hashlib.sha256(repr(contents).encode()).hexdigest()[:16]


def _make_folder(cache: Path) -> None:
    try:
        cache.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise refuse("cache", "must be a folder", cache, f"{error.strerror}.") from error


def _load(path: Path, size: int) -> Row | None:
    """Read a row of `size` values, or an empty one; None if there is none or it is damaged."""
    try:
        row = np.load(path, allow_pickle=False)
    except Exception:  # NumPy raises errors of many types for damaged files.
        return None
    whole = isinstance(row, np.ndarray) and row.dtype == np.float64
    return row if whole and row.ndim == 1 and row.size in (0, size) else None


def _save(path: Path, row: Row) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}.npy")  # Two processes may save the same row.
    np.save(part, row, allow_pickle=False)
    part.replace(path)
