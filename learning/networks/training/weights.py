"""Files of trained networks: weights, names of the input channels, size of the training images."""

from __future__ import annotations

from pathlib import Path

from torch import nn

from starling.learning.networks import checkpoint
from starling.learning.networks.training.learner import to_device
from starling.patterns.errors import refuse


def path_of(folder: Path, name: str) -> Path:
    """Return the path of a method's weights in its folder."""
    return folder / f"{name}.pt"


def save(
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
    checkpoint.save(path_of(folder, name), name, content)


def load(folder: Path, name: str, network: nn.Module, channels: tuple[str, ...]) -> tuple[int, int]:
    """Load weights into a network and return the (h, w) of the training images.

    Raises:
        InputError: if there are none, the file is damaged, of another version or method, or trained
            on other input channels.
    """
    content = checkpoint.load(path_of(folder, name), name)
    if tuple(content["seen"]) != channels:
        rule = f"must be trained on {', '.join(channels)}"
        raise refuse("checkpoint", rule, ", ".join(content["seen"]), "Train again.")
    checkpoint.restore(network, content["weights"])
    to_device(network).requires_grad_(False).eval()
    height, width = content["shape"]
    return height, width
