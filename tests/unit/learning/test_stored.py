"""Samples on disk and items read on demand: equal content, memory of one item, no files left."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from starling.learning.networks.stored import store
from starling.patterns.errors import InputError
from starling.sim.on_demand import OnDemand


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Sample:
    name: str
    image: np.ndarray


def _samples(count: int, side: int = 4) -> Iterator[Sample]:
    for number in range(count):
        yield Sample(name=str(number), image=np.full((side, side), number, np.float32))


def test_stored_samples_equal_the_given_ones(tmp_path: Path) -> None:
    stored = store(_samples(3), tmp_path)
    assert [sample.name for sample in stored] == ["0", "1", "2"]
    for given, sample in zip(_samples(3), stored, strict=True):
        np.testing.assert_array_equal(sample.image, given.image)
        assert sample.image.dtype == given.image.dtype


def test_files_go_with_the_samples_and_those_of_a_killed_run_before(tmp_path: Path) -> None:
    left = tmp_path / ".samples-killed"
    left.mkdir()
    stored = store(_samples(2), tmp_path)
    assert not left.exists()
    assert len(list(tmp_path.iterdir())) == 1
    del stored
    gc.collect()
    assert not list(tmp_path.iterdir())


def test_memory_does_not_grow_with_the_number_of_samples(tmp_path: Path) -> None:
    side, count = 256, 40
    tracemalloc.start()
    stored = store(_samples(count, side), tmp_path)
    total = sum(float(sample.image.mean()) for sample in stored)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert total == sum(range(count))
    assert peak < 4 * side**2 * count / 4


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(InputError, match="out must be writable"):
        store(_samples(1), file)


def test_items_are_read_when_they_are_used() -> None:
    read: list[int] = []

    def double(number: int) -> int:
        read.append(number)
        return 2 * number

    items = OnDemand(range(5), double)
    later = items[3:]
    assert (len(items), len(later), read) == (5, 2, [])
    assert [*later, items[0]] == [6, 8, 0]
    assert read == [3, 4, 0]
