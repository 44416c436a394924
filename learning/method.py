"""The one interface of all methods: learn from scenes, then say where depth will be missing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from starling.learning.data.example import Example, Image
from starling.sim.console import progress


class Predictor(Protocol):
    """A method that has learnt."""

    def probability(self, example: Example) -> Image:
        """Probability (h, w), 0 to 1, that a pixel has no depth. NaN nowhere.

        Raises:
            InputError: if the example lacks what the method needs, or has another image size than
                it can take.
        """
        ...


class Method(Protocol):
    """A way to predict no-depth pixels (NDP)."""

    @property
    def name(self) -> str:
        """What it is called by `starling train` and `evaluate`."""
        ...

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> Predictor:
        """Learn from scenes whose holes are known.

        Args:
            examples: at least one, with `ndp` and `counted`.
            folder: where models, checkpoints and loss curves go; a training that was cut short is
                gone on with.
            seed: fixes everything that is drawn.
            track: wraps loops that take long.

        Raises:
            InputError: no example, one without holes' truth, all or no pixel without depth, or a
                loss that is no number (says at which batch).
        """
        ...

    def load(self, folder: Path) -> Predictor:
        """Read back what `fit` left in a folder.

        Raises:
            InputError: nothing there, of another method or version, or damaged.
        """
        ...
