"""Feature tables: simulation by workers, random effects, missing features, invalidated caches."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.which import table as module
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.rows import Columns, Row
from starling.diagnosis.which.table import FeatureTable
from starling.diagnosis.workers import WorkerPool
from starling.sim.effects.effect import Value
from tests.unit.diagnosis.made_gaps import FEATURES, SCENES, FakeTable, noise

NAMED_SCENES = cast(
    tuple[SceneModel, ...], (SimpleNamespace(name="attic"), SimpleNamespace(name="hall"))
)
FLICKER, VEIL = {"flicker": 0.1}, {"veil": 0.04}  # An effect with a random part, and one without.
ROOT = Path(module.__file__).parents[2]


class ImmediatePool:
    """A pool that computes at once: a row is the sum of strengths and seed."""

    def __init__(self) -> None:
        self.jobs: list[tuple[str, str, str, int]] = []

    def submit(
        self, scene: str, work: Any, _: Columns, settings: dict[str, float], seed: int
    ) -> Future[Row]:
        self.jobs.append((scene, work.__name__, repr(settings), seed))
        done: Future[Row] = Future()
        done.set_result(np.full(3, seed + sum(settings.values())))
        return done


def table_with(pool: ImmediatePool | None, segment: Segment = Segment.IMAGE) -> FeatureTable:
    columns = Columns(segment=segment, names=("a", "b", "c"), ceiling=255)
    return FeatureTable(NAMED_SCENES, columns, pool=cast(WorkerPool | None, pool))


@pytest.mark.parametrize("segment", [Segment.IMAGE, Segment.DEPTH])
def test_prefetched_rows_are_computed_once_and_equal(segment: Segment):
    plain_pool, ahead_pool = ImmediatePool(), ImmediatePool()
    plain, ahead = table_with(plain_pool, segment), table_with(ahead_pool, segment)
    for settings in (FLICKER, VEIL, FLICKER):
        ahead.prefetch(settings)
    prefetched = list(ahead_pool.jobs)
    assert [name for name, *_ in prefetched[:2]] == ["attic", "hall"]  # Scenes run in parallel.
    for settings in (VEIL, FLICKER):
        expected, result = plain.change(settings), ahead.change(settings)
        assert expected is not None and result is not None
        np.testing.assert_array_equal(result, expected)
    assert len(set(ahead_pool.jobs)) == len(ahead_pool.jobs)
    assert sorted(ahead_pool.jobs) == sorted(plain_pool.jobs)
    base = {job for job in ahead_pool.jobs if job[1:] == ("simulated_row", "{}", 0)}
    assert set(ahead_pool.jobs) - set(prefetched) == base  # The base is known before any effect.
    devices = {seed for _, work, _, seed in prefetched if work == "device_row"}
    assert devices == ({1, 2, 3} if segment is Segment.IMAGE else set())


def test_prefetch_without_workers_simulates_nothing():
    table_with(None).prefetch(FLICKER)  # These scenes cannot be simulated.


class RandomEffects(FeatureTable):
    """A base of noise, and effects that add 1 in the first device and 1 + 0.4 k in device k."""

    def simulate(self, settings: Mapping[str, Value], *, seed: int = 0) -> np.ndarray:
        return noise(seed) + bool(settings)

    def simulate_device(self, settings: Mapping[str, Value], *, number: int) -> np.ndarray:
        return noise(number) + bool(settings) * (1 + 0.4 * number)


def random_effects(segment: Segment) -> RandomEffects:
    return RandomEffects((), Columns(segment=segment, names=(), ceiling=255))


def test_a_random_change_is_a_mean_over_devices_with_its_scatter():
    """Changes are 1, 1.4, 1.8, 2.2. The scatter is that of one more device from their mean."""
    assert random_effects(Segment.IMAGE).change(FLICKER) == pytest.approx(
        np.full((SCENES, FEATURES), 1.6)
    )
    scatter = random_effects(Segment.IMAGE).scatter(FLICKER)
    assert scatter is not None and scatter.shape == (FEATURES,)
    np.testing.assert_allclose(scatter, np.std([1, 1.4, 1.8, 2.2], ddof=1) * np.sqrt(1 + 1 / 4))
    for segment, settings in ((Segment.IMAGE, VEIL), (Segment.DEPTH, FLICKER)):
        table = random_effects(segment)
        assert table.change(settings) == pytest.approx(np.ones((SCENES, FEATURES)))
        assert table.scatter(settings) is None


def test_a_feature_that_becomes_unknown_does_not_change():
    """An effect does not explain a feature that it makes unknown."""
    columns = Columns(segment=Segment.IMAGE, names=("a", "b"), ceiling=255)
    rows = {(0, "[]", 0): np.array([1.0, 2.0]), (0, "[('veil', 0.5)]", 0): np.array([np.nan, 5.0])}
    table = FeatureTable(FakeTable.scene_models[:1], columns, _rows={**rows})
    change = table.change({"veil": 0.5})
    assert change is not None and change.tolist() == [[0.0, 3.0]]


def imported_by(module_name: str) -> set[str]:
    """List the modules of `diagnosis` that a module imports, directly or indirectly, and itself."""
    modules: set[str] = set()
    pending = [module_name]
    while pending:
        name = pending.pop()
        path = ROOT.joinpath(*name.split(".")[1:]).with_suffix(".py")
        if name in modules or not path.is_file():
            continue
        modules.add(name)
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                members = (f"{node.module}.{alias.name}" for alias in node.names)
                pending += [
                    candidate
                    for candidate in (node.module, *members)
                    if candidate.startswith("starling.diagnosis.")
                ]
    return modules


def test_the_cache_depends_on_all_code_of_observations_and_features():
    sources = {str(path.relative_to(ROOT)) for path in module._SOURCES}
    for name in imported_by("starling.diagnosis.scenes.scene_model") | imported_by(
        "starling.diagnosis.features.observation"
    ):
        path = Path(*name.split(".")[1:]).with_suffix(".py")
        assert any(str(parent) in sources for parent in (path, *path.parents)), name
