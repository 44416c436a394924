"""Gradient-boosted trees on the geometry of a pixel, a cheap baseline for networks.

With the simulation as further features, they are a hybrid that learns from very few scenes.
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

from starling.learning.data.example import Example, Image, Mask, check_learnable, known_holes
from starling.learning.features.features import features, names
from starling.learning.methods import model_file
from starling.learning.methods.forest import BINS, Forest, equal_count_bins, forest_of
from starling.learning.methods.recalibration import Recalibration, fit_recalibration
from starling.patterns import errors
from starling.sim.console import progress
from starling.sim.randomness import generator

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingClassifier


@dataclass(frozen=True, slots=True, eq=False)
class DrawnPixels:
    """Pixels of one or more scenes."""

    values: NDArray[np.float32]  # (n, k) features.
    ndp: NDArray[np.bool_]  # (n,)
    weight: NDArray[np.float64]  # (n,) above 0; the sum is the same for each scene.
    room: NDArray[np.str_]  # (n,)

    def where(self, chosen: NDArray[np.bool_]) -> DrawnPixels:
        """Select pixels; weights do not change."""
        return DrawnPixels(
            self.values[chosen], self.ndp[chosen], self.weight[chosen], self.room[chosen]
        )


def draw_pixels(
    values: NDArray[np.float32],
    ndp: Mask,
    counted: Mask,
    *,
    room: str,
    most: int,
    rng: np.random.Generator,
) -> DrawnPixels:
    """Draw pixels of one scene, equally many with and without depth where possible.

    Holes are a few percent of a scene, so that uniform draws would mostly be uninformative. Each
    kind is weighted back to its share, so that trained probabilities are unbiased.

    Args:
        values: (h, w, k) features.
        ndp: (h, w) no-depth pixels.
        counted: (h, w), at least one True.
        room: room of the scene.
        most: greatest number of pixels, > 1.
        rng: random generator; draws are without replacement.

    Returns:
        The pixels; their weights sum to their number.
    """
    kinds = [np.flatnonzero(counted & ndp), np.flatnonzero(counted & ~ndp)]
    rarer = min(len(kinds[0]), len(kinds[1]), most // 2)
    numbers = [min(len(kind), most - rarer) for kind in kinds]
    drawn = [
        rng.choice(kind, number, replace=False) for kind, number in zip(kinds, numbers, strict=True)
    ]
    each = [len(kind) / max(number, 1) for kind, number in zip(kinds, numbers, strict=True)]
    pixels, weight = np.concatenate(drawn), np.repeat(each, numbers)
    return DrawnPixels(
        values=values.reshape(-1, values.shape[-1])[pixels],
        ndp=ndp.reshape(-1)[pixels],
        weight=weight * (len(weight) / weight.sum()),
        room=np.full(len(pixels), room),
    )


def join(scenes: Sequence[DrawnPixels]) -> DrawnPixels:
    """Concatenate scenes, each with the same sum of weights."""
    pixels = sum(len(scene.ndp) for scene in scenes)
    return DrawnPixels(
        values=np.concatenate([scene.values for scene in scenes]),
        ndp=np.concatenate([scene.ndp for scene in scenes]),
        weight=np.concatenate(
            [scene.weight * (pixels / len(scenes) / scene.weight.sum()) for scene in scenes]
        ),
        room=np.concatenate([scene.room for scene in scenes]),
    )


_VERSION = 1
_PATIENCE = 20  # Trees without improvement before boosting stops.
# Arrays of a model's file (see `model_file.take`).
_NODES = {
    **{"feature": "i1", "threshold": "f1", "left": "i1", "right": "i1", "value": "f1"},
    "root": "i1",
}
_OTHERS = {"start": "f0", "recalibration": "f1", "projector_x_m": "f0"}


@dataclass(frozen=True, slots=True, eq=False)
class TreesPredictor:
    """Trees with the recalibration of their probabilities."""

    forest: Forest
    recalibration: Recalibration
    with_reflectance: bool
    with_physics: bool
    projector_x_m: float | None

    def probability(self, example: Example) -> Image:
        """Evaluate the trees, (h, w).

        Raises:
            InputError: see `starling.learning.features.features.features`.
        """
        inputs = features(
            example,
            with_reflectance=self.with_reflectance,
            with_physics=self.with_physics,
            projector_x_m=self.projector_x_m,
        )
        logit = self.forest.logit(inputs.values.reshape(-1, len(inputs.names)))
        probability = self.recalibration(expit(logit))
        return probability.reshape(example.depth_m.shape).astype(np.float32)


@dataclass(frozen=True, kw_only=True, slots=True)
class Trees:
    """Histogram gradient boosting (scikit-learn) with its settings.

    Source: Friedman, Greedy function approximation: a gradient boosting machine, Annals of
    Statistics 29, 2001.
    """

    with_reflectance: bool = False  # Also uses the smoothed infrared image.
    with_physics: bool = False  # Also uses the simulation.
    # Position of the projector, see `starling.learning.features.features.features`.
    projector_x_m: float | None = None
    pixels_per_scene: int = 20_000  # Greatest number of pixels drawn from a scene.
    pixels: int = 2_000_000  # Greatest number of pixels drawn from all scenes.
    rounds: int = 400  # Greatest number of trees; held-out rooms determine the best number.
    rounds_of_one_room: int = 100  # Number of trees without held-out rooms.
    folds: int = 4  # Groups of rooms, each held out once.
    learning_rate: float = 0.05
    leaves: int = 15  # Greatest number of leaves of a tree.
    pixels_per_leaf: int = 500  # Least number of drawn pixels of a leaf.

    def __post_init__(self) -> None:
        errors.in_interval("pixels_per_scene", self.pixels_per_scene, 2, 10_000_000)
        errors.in_interval("pixels", self.pixels, 2, 1_000_000_000)
        errors.in_interval("rounds", self.rounds, 1, 10_000)
        errors.in_interval("rounds_of_one_room", self.rounds_of_one_room, 1, 10_000)
        errors.in_interval("folds", self.folds, 2, 1000)
        errors.in_interval("learning_rate", self.learning_rate, 1e-4, 1.0)
        errors.in_interval("leaves", self.leaves, 2, 4096)
        errors.in_interval("pixels_per_leaf", self.pixels_per_leaf, 1, 1_000_000)

    @property
    def name(self) -> str:
        """Name of the method and of its file."""
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
        """Train, and save the trees to the folder, replacing older ones.

        Groups of rooms are held out in turn. They determine the best number of trees and the
        recalibration, which are then used for trees trained on all rooms. With one room, neither
        can be determined: the number of trees is fixed, without recalibration.

        Raises:
            InputError: if the examples cannot be learnt from (`starling.learning.data.example`),
                or one lacks an input of the features.
        """
        check_learnable(examples)
        most = min(self.pixels_per_scene, max(2, self.pixels // len(examples)))
        drawn = join([self._drawn(example, most, seed) for example in track(examples, "features")])
        bins = equal_count_bins(drawn.values)
        pixels = dataclasses.replace(drawn, values=bins.numbers(drawn.values).astype(np.float32))
        rounds, recalibration = self._held_out(pixels, seed, track)
        model = self._boosted(rounds, seed)
        model.fit(pixels.values, pixels.ndp, sample_weight=pixels.weight)
        predictor = TreesPredictor(
            forest=bins.in_units(forest_of(model)),
            recalibration=recalibration,
            with_reflectance=self.with_reflectance,
            with_physics=self.with_physics,
            projector_x_m=self.projector_x_m,
        )
        model_file.write(folder, self.name, _VERSION, _arrays(predictor))
        return predictor

    def load(self, folder: Path) -> TreesPredictor:
        """Load the result of `fit` of the same method.

        Raises:
            InputError: if there is none, or it is damaged, of another version, or trained on other
                features.
        """
        arrays = model_file.read(folder, self.name, _VERSION)
        (known,) = model_file.take(arrays, {"names": "U1"}, folder)
        learnt_names = tuple(str(name) for name in known)
        inputs = names(with_reflectance=self.with_reflectance, with_physics=self.with_physics)
        if learnt_names != inputs:
            raise errors.refuse(
                "trees",
                "must be trained on the features of this version",
                f"others in {folder}",
                "Train again with this version.",
            )
        nodes = model_file.take(arrays, _NODES, folder)
        start, line, place = model_file.take(arrays, _OTHERS, folder)
        forest = Forest(*nodes, start=float(start))
        if not forest.is_sound(len(learnt_names)) or line.shape != (2,):
            raise errors.refuse("model", "must be whole", folder, "It is damaged: train again.")
        return TreesPredictor(
            forest=forest,
            recalibration=Recalibration(*map(float, line)),
            with_reflectance=self.with_reflectance,
            with_physics=self.with_physics,
            projector_x_m=None if np.isnan(place) else float(place),
        )

    def _drawn(self, example: Example, most: int, seed: int) -> DrawnPixels:
        ndp, counted = known_holes(example)
        inputs = features(
            example,
            with_reflectance=self.with_reflectance,
            with_physics=self.with_physics,
            projector_x_m=self.projector_x_m,
        )
        return draw_pixels(
            inputs.values,
            ndp,
            counted,
            room=example.room,
            most=most,
            rng=generator(seed, 0, "learning", f"trees {example.scene}"),
        )

    def _held_out(
        self, pixels: DrawnPixels, seed: int, track: progress.Progress
    ) -> tuple[int, Recalibration]:
        """Estimate the best number of trees and the recalibration from held-out rooms."""
        rooms = generator(seed, 0, "learning", "folds").permutation(np.unique(pixels.room))
        best: list[int] = []
        forests: list[tuple[Forest, NDArray[np.bool_]]] = []
        for fold in track(np.array_split(rooms, min(self.folds, len(rooms))), "held-out rooms"):
            out = np.isin(pixels.room, fold)
            train, held = pixels.where(~out), pixels.where(out)
            if train.ndp.all() or not train.ndp.any():
                continue  # The remaining rooms have pixels of one kind only.
            model = self._boosted(self.rounds, seed)
            model.set_params(early_stopping=True, n_iter_no_change=_PATIENCE)
            model.fit(
                train.values,
                train.ndp,
                sample_weight=train.weight,
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
        probability = np.zeros(len(pixels.ndp))
        for forest, out in forests:
            probability[out] = expit(forest.first(rounds).logit(pixels.values[out]))
        return rounds, fit_recalibration(
            probability[known], pixels.ndp[known], pixels.weight[known]
        )

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


def _arrays(predictor: TreesPredictor) -> dict[str, NDArray]:
    place = predictor.projector_x_m
    line = predictor.recalibration
    return {
        **{name: getattr(predictor.forest, name) for name in _NODES},
        "start": np.array(predictor.forest.start),
        "recalibration": np.array([line.slope, line.offset]),
        "names": np.array(
            names(with_reflectance=predictor.with_reflectance, with_physics=predictor.with_physics)
        ),
        "projector_x_m": np.array(np.nan if place is None else place),
    }
