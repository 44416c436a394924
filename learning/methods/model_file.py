"""Files of trained models: plain arrays in one NumPy archive.

Pickles run arbitrary code when loaded and depend on the version of the library that wrote them
(scikit-learn user guide, Model persistence). Plain arrays do neither.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim.console import output

Arrays = Mapping[str, NDArray]

_KIND, _VERSION = "kind", "version"


def path_of(folder: Path, kind: str) -> Path:
    """Return the path of a model in its folder."""
    return folder / f"{kind}.npz"


def write(folder: Path, kind: str, version: int, arrays: Arrays) -> Path:
    """Write a model atomically, replacing an older one.

    Args:
        folder: created if missing.
        kind: name of the method.
        version: version of the arrays' meaning; increase it when that changes.
        arrays: arrays without Python objects.

    Raises:
        InputError: if the file cannot be written.
    """
    buffer = io.BytesIO()
    content = {_KIND: np.array(kind), _VERSION: np.array(version), **arrays}
    np.savez_compressed(buffer, allow_pickle=False, **content)
    path = path_of(folder, kind)
    output.write_file(path, buffer.getvalue(), force=True)
    return path


def read(folder: Path, kind: str, version: int) -> dict[str, NDArray]:
    """Read the arrays of a model.

    Raises:
        InputError: if there is none, it is damaged, or of another kind or version.
    """
    path = path_of(folder, kind)
    if not path.is_file():
        raise refuse("model", "must exist", path, f"Train {kind} into this folder first.")
    try:
        with warnings.catch_warnings():  # NumPy warns of odd headers.
            warnings.simplefilter("ignore")
            with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
        got = str(arrays.pop(_KIND)), int(arrays.pop(_VERSION))
    except Exception as error:  # Damaged files raise errors of many types.
        raise refuse("model", "must be whole", path, "It is damaged: train again.") from error
    if got != (kind, version):
        raise refuse(
            "model",
            f"must be {kind} of version {version}",
            f"{got[0]} of version {got[1]} in {path}",
            "Train again with this version.",
        )
    return arrays


def take(arrays: Mapping[str, Any], kinds: Mapping[str, str], folder: Path) -> list[NDArray]:
    """Select arrays by name.

    Args:
        arrays: result of `read`.
        kinds: by name, the kind of the values as in `numpy.dtype.kind`, and the number of
            dimensions: `f2`.
        folder: folder of the model, for messages.

    Raises:
        InputError: if one is missing, or of another kind or number of dimensions.
    """
    for name, kind in kinds.items():
        array = arrays.get(name)
        if not isinstance(array, np.ndarray) or not _computable(array.dtype):
            actual = None  # A damaged member can be bytes.
        else:
            actual = f"{array.dtype.kind}{array.ndim}"
        if actual != kind:
            value = (
                f"{folder} with another {name}" if name in arrays else f"{folder} without {name}"
            )
            raise refuse("model", "must be whole", value, "It is damaged: train again.")
    return [arrays[name] for name in kinds]


def _computable(dtype: np.dtype[Any]) -> bool:
    """Return whether compiled code computes with the type; half and long floats have no kernel."""
    return dtype.isnative and (dtype.kind != "f" or dtype.itemsize in (4, 8))
