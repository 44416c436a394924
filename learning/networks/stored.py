"""Samples on disk, so that the memory of a training does not grow with their number."""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
import weakref
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from starling.sim.console import output
from starling.sim.on_demand import OnDemand

T = TypeVar("T")
_PREFIX = ".samples-"


def store(samples: Iterable[T], folder: Path) -> OnDemand[T]:
    """Write the arrays of samples to files; an access maps those of one sample into memory.

    The files are removed with the returned sequence. Files of a killed run are removed first.

    Args:
        samples: dataclasses; read one after the other.
        folder: folder of one training; created if missing.

    Raises:
        InputError: if a file cannot be written.
    """
    with output.refused(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for stale in folder.glob(f"{_PREFIX}*"):
            shutil.rmtree(stale)
        place = _Place(folder)
    stored = []
    for number, sample in enumerate(samples):
        with output.refused(folder):
            stored.append(_Stored(place, number, sample))
    return OnDemand(stored, _Stored.read)


class _Place:
    """A folder that is removed with the last reference to this object, or at exit."""

    def __init__(self, folder: Path) -> None:
        self.path = Path(tempfile.mkdtemp(dir=folder, prefix=_PREFIX))
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)


class _Stored:
    """A sample whose arrays are in files."""

    def __init__(self, place: _Place, number: int, sample: Any) -> None:
        self._place = place
        self._paths: dict[str, Path] = {}
        for field in dataclasses.fields(sample):
            if isinstance(value := getattr(sample, field.name), np.ndarray):
                path = self._paths[field.name] = place.path / f"{number}-{field.name}.npy"
                np.save(path, value)
        self._rest = dataclasses.replace(sample, **dict.fromkeys(self._paths))

    def read(self) -> Any:
        arrays = {
            name: np.asarray(np.load(path, mmap_mode="r")) for name, path in self._paths.items()
        }
        return dataclasses.replace(self._rest, **arrays)
