"""Cache files of simulations, which take longer than training steps."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning.data.example import Physics
from starling.learning.methods import model_file

_VERSION = 3


def write(folder: Path, key: str, physics: Physics) -> None:
    """Write a simulation atomically under a key that identifies its inputs.

    Raises:
        InputError: if the file cannot be written.
    """
    fields = dataclasses.fields(Physics)
    arrays = {field.name: np.asarray(getattr(physics, field.name)) for field in fields}
    model_file.write(folder, key, _VERSION, arrays)


def read(folder: Path, key: str) -> Physics | None:
    """Read a simulation by its key; None if it is not in the cache.

    Raises:
        InputError: if the file is damaged or of another version.
    """
    if not model_file.path_of(folder, key).is_file():
        return None
    names = tuple(field.name for field in dataclasses.fields(Physics))
    arrays = model_file.take(model_file.read(folder, key, _VERSION), names, folder)
    values: dict[str, Any] = dict(zip(names, arrays, strict=True))
    values["draws"] = int(values["draws"])
    return Physics(**values)
