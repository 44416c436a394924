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
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(array, torch.Tensor)


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
    if not is_array(array):
        remedy = "Corrupt NumPy images by the corruptor itself: corruptor(depth_m)."
        rule = "must be a torch tensor or a Warp array"
        raise errors.refuse(name, rule, type(array).__name__, remedy)
    place = str(array.device) if is_tensor(array) else array.device.alias
    if device is not None and place != device.alias:
        rule = f"must be on {device.alias}, as the depth"
        raise errors.refuse(name, rule, place, "Copy it there first.")
    return _shared(name, array) if is_tensor(array) else array


def _shared(name: str, tensor: Any) -> Any:
    """Return a Warp array that shares the memory of a tensor; a lazy sign is resolved first.

    Raises:
        InputError: if Warp has no such array: of complex or sparse tensors, or of single numbers.
    """
    warp, rule = import_warp(), "must be a dense tensor of real numbers on the CPU or a GPU"
    try:
        if tensor.ndim:
            return warp.from_torch(tensor.detach().resolve_neg())
        error = "a single number"
    except (TypeError, RuntimeError, AttributeError) as reason:
        error = f"{reason}"
    got = f"{tensor.dtype} {tensor.layout} on {tensor.device}, {error}"
    raise errors.refuse(name, rule, got, "Convert it; give a single number as float.")


def refusal(
    name: str, rule: str, array: Any, remedy: str, *, kinds: tuple[str, ...] = ("float32",)
) -> errors.InputError:
    """Build (not raise) the error for a Warp array of another type or shape.

    Args:
        name: name of the array in the user's words.
        rule: its type and shape.
        array: the Warp array.
        remedy: advice where only the shape differs.
        kinds: types that the rule allows.
    """
    kind = array.dtype.__name__
    advice = remedy if kind in kinds else "Convert it to float32."
    return errors.refuse(name, rule, f"{tuple(array.shape)} {kind}", advice)


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
