"""Gradient-boosted trees on a pixel's geometry: the honest cheap rival of networks.

Given what is simulated too, they are a hybrid that learns from very few scenes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from starling.learning.data.drawn_pixels import DrawnPixels, draw_pixels, join
from starling.learning.data.example import Example, Image
from starling.learning.data.learnable import check_learnable, known_holes
from starling.learning.features.bins import BINS, equal_count_bins
from starling.learning.features.features import features, names
from starling.learning.methods import model_file
from starling.learning.methods.forest import Forest, forest_of
from starling.learning.methods.recalibration import Recalibration, fit_recalibration
from starling.patterns import errors
from starling.sim.console import progress
from starling.sim.randomness import generator

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier

_VERSION = 1
_PATIENCE = 20  # Trees that may fail to help before no more are tried.
_NODES = ("feature", "threshold", "left", "right", "value", "root")
_OTHERS = ("start", "recalibration", "names", "projector_x_m")


@dataclass(frozen=True, slots=True, eq=False)
class TreesPredictor:
    """Trees, and what puts their probabilities right."""

    forest: Forest
    recalibration: Recalibration
    with_reflectance: bool
    with_physics: bool
    projector_x_m: float | None

    def probability(self, example: Example) -> Image:
        """Measure the features and ask the trees, (h, w).

        Raises:
            InputError: as `starling.learning.features.features.features`.
        """
        seen = features(
            example,
            with_reflectance=self.with_reflectance,
            with_physics=self.with_physics,
            projector_x_m=self.projector_x_m,
        )
        logit = self.forest.logit(seen.values.reshape(-1, len(seen.names)))
        told = self.recalibration(expit(logit))
        return told.reshape(example.depth_m.shape).astype(np.float32)


@dataclass(frozen=True, kw_only=True, slots=True)
class Trees:
    """Histogram gradient boosting (scikit-learn) with its settings.

    Source: Friedman, Greedy function approximation: a gradient boosting machine, Annals of
    Statistics 29, 2001.
    """

    with_reflectance: bool = False  # Sees the smoothed infrared image as well.
    with_physics: bool = False  # Sees what is simulated as well.
    projector_x_m: float | None = (
        None  # As `starling.learning.features.features.features` takes it.
    )
    pixels_per_scene: int = 20_000  # Drawn, at most.
    rounds: int = 400  # Trees, at most; held-out rooms say how many are best.
    rounds_of_one_room: int = 100  # Trees where no other room can say.
    folds: int = 4  # Groups of rooms, each held out once.
    learning_rate: float = 0.05
    leaves: int = 15  # Of one tree, at most.
    pixels_per_leaf: int = 500  # Drawn ones, at least.

    def __post_init__(self) -> None:
        errors.in_interval("pixels_per_scene", self.pixels_per_scene, 2, 10_000_000)
        errors.in_interval("rounds", self.rounds, 1, 10_000)
        errors.in_interval("rounds_of_one_room", self.rounds_of_one_room, 1, 10_000)
        errors.in_interval("folds", self.folds, 2, 1000)
        errors.in_interval("learning_rate", self.learning_rate, 1e-4, 1.0)
        errors.in_interval("leaves", self.leaves, 2, 4096)
        errors.in_interval("pixels_per_leaf", self.pixels_per_leaf, 1, 1_000_000)

    @property
    def name(self) -> str:
        """What it is called, and its file."""
        name = "hybrid_trees" if self.with_physics else "trees"
        return f"{name}_reflectance" if self.with_reflectance else name

    def fit(
        self,
        examples: Sequence[Example],
        *,
        folder: Path,
        seed: int,
        track: progress.Progress = progress.silent,
    ) -> TreesPredictor:
        """Learn in one go and leave the trees in the folder, in the place of older ones.

        Groups of rooms are held out in turn: how many trees serve them best, and how far their
        probabilities are off, is then used for the trees that learn from all rooms. From one room
        alone neither can be known: a fixed number of trees, told as they are.

        Raises:
            InputError: if nothing can be learnt from the examples (`starling.learning.data.learnable`), or one
                lacks what the features need.
        """
        check_learnable(examples)
        drawn = join([self._drawn(example, seed) for example in track(examples, "features")])
        bins = equal_count_bins(drawn.values)
        pixels = dataclasses.replace(drawn, values=bins.numbers(drawn.values).astype(np.float32))
        rounds, recalibration = self._held_out(pixels, seed, track)
        model = self._boosted(rounds, seed)
        model.fit(pixels.values, pixels.ndp, sample_weight=pixels.weight)
        learnt = TreesPredictor(
            forest=bins.in_units(forest_of(model)),
            recalibration=recalibration,
            with_reflectance=self.with_reflectance,
            with_physics=self.with_physics,
            projector_x_m=self.projector_x_m,
        )
        model_file.write(folder, self.name, _VERSION, _arrays(learnt))
        return learnt

    def load(self, folder: Path) -> TreesPredictor:
        """Read what `fit` of the same kind has left in its folder.

        Raises:
            InputError: if there is nothing, or it is damaged or of another version, or learnt from
                other features than are measured now.
        """
        arrays = model_file.read(folder, self.name, _VERSION)
        *nodes, start, line, known, place = model_file.take(arrays, (*_NODES, *_OTHERS), folder)
        forest = Forest(*nodes, start=float(start))
        learnt_names = tuple(str(name) for name in known)
        seen = names(with_reflectance=self.with_reflectance, with_physics=self.with_physics)
        if learnt_names != seen:
            raise errors.refuse(
                "trees",
                "must be learnt from the features that are measured now",
                f"others in {folder}",
                "Train again with this version.",
            )
        if not forest.is_sound(len(learnt_names)):
            raise errors.refuse("model", "must be whole", folder, "It is damaged: train again.")
        return TreesPredictor(
            forest=forest,
            recalibration=Recalibration(*map(float, line)),
            with_reflectance=self.with_reflectance,
            with_physics=self.with_physics,
            projector_x_m=None if np.isnan(place) else float(place),
        )

    def _drawn(self, example: Example, seed: int) -> DrawnPixels:
        ndp, counted = known_holes(example)
        seen = features(
            example,
            with_reflectance=self.with_reflectance,
            with_physics=self.with_physics,
            projector_x_m=self.projector_x_m,
        )
        return draw_pixels(
            seen.values,
            ndp,
            counted,
            room=example.room,
            most=self.pixels_per_scene,
            rng=generator(seed, 0, "learning", f"trees {example.scene}"),
        )

    def _held_out(
        self, pixels: DrawnPixels, seed: int, track: progress.Progress
    ) -> tuple[int, Recalibration]:
        """Number of trees and recalibration that suit rooms which were not learnt from."""
        rooms = generator(seed, 0, "learning", "folds").permutation(np.unique(pixels.room))
        best: list[int] = []
        forests: list[tuple[Forest, NDArray[np.bool_]]] = []
        for fold in track(np.array_split(rooms, min(self.folds, len(rooms))), "held-out rooms"):
            out = np.isin(pixels.room, fold)
            others, held = pixels.where(~out), pixels.where(out)
            if others.ndp.all() or not others.ndp.any():
                continue  # These rooms alone teach nothing.
            model = self._boosted(self.rounds, seed)
            model.set_params(early_stopping=True, n_iter_no_change=_PATIENCE)
            model.fit(
                others.values,
                others.ndp,
                sample_weight=others.weight,
                X_val=held.values,
                y_val=held.ndp,
                sample_weight_val=held.weight,
            )
            best.append(max(1, int(np.argmax(model.validation_score_))))
            forests.append((forest_of(model), out))
        known = np.any([out for _, out in forests], axis=0)
        if not forests or pixels.ndp[known].all() or not pixels.ndp[known].any():
            return self.rounds_of_one_room, Recalibration()
        rounds = round(float(np.median(best)))
        told = np.zeros(len(pixels.ndp))
        for forest, out in forests:
            told[out] = expit(forest.first(rounds).logit(pixels.values[out]))
        return rounds, fit_recalibration(told[known], pixels.ndp[known], pixels.weight[known])

    def _boosted(self, rounds: int, seed: int) -> HistGradientBoostingClassifier:
        from sklearn.ensemble import HistGradientBoostingClassifier

        model = HistGradientBoostingClassifier(
            learning_rate=self.learning_rate,
            max_iter=rounds,
            max_leaf_nodes=self.leaves,
            min_samples_leaf=self.pixels_per_leaf,
            max_bins=BINS,
            random_state=seed,
        )
        return model.set_params(early_stopping=False)


def _arrays(learnt: TreesPredictor) -> dict[str, NDArray]:
    place = learnt.projector_x_m
    line = learnt.recalibration
    return {
        **{name: getattr(learnt.forest, name) for name in _NODES},
        "start": np.array(learnt.forest.start),
        "recalibration": np.array([line.slope, line.offset]),
        "names": np.array(
            names(with_reflectance=learnt.with_reflectance, with_physics=learnt.with_physics)
        ),
        "projector_x_m": np.array(np.nan if place is None else place),
    }
