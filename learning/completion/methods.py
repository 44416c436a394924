"""Completion methods by name. The packages of a method are imported when it is created."""

from __future__ import annotations

from importlib import import_module

from starling.learning import shipped
from starling.learning.completion.method import CompletionMethod
from starling.patterns import errors

# Functions of `starling.learning.completion.classical`.
CLASSICAL = ("nearest", "morphological", "bilateral", "wls", "poisson")
_LEARNT = {  # Module under `starling.learning.completion` whose `load` takes a folder of weights.
    "small": "small.method",
    "diffusion": "diffusion.method",
    "marigold": "baselines.marigold",
    "marigold-dc": "baselines.marigold_dc",
    "depth-anything": "baselines.depth_anything",
}
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
    errors.instance("method", word, str, f"Known: {', '.join(NAMES)}.")
    name, equals, weights = word.partition("=")
    errors.one_of("method", name, NAMES)
    if name in CLASSICAL:
        if equals:
            raise errors.refuse(name, "must come without weights", word, "Leave out the =.")
        from starling.learning.completion.classical import Classical

        return Classical(name)
    if name == "small" and not equals:
        weights = str(shipped.COMPLETION)
    if not weights:
        raise errors.refuse(name, "must come with weights", word, f"As {name}=FOLDER.")
    try:
        return import_module(f"starling.learning.completion.{_LEARNT[name]}").load(weights)
    except ModuleNotFoundError as error:
        extra = "learning" if name == "small" else "completion"
        raise errors.needs(name, str(error.name), extra) from error
