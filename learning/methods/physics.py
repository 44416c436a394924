"""The simulator alone: the share of simulated noise draws without depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from starling.learning.data.example import Example, Image, check_learnable, known_holes
from starling.learning.data.physics import physics_probability
from starling.learning.methods import model_file
from starling.learning.methods.recalibration import Recalibration, fit_recalibration
from starling.learning.networks.channels import require_physics
from starling.sim.console import progress

_VERSION = 1
_LINE = {"slope": "f0", "offset": "f0"}


@dataclass(frozen=True, slots=True)
class SimulatedPredictor:
    """Simulated probability, optionally recalibrated."""

    recalibration: Recalibration | None = None

    def probability(self, example: Example) -> Image:
        """Estimate the probability (h, w); see `starling.learning.data.physics`.

        Raises:
            InputError: if the example has no physics.
        """
        share = physics_probability(require_physics(example))
        if self.recalibration is None:
            return share
        return self.recalibration(share).astype(np.float32)


@dataclass(frozen=True, kw_only=True, slots=True)
class Simulated:
    """Physics as simulated, or recalibrated on the training scenes."""

    recalibrated: bool = False

    @property
    def name(self) -> str:
        """Name of the method and of its file."""
        return "physics_recalibrated" if self.recalibrated else "physics"

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> SimulatedPredictor:
        """Fit slope and offset of the logit if recalibrated; each scene has the same weight.

        Raises:
            InputError: if the examples cannot be learnt from (`starling.learning.data.example`),
                or one has no physics.
        """
        del seed
        if not self.recalibrated:
            return SimulatedPredictor()
        check_learnable(examples)
        probability, ndp, weight = [], [], []
        for example in track(examples, "physics"):
            holes, counted = known_holes(example)
            probability.append(physics_probability(require_physics(example))[counted])
            ndp.append(holes[counted])
            weight.append(np.full(probability[-1].size, 1 / probability[-1].size))
        line = fit_recalibration(*map(np.concatenate, (probability, ndp, weight)))
        arrays = {"slope": np.array(line.slope), "offset": np.array(line.offset)}
        model_file.write(folder, self.name, _VERSION, arrays)
        return SimulatedPredictor(line)

    def load(self, folder: Path) -> SimulatedPredictor:
        """Load the result of `fit` of the same method.

        Raises:
            InputError: if it is required but missing or damaged.
        """
        if not self.recalibrated:
            return SimulatedPredictor()
        values = model_file.take(model_file.read(folder, self.name, _VERSION), _LINE, folder)
        return SimulatedPredictor(Recalibration(*map(float, values)))
