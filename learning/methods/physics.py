"""The simulator alone: how often it has no depth when noise is drawn again and again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from starling.learning.data.example import Example, Image
from starling.learning.data.learnable import check_learnable, known_holes
from starling.learning.data.physics_probability import physics_probability
from starling.learning.methods import model_file
from starling.learning.methods.recalibration import Recalibration, fit_recalibration
from starling.learning.networks.training.channels import given_physics
from starling.sim.console import progress

_VERSION = 1
_LINE = ("slope", "offset")


@dataclass(frozen=True, slots=True)
class SimulatedPredictor:
    """What physics tells, put right where that was learnt."""

    recalibration: Recalibration | None = None

    def probability(self, example: Example) -> Image:
        """Smoothed share of the draws without depth, (h, w): `starling.learning.data.physics_probability`.

        Raises:
            InputError: if the example has no physics.
        """
        share = physics_probability(given_physics(example))
        if self.recalibration is None:
            return share
        return self.recalibration(share).astype(np.float32)


@dataclass(frozen=True, kw_only=True, slots=True)
class Simulated:
    """Physics, as it is or with its probabilities put right on the scenes that are learnt from."""

    recalibrated: bool = False

    @property
    def name(self) -> str:
        """What it is called, and its file."""
        return "physics_recalibrated" if self.recalibrated else "physics"

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> SimulatedPredictor:
        """Fit slope and offset of the logit where that was asked for; scenes count alike.

        Raises:
            InputError: if nothing can be learnt from the examples (`starling.learning.data.learnable`), or one
                has no physics.
        """
        del seed
        if not self.recalibrated:
            return SimulatedPredictor()
        check_learnable(examples)
        told, ndp, weight = [], [], []
        for example in track(examples, "physics"):
            holes, counted = known_holes(example)
            told.append(physics_probability(given_physics(example))[counted])
            ndp.append(holes[counted])
            weight.append(np.full(told[-1].size, 1 / told[-1].size))
        line = fit_recalibration(*map(np.concatenate, (told, ndp, weight)))
        arrays = {"slope": np.array(line.slope), "offset": np.array(line.offset)}
        model_file.write(folder, self.name, _VERSION, arrays)
        return SimulatedPredictor(line)

    def load(self, folder: Path) -> SimulatedPredictor:
        """Read what `fit` of the same kind has left in its folder.

        Raises:
            InputError: if there should be something, but is not, or is damaged.
        """
        if not self.recalibrated:
            return SimulatedPredictor()
        found = model_file.take(model_file.read(folder, self.name, _VERSION), _LINE, folder)
        return SimulatedPredictor(Recalibration(*map(float, found)))
