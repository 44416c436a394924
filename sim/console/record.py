"""The JSON record of a run (versions, arguments, figures), and hashes for caches."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import json
import math
import platform
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

_PACKAGES = ("starling-depth", "mitsuba", "drjit", "numpy", "scipy", "numba", "OpenEXR")
_OPENCV = (  # Four distributions of one library; the one that starling depends on comes first.
    "opencv-contrib-python-headless",
    "opencv-contrib-python",
    "opencv-python-headless",
    "opencv-python",
)


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that results depend on; never fails."""
    opencv = next((name for name in _OPENCV if _version(name)), _OPENCV[0])
    # A package is missing if starling runs from a source tree, or if it is optional.
    packages = {name: _version(name) or "not installed" for name in (*_PACKAGES, opencv)}
    return {"python": platform.python_version(), **packages}


def content(value: Any) -> str:
    """SHA-256 of plain values, arrays and dataclasses, in hexadecimal digits.

    Args:
        value: arrays are hashed by all their elements, other values by their `repr`.
    """
    digest = hashlib.sha256()
    for part in _parts(value):
        digest.update(part)
    return digest.hexdigest()


def _parts(value: Any) -> Iterator[bytes]:
    if isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} ".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield f"{type(value).__name__} ".encode()
        for field in dataclasses.fields(value):
            yield f"{field.name} ".encode()
            yield from _parts(getattr(value, field.name))
    elif isinstance(value, (list, tuple)):
        yield f"{len(value)} ".encode()
        for item in value:
            yield from _parts(item)
    else:
        yield f"{value!r} ".encode()


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def of_run(
    verb: str,
    arguments: Mapping[str, Any],
    figures: Mapping[str, Any] | None = None,
    renderer: Mapping[str, Any] | None = None,
) -> str:
    """Write the record of a run as JSON, with the versions.

    Args:
        verb: the command.
        arguments: the command's arguments, including the seed.
        figures: figures that the command measured; None if it measures none.
        renderer: renderer (see `starling.sim.render.backend.renderer`); None without rendering.
    """
    known = {"verb": verb, "arguments": arguments, "versions": versions()}
    known |= {"renderer": renderer} if renderer else {}
    return dumps(known | ({} if figures is None else {"figures": figures}))


def dumps(value: Any) -> str:
    """Write plain values, arrays and dataclasses as JSON; non-finite numbers become null."""
    return json.dumps(_plain(value), indent=2, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = dataclasses.fields(value)
        return {field.name: _plain(getattr(value, field.name)) for field in fields}
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value
