"""The file a trained network is kept in: its weights, what it sees, and the size learnt from."""

from __future__ import annotations

from pathlib import Path

from torch import nn

from starling.learning.networks import checkpoint
from starling.learning.networks.training.learner import placed
from starling.patterns.errors import refuse


def path_of(folder: Path, name: str) -> Path:
    """Where the weights of a method lie in its folder."""
    return folder / f"{name}.pt"


def save(
    folder: Path, name: str, network: nn.Module, seen: tuple[str, ...], shape: tuple[int, int]
) -> None:
    """Keep a network.

    Args:
        folder: made where it is missing.
        name: the method's.
        network: its weights are kept.
        seen: names of the channels it sees.
        shape: (h, w) of the images learnt from.

    Raises:
        InputError: if the file cannot be written.
    """
    content = {"weights": network.state_dict(), "seen": list(seen), "shape": list(shape)}
    checkpoint.save(path_of(folder, name), name, content)


def load(folder: Path, name: str, network: nn.Module, seen: tuple[str, ...]) -> tuple[int, int]:
    """Put kept weights into a network, ready for use, and give the (h, w) learnt from.

    Raises:
        InputError: if there are none, the file is damaged, of another version or method, or learnt
            from other channels than are seen now.
    """
    content = checkpoint.load(path_of(folder, name), name)
    if tuple(content["seen"]) != seen:
        rule = f"must have learnt from {', '.join(seen)}"
        raise refuse("checkpoint", rule, ", ".join(content["seen"]), "Train again.")
    checkpoint.restore(network, content["weights"])
    placed(network).requires_grad_(False).eval()
    height, width = content["shape"]
    return height, width
