"""The perfect camera without holes, as predicted by a simulator without noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from starling.learning.data.example import Example, Image
from starling.sim.console import progress


@dataclass(frozen=True, slots=True)
class PerfectPredictor:
    """Predicts depth everywhere."""

    def probability(self, example: Example) -> Image:
        """0 everywhere, (h, w)."""
        return np.zeros(example.depth_m.shape, np.float32)


@dataclass(frozen=True, slots=True)
class Perfect:
    """The lower bound for every method; there is nothing to train."""

    name: ClassVar[str] = "perfect"

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> PerfectPredictor:
        """Do nothing; no file is written."""
        del examples, folder, seed, track
        return PerfectPredictor()

    def load(self, folder: Path) -> PerfectPredictor:
        """Return the predictor; no file is read."""
        del folder
        return PerfectPredictor()
