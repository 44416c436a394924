"""Feature tables: simulation by workers, random effects, missing features, invalidated caches."""

from __future__ import annotations

from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from starling.diagnosis.scenes.request import CAPTURED, Request
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.which import table as module
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.table import Columns, FeatureTable, Row
from starling.diagnosis.workers import WorkerPool
from starling.patterns.errors import InputError
from tests.unit.diagnosis.made_gaps import FEATURES, SCENES, FakeTable, noise

NAMED_SCENES = cast(
    tuple[SceneModel, ...], (SimpleNamespace(name="attic"), SimpleNamespace(name="hall"))
)
FLICKER, VEIL = {"flicker": 0.1}, {"veil": 0.04}  # An effect with a random part, and one without.


class ImmediatePool:
    """A pool that computes at once: a row is the sum of strengths and seed."""

    def __init__(self) -> None:
        self.jobs: list[tuple[str, Request]] = []

    def submit(self, scene: str, work: Any, _: Columns, request: Request) -> Future[Row]:
        assert work is module.compute_row
        self.jobs.append((scene, request))
        done: Future[Row] = Future()
        done.set_result(np.full(3, request.seed + sum(map(float, request.settings.values()))))
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
    assert sorted(ahead_pool.jobs, key=repr) == sorted(plain_pool.jobs, key=repr)
    assert prefetched == ahead_pool.jobs
    devices = {(request.device, request.seed) for _, request in prefetched}
    further = {(1, 1), (2, 2), (3, 3)} if segment is Segment.IMAGE else set()
    assert devices == {(0, 0), *further}


def test_prefetch_without_workers_simulates_nothing():
    table_with(None).prefetch(FLICKER)  # These scenes cannot be simulated.


class RandomEffects(FeatureTable):
    """A base of noise, and effects that add 1 in the first device and 1 + 0.4 k in device k."""

    def rows(self, request: Request) -> np.ndarray:
        return noise(request.seed) + bool(request.effects) * (1 + 0.4 * request.device)


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
    table = FeatureTable(FakeTable.scene_models[:1], columns)
    rows = {(0, table.request({})): [1.0, 2.0], (0, table.request({"veil": 0.5})): [np.nan, 5.0]}
    table._rows.update({key: np.array(row) for key, row in rows.items()})
    change = table.change({"veil": 0.5})
    assert change is not None and change.tolist() == [[0.0, 3.0]]


def test_rows_of_captures_are_computed_again():
    """Captures of a table may be replaced, and its simulated rows are kept."""
    pool = ImmediatePool()
    table = table_with(pool)
    requests = (CAPTURED, table.request(VEIL))
    for current in (table, table.with_captures(NAMED_SCENES)):
        for request in requests:
            current.rows(request)
    assert [request for _, request in pool.jobs[::2]] == [*requests, CAPTURED]


def test_effects_that_no_sensor_can_have_are_refused():
    table = FeatureTable(NAMED_SCENES, Columns(segment=Segment.IMAGE, names=("a",), ceiling=255))
    possible = {(number, table.request({})): np.zeros(1) for number in (0, 1)}
    impossible = {(0, table.request(VEIL)): np.zeros(1), (1, table.request(VEIL)): np.empty(0)}
    table._rows.update(possible | impossible)
    assert table.change(VEIL) is None and table.scatter(VEIL) is None
    with pytest.raises(InputError, match="effects must be possible in one sensor"):
        table.rows(table.request(VEIL))


@pytest.mark.parametrize(
    "damaged", [b"", b"junk", np.ones(4), np.ones((3, 1)), np.array(["x"] * 3)]
)
def test_damaged_rows_count_as_missing(tmp_path: Path, damaged: bytes | np.ndarray) -> None:
    path = tmp_path / "row.npy"
    module._save(path, np.ones(3))
    np.testing.assert_array_equal(module._load(path, 3), np.ones(3))
    if isinstance(damaged, bytes):
        path.write_bytes(damaged)
    else:
        np.save(path, damaged)
    assert module._load(path, 3) is None


def test_a_cache_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "cache").touch()
    with pytest.raises(InputError, match=r"cache must be a folder; got .*cache\. File exists"):
        module.build_feature_table(NAMED_SCENES, Segment.IMAGE, cache=tmp_path / "cache")
