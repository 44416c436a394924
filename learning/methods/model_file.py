"""What a method has learnt, as plain arrays in one NumPy archive.

Not a pickle: loading one runs whatever its writer put in, and it binds the file to the version of
the library that wrote it (scikit-learn user guide, Model persistence). Plain arrays do neither.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim.console import output

Arrays = Mapping[str, NDArray]

_KIND, _VERSION = "kind", "version"
_DAMAGED = (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile, zlib.error)


def path_of(folder: Path, kind: str) -> Path:
    """Where the model of one kind lies in its folder."""
    return folder / f"{kind}.npz"


def write(folder: Path, kind: str, version: int, arrays: Arrays) -> Path:
    """Write a model whole or not at all, in the place of an older one.

    Args:
        folder: made where it is missing.
        kind: the method's name.
        version: of the arrays' meaning: raise it when that changes.
        arrays: no arrays of Python objects.

    Raises:
        InputError: if the file cannot be written.
    """
    held = io.BytesIO()
    named = {_KIND: np.array(kind), _VERSION: np.array(version), **arrays}
    np.savez_compressed(held, allow_pickle=False, **named)
    path = path_of(folder, kind)
    output.write_file(path, held.getvalue(), force=True)
    return path


def read(folder: Path, kind: str, version: int) -> dict[str, NDArray]:
    """Read a model's arrays.

    Raises:
        InputError: if there is none, it is damaged, or of another kind or version.
    """
    path = path_of(folder, kind)
    if not path.is_file():
        raise refuse("model", "must exist", path, f"Train {kind} into this folder first.")
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        found = str(arrays.pop(_KIND)), int(arrays.pop(_VERSION))
    except _DAMAGED as error:
        raise refuse("model", "must be whole", path, "It is damaged: train again.") from error
    if found != (kind, version):
        raise refuse(
            "model",
            f"must be {kind} of version {version}",
            f"{found[0]} of version {found[1]} in {path}",
            "Train again with this version.",
        )
    return arrays


def take(arrays: dict[str, NDArray], names: tuple[str, ...], folder: Path) -> list[NDArray]:
    """Take arrays out by name.

    Raises:
        InputError: if one is missing.
    """
    missing = [name for name in names if name not in arrays]
    if missing:
        raise refuse(
            "model",
            "must be whole",
            f"{folder} without {missing[0]}",
            "It is damaged: train again.",
        )
    return [arrays[name] for name in names]
