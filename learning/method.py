"""The interface of all methods that predict no-depth pixels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from starling.learning.data.example import Example, Image
from starling.sim.console import progress


class Predictor(Protocol):
    """A trained method."""

    def probability(self, example: Example) -> Image:
        """Return the probability (h, w), 0 to 1, that a pixel has no depth. It is never NaN.

        Raises:
            InputError: if the example lacks an input of the method, or has an unsupported image
                size.
        """
        ...


class Method(Protocol):
    """A method that predicts no-depth pixels (NDP)."""

    @property
    def name(self) -> str:
        """Name of the method on the command line of `starling train` and `evaluate`."""
        ...

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> Predictor:
        """Train on scenes with known holes.

        Args:
            examples: at least one, with `ndp` and `counted`.
            folder: folder for models, checkpoints and loss curves; interrupted training continues.
            seed: seed of all random draws.
            track: wraps long loops.

        Raises:
            InputError: if there is no example, an example has no known holes or has only one class
                of pixels; or a loss is not finite (the message names the batch).
        """
        ...

    def load(self, folder: Path) -> Predictor:
        """Load the result of `fit` from a folder.

        Raises:
            InputError: if there is none, it is of another method or version, or damaged.
        """
        ...
