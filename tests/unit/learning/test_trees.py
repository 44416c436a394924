"""Trees: training, agreement with scikit-learn, and model files."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from starling.learning.data.example import Physics
from starling.learning.evaluation.metrics import classification, judge, pool
from starling.learning.features.features import GEOMETRY, features
from starling.learning.features.geometry import seen_from
from starling.learning.methods import model_file
from starling.learning.methods.forest import equal_count_bins, forest_of
from starling.learning.methods.trees import Trees, draw_pixels, join
from starling.patterns.errors import InputError
from starling.sim.reason import Reason

from .seen import HEIGHT, WIDTH, box, example, flat

COUNTED = np.ones((HEIGHT, WIDTH), bool)
SMALL = Trees(
    pixels_per_scene=800, rounds=25, rounds_of_one_room=25, folds=2, leaves=6, pixels_per_leaf=20
)


def occluded_scene(seed: int, *, shuffled: bool = False):
    """A box before a wall; most half-occluded pixels have no depth."""
    rng = np.random.default_rng(seed)
    first = int(rng.integers(40, 80))
    disparity = box(first, first + 25, front_px=float(rng.uniform(12, 25)))
    chance = np.where(seen_from(disparity.astype(np.float32), 1.0).hidden, 0.9, 0.02)
    ndp = rng.random(chance.shape) < chance
    if shuffled:
        ndp = rng.permutation(ndp.ravel()).reshape(ndp.shape)
    name = f"scene {seed}"
    return example(disparity, scene=name, room=f"room {seed % 4}", ndp=ndp, counted=COUNTED)


def judged(predictor, scenes):
    return pool(judge(predictor.probability(scene), scene.ndp, scene.counted) for scene in scenes)


TRAIN, TEST = [occluded_scene(seed) for seed in range(8)], [occluded_scene(9), occluded_scene(10)]


def test_trees_learn_occlusion_with_calibrated_probabilities(tmp_path):
    """Best possible: 0.9 inside, 0.02 outside. The AUC of that rule is the upper bound."""
    result = classification(judged(SMALL.fit(TRAIN, folder=tmp_path, seed=0), TEST))
    rule = [np.where(seen_from(5 / item.depth_m, 1.0).hidden, 0.9, 0.02) for item in TEST]
    best = classification(
        pool(judge(report, item.ndp, item.counted) for report, item in zip(rule, TEST, strict=True))
    )
    assert result.auc > best.auc - 0.03
    assert result.brier_skill > best.brier_skill - 0.05
    assert result.ece < 0.02


def test_shuffled_holes_are_not_learnt(tmp_path):
    control = [occluded_scene(seed, shuffled=True) for seed in range(8)]
    result = classification(judged(SMALL.fit(control, folder=tmp_path, seed=0), TEST))
    assert abs(result.auc - 0.5) < 0.1
    assert result.brier_skill < 0.02


def test_equal_seeds_give_equal_trees_and_files(tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    item = SMALL.fit(TRAIN[:1], folder=first, seed=4).probability(TEST[0])
    different = SMALL.fit(TRAIN[:1], folder=second, seed=4).probability(TEST[0])
    assert_array_equal(item, different)
    assert (first / "trees.npz").read_bytes() == (second / "trees.npz").read_bytes()
    third = SMALL.fit(TRAIN[:1], folder=second, seed=5).probability(TEST[0])
    assert (item != third).any()


def test_loaded_trees_predict_the_same(tmp_path):
    settings = dataclasses.replace(SMALL, with_reflectance=True, projector_x_m=0.01)
    grey = np.full(COUNTED.shape, 0.3, np.float32)
    seen = [dataclasses.replace(item, reflectance=grey) for item in TRAIN[:2]]
    learnt = settings.fit(seen, folder=tmp_path, seed=0)
    again = settings.load(tmp_path)
    assert again.projector_x_m == 0.01
    assert_array_equal(again.probability(seen[0]), learnt.probability(seen[0]))
    with pytest.raises(InputError, match="reflectance must be given"):
        again.probability(TRAIN[0])
    assert settings.name == "trees_reflectance"


def simulated(scene, seed: int):
    """A simulator that predicts four of five holes that do not depend on geometry."""
    rng = np.random.default_rng(seed)
    ndp = cv2.dilate((rng.random(COUNTED.shape) < 0.005).astype(np.uint8), np.ones((9, 9))) > 0
    right = np.where(rng.random(ndp.shape) < 0.8, ndp, rng.random(ndp.shape) < ndp.mean())
    zeros = np.zeros(ndp.shape, np.float32)
    physics = Physics(
        ndp=right.astype(np.float32),
        draws=4,
        infrared=zeros,
        contrast=zeros,
        disparity_px=scene.info.disparity_px(scene.depth_m),
        one_draw_px=scene.info.disparity_px(scene.depth_m),
        one_draw_ndp=right,
        reason=np.where(right, Reason.LOW_SIGNAL, Reason.VALID).astype(np.uint32),
    )
    return dataclasses.replace(scene, ndp=ndp, physics=physics)


def test_trees_improve_with_the_simulation(tmp_path):
    seen = [simulated(item, seed) for seed, item in enumerate([*TRAIN, *TEST])]
    hybrid = dataclasses.replace(SMALL, with_physics=True)
    assert hybrid.name == "hybrid_trees"
    learnt = hybrid.fit(seen[:8], folder=tmp_path, seed=0)
    assert classification(judged(learnt, seen[8:])).auc > 0.9
    alone = SMALL.fit(seen[:8], folder=tmp_path / "alone", seed=0)
    assert classification(judged(alone, seen[8:])).auc < 0.65
    again = hybrid.load(tmp_path)
    assert_array_equal(again.probability(seen[9]), learnt.probability(seen[9]))
    with pytest.raises(InputError, match="physics must be given for a method that uses it"):
        again.probability(TRAIN[0])


def test_training_on_one_room(tmp_path):
    room = [item for item in TRAIN if item.room == "room 0"]
    learnt = SMALL.fit(room, folder=tmp_path, seed=0)
    assert len(learnt.forest.root) == 25
    assert (learnt.recalibration.slope, learnt.recalibration.offset) == (1, 0)
    assert classification(judged(learnt, TEST)).auc > 0.85


def test_a_second_room_without_holes_is_like_one_room(tmp_path):
    none = example(flat(), scene="none", room="z", ndp=~COUNTED, counted=COUNTED)
    learnt = SMALL.fit([TRAIN[0], none], folder=tmp_path, seed=0)
    assert len(learnt.forest.root) == 25


def test_the_forest_predicts_like_scikit_learn():
    from scipy.special import logit
    from sklearn.ensemble import HistGradientBoostingClassifier

    rng = np.random.default_rng(0)
    values = rng.normal(size=(5000, 6)).astype(np.float32)
    answer = rng.random(5000) < 1 / (1 + np.exp(-values[:, 0] * values[:, 1]))
    model = HistGradientBoostingClassifier(max_iter=25, random_state=0).fit(values, answer)
    ours = forest_of(model).logit(values)
    assert_allclose(ours, logit(model.predict_proba(values)[:, 1]), atol=1e-9)
    assert_allclose(ours, model.decision_function(values), atol=1e-12)


def test_trees_on_bins_and_on_values_predict_the_same():
    from sklearn.ensemble import HistGradientBoostingClassifier

    rng = np.random.default_rng(0)
    values = rng.normal(size=(5000, 3)).astype(np.float32)
    # Most pixels share a value, as pixels without an edge.
    values[:, 1] = np.maximum(values[:, 1], 1)
    values[:, 2] = 7  # A constant feature.
    bins = equal_count_bins(values[:4000])
    numbers = bins.numbers(values)
    assert len(np.unique(numbers[:, 0])) == 255
    model = HistGradientBoostingClassifier(max_iter=20, random_state=0)
    model.fit(numbers[:4000], values[:4000, 0] * values[:4000, 1] > 0.5)
    forest = forest_of(model)
    coded = forest.logit(numbers.astype(np.float32))
    assert_array_equal(bins.in_units(forest).logit(values), coded)
    assert np.ptp(coded) > 1


def test_bins_have_equal_counts_and_keep_the_order():
    values = np.random.default_rng(0).random((2550, 1)).astype(np.float32)
    numbers = equal_count_bins(values).numbers(values)[:, 0]
    assert set(np.bincount(numbers)) <= {9, 10, 11}  # Ranks are rounded.
    assert (np.diff(numbers[np.argsort(values[:, 0])].astype(int)) >= 0).all()


def test_the_first_trees_of_a_forest(tmp_path):
    learnt = SMALL.fit(TRAIN[:1], folder=tmp_path, seed=0)
    forest, values = learnt.forest, features(TRAIN[0]).values.reshape(-1, len(GEOMETRY))
    assert (forest.first(0).logit(values) == forest.start).all()
    assert_array_equal(forest.first(99).logit(values), forest.logit(values))
    assert forest.is_sound(len(GEOMETRY))
    assert not forest.is_sound(1)
    inner = int(np.flatnonzero(forest.feature >= 0)[0])
    for name, wrong in (("left", inner), ("right", 10**6), ("value", np.nan), ("root", -1)):
        array = getattr(forest, name).copy()
        array[inner] = wrong
        assert not dataclasses.replace(forest, **{name: array}).is_sound(len(GEOMETRY))
    assert not dataclasses.replace(forest, value=forest.value[:-1]).is_sound(len(GEOMETRY))


def test_a_file_with_cyclic_trees_is_refused(tmp_path):
    SMALL.fit(TRAIN[:1], folder=tmp_path, seed=0)
    arrays = model_file.read(tmp_path, "trees", 1)
    model_file.write(tmp_path, "trees", 1, {**arrays, "left": arrays["left"] * 0})
    with pytest.raises(InputError, match="model must be whole"):
        SMALL.load(tmp_path)


@pytest.mark.parametrize("kind", [np.float16, np.longdouble])
def test_a_file_with_floats_without_compiled_code_is_refused(tmp_path, kind):
    SMALL.fit(TRAIN[:1], folder=tmp_path, seed=0)
    arrays = model_file.read(tmp_path, "trees", 1)
    model_file.write(tmp_path, "trees", 1, {**arrays, "value": arrays["value"].astype(kind)})
    with pytest.raises(InputError, match="model must be whole"):
        SMALL.load(tmp_path)


@pytest.mark.parametrize("holes", [3, 400, 6000, 7197])
@pytest.mark.parametrize("most", [2, 1000, 5000, 100_000])
def test_drawn_pixels_are_unbiased(holes, most):
    """For any draw, the weighted share is the scene's, within the budget, with each pixel once."""
    rng = np.random.default_rng(0)
    ndp = rng.permutation(np.arange(COUNTED.size) < holes).reshape(COUNTED.shape)
    values = np.arange(COUNTED.size, dtype=np.float32).reshape(*COUNTED.shape, 1)
    drawn = draw_pixels(values, ndp, COUNTED, room="a", most=most, rng=rng)
    pixels = drawn.values[:, 0].astype(int)
    assert len(set(pixels)) == len(pixels) <= most
    assert len(pixels) == min(most, COUNTED.size)
    assert_array_equal(ndp.ravel()[pixels], drawn.ndp)
    assert np.average(drawn.ndp, weights=drawn.weight) == pytest.approx(holes / COUNTED.size)
    assert drawn.weight.sum() == pytest.approx(len(pixels))


