"""The perfect camera: no holes. What a simulator without noise says."""

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
    """Nothing to learn: the lower bound that every method must beat."""

    name: ClassVar[str] = "perfect"

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> PerfectPredictor:
        """Learn nothing, from anything; writes no file."""
        del examples, folder, seed, track
        return PerfectPredictor()

    def load(self, folder: Path) -> PerfectPredictor:
        """Take up what was learnt: nothing."""
        del folder
        return PerfectPredictor()
