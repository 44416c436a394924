"""Files of learnt weights: written whole or not at all, and refused where they do not fit."""

from __future__ import annotations

import io
import pickle
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import nn

from starling.patterns.errors import refuse
from starling.sim.console import output

VERSION = 1  # Of what the files hold; another one is refused.
_DAMAGED = (
    OSError,
    RuntimeError,
    EOFError,
    ValueError,
    KeyError,
    zipfile.BadZipFile,
    pickle.UnpicklingError,
)
_FORMAT = "starling weights"
_NEWLY = "Train again in an empty folder."


def save(path: Path, kind: str, content: Mapping[str, Any]) -> None:
    """Write tensors, numbers, texts, lists and dictionaries of them.

    Args:
        path: replaced where it exists; a kill leaves the old file or the new one.
        kind: what the file is, which `load` asks for.
        content: what `load` gives back.

    Raises:
        InputError: if it cannot be written.
    """
    buffer = io.BytesIO()
    whole = {"format": _FORMAT, "version": VERSION, "kind": kind, "content": dict(content)}
    torch.save(whole, buffer)
    output.write_file(path, buffer.getvalue(), force=True)


def load(path: Path, kind: str) -> dict[str, Any]:
    """Read what `save` wrote; the file can hold data only, never code.

    Raises:
        InputError: if it is missing, truncated, no such file, or of another version or kind.
    """
    try:
        with zipfile.ZipFile(path) as archive:  # torch itself reads past wrong check sums.
            if damaged := archive.testzip():
                raise zipfile.BadZipFile(damaged)
        whole = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise refuse("checkpoint", "must exist", path, "Train first.") from None
    except _DAMAGED as error:
        rule = "must be a whole file of learnt weights"
        raise refuse("checkpoint", rule, f"{path} ({type(error).__name__})", _NEWLY) from error
    if not isinstance(whole, dict) or whole.get("format") != _FORMAT:
        raise refuse("checkpoint", "must be written by this program", path, _NEWLY)
    if whole.get("version") != VERSION:
        found = f"{whole.get('version')!r} in {path}"
        raise refuse("checkpoint version", f"must be {VERSION}", found, _NEWLY)
    if whole.get("kind") != kind:
        found = f"{whole.get('kind')!r} in {path}"
        raise refuse("checkpoint", f"must be of {kind!r}", found, "Name the right file.")
    return whole["content"]


def restore(network: nn.Module, weights: Mapping[str, torch.Tensor]) -> None:
    """Copy weights into a network that they fit exactly.

    Raises:
        InputError: if a name or a shape differs.
    """
    wanted = {name: tuple(value.shape) for name, value in network.state_dict().items()}
    given = {name: tuple(value.shape) for name, value in weights.items()}
    for name in sorted(wanted.keys() | given.keys()):
        if wanted.get(name) != given.get(name):
            rule = f"must have {name} of shape {wanted.get(name)}"
            raise refuse("checkpoint", rule, given.get(name), _NEWLY)
    network.load_state_dict(dict(weights))
