"""Completion methods by name. The packages of a method are imported when it is created."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from starling.learning import shipped
from starling.learning.completion.method import CompletionMethod
from starling.patterns import errors

_CLASSICAL = {  # Module under `starling.learning.completion.classical`, and class.
    "nearest": ("nearest", "Nearest"),
    "morphological": ("morphological", "Morphological"),
    "bilateral": ("bilateral", "Bilateral"),
    "wls": ("wls", "WeightedLeastSquares"),
    "poisson": ("poisson", "Poisson"),
}
_LEARNT = {  # Module under `starling.learning.completion` whose `load` takes a folder of weights.
    "small": "small.method",
    "diffusion": "diffusion.method",
    "marigold": "baselines.marigold",
    "marigold-dc": "baselines.marigold_dc",
    "depth-anything": "baselines.depth_anything",
}
CLASSICAL = tuple(_CLASSICAL)
LEARNT = tuple(_LEARNT)
NAMES = (*CLASSICAL, *LEARNT)


def create(word: str) -> CompletionMethod:
    """Create a method.

    Args:
        word: NAME of `NAMES`. Methods of `LEARNT` are given as NAME=WEIGHTS, a folder or an id on
            the Hugging Face hub. `small` without weights is the network that comes with the
            program.

    Raises:
        InputError: if there is no such method, weights are missing, damaged or not allowed, or
            required packages are not installed.
    """
    name, equals, weights = word.partition("=")
    errors.one_of("method", name, NAMES)
    if name in _CLASSICAL:
        if equals:
            raise errors.refuse(name, "must come without weights", word, "Leave out the =.")
        module, kind = _CLASSICAL[name]
        cls: Any = getattr(import_module(f"starling.learning.completion.classical.{module}"), kind)
        return cls()
    if name == "small" and not equals:
        weights = str(shipped.COMPLETION)
    if not weights:
        raise errors.refuse(name, "must come with weights", word, f"As {name}=FOLDER.")
    try:
        return import_module(f"starling.learning.completion.{_LEARNT[name]}").load(weights)
    except ModuleNotFoundError as error:
        extra = "learning" if name == "small" else "completion"
        raise errors.needs(name, str(error.name), extra) from error
