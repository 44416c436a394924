"""Files of weights. They are written atomically and refused if they do not fit."""

from __future__ import annotations

import io
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import nn

from starling.learning.networks.device import to_device
from starling.patterns.errors import naming, refuse
from starling.sim.console import output

VERSION = 1  # Version of the file's content; other versions are refused.
_FORMAT = "starling weights"
_RETRAIN = "Train again in an empty folder."


def save(path: Path, kind: str, content: Mapping[str, Any]) -> None:
    """Write tensors, numbers, texts, and lists and dictionaries of them.

    Args:
        path: output file; an existing file is replaced atomically.
        kind: kind of the file, which `load` checks.
        content: content that `load` returns.

    Raises:
        InputError: if it cannot be written.
    """
    buffer = io.BytesIO()
    whole = {"format": _FORMAT, "version": VERSION, "kind": kind, "content": dict(content)}
    torch.save(whole, buffer)
    output.write_file(path, buffer.getvalue(), force=True)


def load(path: Path, kind: str, entries: Mapping[str, type]) -> dict[str, Any]:
    """Read a file written by `save`. The file can hold data only, no code.

    Args:
        path: the file.
        kind: kind of the file, as passed to `save`.
        entries: type of each entry that the content must have.

    Raises:
        InputError: if it is missing, damaged, another file, of another version or kind, or lacks an
            entry.
    """
    try:
        with zipfile.ZipFile(path) as archive:  # torch does not verify checksums.
            if damaged := archive.testzip():
                raise zipfile.BadZipFile(damaged)
        with warnings.catch_warnings():  # torch warns of old kinds of data.
            warnings.simplefilter("ignore")
            whole = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise refuse("checkpoint", "must exist", path, "Train first.") from None
    except Exception as error:  # Damaged files raise errors of many types.
        rule = "must be a complete file of trained weights"
        raise refuse("checkpoint", rule, f"{path} ({type(error).__name__})", _RETRAIN) from error
    # A tensor compares element by element, so types are compared first.
    if not isinstance(whole, dict) or not _equal(whole.get("format"), _FORMAT):
        raise refuse("checkpoint", "must be written by this program", path, _RETRAIN)
    if not _equal(whole.get("version"), VERSION):
        got = f"{whole.get('version')!r} in {path}"
        raise refuse("checkpoint version", f"must be {VERSION}", got, _RETRAIN)
    if not _equal(whole.get("kind"), kind):
        got = f"{whole.get('kind')!r} in {path}"
        raise refuse("checkpoint", f"must be of {kind!r}", got, "Name the right file.")
    content = whole.get("content")
    for name, expected in entries.items():
        value = content.get(name) if isinstance(content, dict) else None
        if not isinstance(value, expected):
            got = f"{type(value).__name__} in {path}"
            raise refuse(
                "checkpoint", f"must have {name} of type {expected.__name__}", got, _RETRAIN
            )
    return whole["content"]


def _equal(value: object, expected: object) -> bool:
    return type(value) is type(expected) and value == expected


def restore(network: nn.Module, weights: Mapping[str, torch.Tensor]) -> None:
    """Copy weights into a network. Names and shapes must be equal.

    Raises:
        InputError: if a name or a shape differs, or a weight is no plain tensor of finite numbers.
    """
    wanted = network.state_dict()
    for name in sorted(wanted.keys() | weights.keys(), key=str):
        shape = tuple(wanted[name].shape) if name in wanted else None
        present = _describe(weights[name], wanted.get(name)) if name in weights else None
        if shape != present:
            raise refuse("checkpoint", f"must have {name} of shape {shape}", present, _RETRAIN)
    network.load_state_dict(dict(weights))


def _describe(value: object, wanted: torch.Tensor | None) -> tuple[int, ...] | str:
    """Return the shape of a weight, or what makes it unfit."""
    if (
        not isinstance(value, torch.Tensor)
        or value.layout != torch.strided
        or value.device.type == "meta"
        or value.is_quantized
        or value.is_complex()
    ):
        return "no plain tensor"
    if wanted is None:
        return tuple(value.shape)
    if value.is_floating_point() != wanted.is_floating_point():
        return f"numbers of type {value.dtype}"  # Conversion to whole numbers loses all weights.
    if not torch.isfinite(value.to(wanted.dtype)).all():
        return "numbers that are not finite"
    return tuple(value.shape)


def restore_optimizer(optimizer: torch.optim.Optimizer, state: dict[str, Any]) -> None:
    """Copy a state into an optimizer.

    Raises:
        InputError: if the state is of another optimizer or damaged.
    """
    try:
        optimizer.load_state_dict(state)
    except Exception as error:  # A foreign state raises errors of many types.
        got = f"{type(error).__name__}: {error}"
        raise refuse("checkpoint", "must fit its optimizer", got, _RETRAIN) from error


def network_path(folder: Path, name: str) -> Path:
    """Return the path of a method's weights in its folder."""
    return folder / f"{name}.pt"


def save_network(
    folder: Path, name: str, network: nn.Module, channels: tuple[str, ...], shape: tuple[int, int]
) -> None:
    """Save a network.

    Args:
        folder: created if missing.
        name: name of the method.
        network: the network.
        channels: names of its input channels.
        shape: (h, w) of the training images.

    Raises:
        InputError: if the file cannot be written.
    """
    content = {"weights": network.state_dict(), "seen": list(channels), "shape": list(shape)}
    save(network_path(folder, name), name, content)


def load_network(
    folder: Path, name: str, network: nn.Module, channels: tuple[str, ...]
) -> tuple[int, int]:
    """Load weights into a network and return the (h, w) of the training images.

    Raises:
        InputError: if there are none, the file is damaged, of another version or method, or trained
            on other input channels.
    """
    entries = {"weights": dict, "seen": list, "shape": list}
    path = network_path(folder, name)
    content = load(path, name, entries)
    seen, shape = content["seen"], content["shape"]
    with naming(path):
        if tuple(seen) != channels:
            rule = f"must be trained on {', '.join(channels)}"
            raise refuse("checkpoint", rule, ", ".join(map(str, seen)), "Train again.")
        if not (len(shape) == 2 and all(type(side) is int for side in shape)):
            raise refuse("checkpoint", "must have shape [h, w]", shape, _RETRAIN)
        restore(network, content["weights"])
    to_device(network).requires_grad_(False).eval()
    height, width = shape
    return height, width