def test_scenes_are_weighted_equally_and_only_counted_pixels_drawn():
    rng = np.random.default_rng(0)
    values = np.arange(COUNTED.size, dtype=np.float32).reshape(*COUNTED.shape, 1)
    few = np.zeros_like(COUNTED)
    few[:, :2] = True
    holes = rng.random(COUNTED.shape) < 0.1
    scenes = [
        draw_pixels(values, holes, counted, room=room, most=500, rng=rng)
        for room, counted in (("a", few), ("b", COUNTED))
    ]
    assert set(scenes[0].values[:, 0].astype(int)) == set(np.flatnonzero(few))
    both = join(scenes)
    assert both.weight.mean() == pytest.approx(1)
    assert both.weight[both.room == "a"].sum() == pytest.approx(both.weight.sum() / 2)
    assert set(both.where(both.room == "b").room) == {"b"}


@pytest.mark.parametrize(
    "setting",
    [
        {"pixels_per_scene": 1},
        {"rounds": 0},
        {"rounds_of_one_room": 0},
        {"folds": 1},
        {"learning_rate": 0.0},
        {"leaves": 1},
        {"pixels_per_leaf": 0},
    ],
)
def test_invalid_settings_are_refused(setting):
    with pytest.raises(InputError, match=f"{next(iter(setting))} must be in"):
        Trees(**setting)
