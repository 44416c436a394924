"""Shelved values: few in memory, all equal to what was set."""

from __future__ import annotations

import gc
import threading
import weakref
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from starling.diagnosis.scenes import shelf
from starling.diagnosis.scenes.shelf import MOST_HELD, Derived, Shelved, select, shelve

COUNT = 20


@dataclass(kw_only=True, eq=False, repr=False)
class Owner:
    name: str
    image: Shelved[NDArray[np.float32]] = Shelved()
    notes: Shelved[dict[str, Any]] = Shelved(changes=True)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(shelf, "_shelf", shelf._Shelf())
    shelf.use_folder(tmp_path)
    return tmp_path


def image(number: int) -> NDArray[np.float32]:
    return np.asfortranarray(np.random.default_rng(number).random((6, 5), np.float32))


def build_owners() -> list[Owner]:
    return [Owner(name=str(n), image=image(n), notes={}) for n in range(COUNT)]


def test_values_of_few_owners_are_in_memory(folder: Path) -> None:
    owners = build_owners()
    arrays = [weakref.ref(owner.image) for owner in owners]
    gc.collect()
    assert sum(array() is not None for array in arrays) <= MOST_HELD
    for _ in range(2):
        for number, owner in enumerate(owners):
            np.testing.assert_array_equal(owner.image, image(number))
            assert owner.image.flags.f_contiguous  # The order of sums stays the same.
    assert len(list(folder.iterdir())) <= 2 * COUNT


def test_few_owners_write_no_file(folder: Path) -> None:
    owners = [Owner(name="", image=image(n), notes={}) for n in range(MOST_HELD)]
    assert all(owner.image.size for owner in owners)
    assert list(folder.iterdir()) == []


def test_values_that_change_are_written_at_each_move(folder: Path) -> None:
    owners = build_owners()
    for turn in range(3):
        for owner in owners:
            owner.notes[owner.name] = turn
    assert [owner.notes for owner in owners] == [{owner.name: 2} for owner in owners]


def test_a_replaced_value_is_not_read_from_its_old_file(folder: Path) -> None:
    owners = build_owners()
    owners[0].image = np.zeros((1, 1), np.float32)
    assert [owner.image.size for owner in owners][:2] == [1, 30]
    assert owners[0].image.size == 1


def test_copies_share_values_and_files_end_with_their_owners(folder: Path) -> None:
    owners = build_owners()
    copy = replace(owners[3], name="copy")
    assert copy.image is owners[3].image
    del owners
    gc.collect()
    assert list(folder.iterdir()) == []
    np.testing.assert_array_equal(copy.image, image(3))


def test_values_that_cannot_be_pickled_stay_in_memory(folder: Path) -> None:
    owners = build_owners()
    lock = threading.Lock()
    owners[0].notes = {"lock": lock}
    for owner in owners:
        assert owner.image.size
    assert owners[0].notes["lock"] is lock
    assert len(list(folder.iterdir())) <= 2 * COUNT - 1  # No damaged file is left.


def test_without_a_folder_a_temporary_one_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shelf, "_shelf", shelf._Shelf())
    owners = build_owners()
    temporary = Path(shelf._shelf._own_folder.name)
    assert any(temporary.iterdir())
    np.testing.assert_array_equal(owners[0].image, image(0))
    shelf._shelf._own_folder.cleanup()
    assert not temporary.exists()


def test_shelved_sequences_are_read_item_by_item(folder: Path) -> None:
    arrays: list[weakref.ref[NDArray[np.float32]]] = []

    def images() -> Any:
        for number in range(COUNT):
            array = image(number)
            arrays.append(weakref.ref(array))
            yield array

    items = shelve(images())
    gc.collect()
    assert len(items) == COUNT
    assert sum(array() is not None for array in arrays) <= MOST_HELD + 1
    for number, item in enumerate(items):
        np.testing.assert_array_equal(item, image(number))


def test_derived_items_are_computed_at_each_use() -> None:
    squares = Derived(4, lambda number: number**2)
    assert list(squares) == [0, 1, 4, 9] and squares[-1] == 9
    assert list(squares[1:3]) == [1, 4] and list(squares[::-1]) == [9, 4, 1, 0]
    with pytest.raises(IndexError):
        squares[4]


def test_selected_items_are_read_at_their_use() -> None:
    assert list(select(Derived(9, lambda number: 10 * number), [4, 1])) == [40, 10]


def test_shelved_attributes_have_no_default() -> None:
    assert not hasattr(Owner, "image")
    with pytest.raises(TypeError, match="image"):
        Owner(name="", notes={})
