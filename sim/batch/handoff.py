"""Arrays of other libraries: torch tensors and Warp arrays, on their device."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from starling.patterns import errors


def import_warp() -> Any:
    """Import NVIDIA Warp.

    Raises:
        InputError: if it is not installed.
    """
    first = "warp" not in sys.modules
    try:
        import warp
    except ImportError as error:
        raise errors.needs("Corruptor.batch", "warp-lang", "batch") from error
    if first:  # A program that imported Warp before has chosen itself.
        warp.config.log_level = 40  # Errors only: neither a banner nor a warning without a GPU.
    warp.init()
    return warp


def is_tensor(array: Any) -> bool:
    """Whether an array is a torch tensor; torch is not imported."""
    return type(array).__module__.partition(".")[0] == "torch"


def is_array(array: Any) -> bool:
    """Whether an array is one of those that a batch takes."""
    return is_tensor(array) or isinstance(array, import_warp().array)


def as_warp(name: str, array: Any, device: Any = None) -> Any:
    """Return a Warp array that shares the memory of a torch tensor or a Warp array.

    Args:
        name: name of the array in the user's words.
        array: the array.
        device: where it must be; None for anywhere.

    Raises:
        InputError: if it is neither, or on another device.
    """
    warp = import_warp()
    if not is_array(array):
        remedy = "Corrupt NumPy images by the corruptor itself: corruptor(depth_m)."
        rule = "must be a torch tensor or a Warp array"
        raise errors.refuse(name, rule, type(array).__name__, remedy)
    place = str(array.device) if is_tensor(array) else array.device.alias
    if device is not None and place != device.alias:
        rule = f"must be on {device.alias}, as the depth"
        raise errors.refuse(name, rule, place, "Copy it there first.")
    return warp.from_torch(array.detach()) if is_tensor(array) else array


def like(array: Any, example: Any) -> Any:
    """Return a Warp array as the kind of an example, without a copy."""
    return import_warp().to_torch(array) if is_tensor(example) else array


def stream_of(example: Any) -> AbstractContextManager[Any]:
    """Return a context in which kernels follow earlier work of torch on the same device."""
    if is_tensor(example) and example.is_cuda:
        warp = import_warp()
        return warp.ScopedStream(warp.stream_from_torch(example.device))
    return nullcontext()


def launch(kernel: Any, shape: Any, device: Any, *arguments: Any) -> None:
    """Start a kernel with a thread for each index of `shape`."""
    import_warp().launch(kernel, shape, inputs=arguments, device=device)
