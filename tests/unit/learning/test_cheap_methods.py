"""Methods without networks: training, refusals, and model files."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from starling.learning.data.example import check_learnable
from starling.learning.method import Method
from starling.learning.methods import model_file
from starling.learning.methods.baselines import Perfect, Simple, incidence_deg
from starling.learning.methods.trees import Trees
from starling.patterns.errors import InputError

from .seen import HEIGHT, WIDTH, box, example, flat

COUNTED = np.ones((HEIGHT, WIDTH), bool)


def slanted_scene(seed: int):
    """Facets at many angles; the probability of a hole is the squared sine of incidence."""
    rng = np.random.default_rng(seed)
    ramp = 10 + rng.uniform(-0.5, 0.5) * (np.arange(WIDTH) - WIDTH / 2) / 6
    scene = example(np.broadcast_to(ramp, COUNTED.shape))
    chance = np.sin(np.deg2rad(incidence_deg(scene))) ** 2
    ndp = rng.random(COUNTED.shape) < chance
    return dataclasses.replace(scene, scene=f"scene {seed}", ndp=ndp, counted=COUNTED), chance


def test_perfect_has_no_holes_and_needs_nothing(tmp_path):
    method: Method = Perfect()
    bare = example(flat())
    report = method.fit([], folder=tmp_path, seed=0).probability(bare)
    assert report.shape == (HEIGHT, WIDTH)
    assert report.dtype == np.float32
    assert not report.any()
    assert not list(tmp_path.iterdir())
    assert_array_equal(Perfect().load(tmp_path).probability(bare), report)


def test_simple_recovers_the_probability_by_angle(tmp_path):
    scenes, chances = zip(*[slanted_scene(seed) for seed in range(40)], strict=True)
    learnt = Simple().fit(scenes[1:], folder=tmp_path, seed=0)
    assert (np.diff(learnt.share) >= 0).all()
    report = learnt.probability(scenes[0])
    assert report.dtype == np.float32
    # 7200 pixels a scene in half-degree bins determine the shares to about 2 %.
    assert_allclose(report, chances[0], atol=0.06)
    assert abs(float(np.mean(report - chances[0]))) < 0.02
    again = Simple().load(tmp_path)
    assert_array_equal(again.probability(scenes[0]), report)


def test_simple_weights_scenes_equally(tmp_path):
    """Half an image without holes and a whole one of holes average to one half, not two thirds."""
    half = COUNTED.copy()
    half[:, WIDTH // 2 :] = False  # The other half has the same angles.
    none = example(flat(), ndp=~COUNTED, counted=half)
    holes = example(flat(), ndp=COUNTED, counted=COUNTED)
    learnt = Simple().fit([none, holes], folder=tmp_path, seed=0)
    assert_allclose(learnt.share, 0.5, atol=1e-6)


@pytest.mark.parametrize("method", [Simple(), Trees()])
@pytest.mark.parametrize(
    ("examples", "message"),
    [
        ([], "examples must be at least one"),
        (
            [example(flat())],
            "scene a must have the device's depth and reference depth",
        ),
        ([example(flat(), ndp=COUNTED)], "must have the device's depth"),
        ([example(flat(), ndp=~COUNTED, counted=COUNTED)], "got 0 of 7200. Use scenes with both"),
        ([example(flat(), ndp=COUNTED, counted=COUNTED)], "got 7200 of 7200"),
        ([example(flat(), ndp=COUNTED, counted=~COUNTED)], "scene a must have reference depth"),
        ([example(flat(), ndp=COUNTED[:5], counted=COUNTED)], "must share one shape"),
    ],
)
def test_uninformative_examples_are_refused_in_one_line(method, examples, message, tmp_path):
    with pytest.raises(InputError, match=message) as caught:
        method.fit(examples, folder=tmp_path, seed=0)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_some_scenes_may_have_no_holes():
    none = example(box(50, 90), ndp=~COUNTED, counted=COUNTED)
    check_learnable([none, example(flat(), ndp=COUNTED, counted=COUNTED)])


def test_models_are_saved_loaded_and_replaced(tmp_path):
    arrays = {"a": np.arange(3), "b": np.array(["x", "yy"])}
    folder = tmp_path / "made"
    for offset in (0, 1):
        path = model_file.write(folder, "kind", 2, {**arrays, "a": arrays["a"] + offset})
    assert path == folder / "kind.npz"
    result = model_file.read(folder, "kind", 2)
    assert_array_equal(result["a"], [1, 2, 3])
    assert result["b"].tolist() == ["x", "yy"]
    assert [item.name for item in folder.iterdir()] == ["kind.npz"]


def test_missing_other_and_damaged_models_are_refused(tmp_path):
    with pytest.raises(InputError, match="model must exist"):
        model_file.read(tmp_path, "kind", 1)
    path = model_file.write(tmp_path, "kind", 1, {"a": np.arange(1000.0)})
    with pytest.raises(InputError, match="must be kind of version 2; got kind of version 1"):
        model_file.read(tmp_path, "kind", 2)
    path.rename(tmp_path / "other.npz")
    with pytest.raises(InputError, match="must be other of version 1; got kind"):
        model_file.read(tmp_path, "other", 1)
    whole = (tmp_path / "other.npz").read_bytes()
    for damaged in (whole[: len(whole) // 2], b"", b"no archive at all", whole[:-30]):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="model must be whole") as caught:
            model_file.read(tmp_path, "kind", 1)
        assert "\n" not in str(caught.value)


def test_a_model_with_python_objects_is_not_loaded(tmp_path):
    """Objects are pickles, which can run arbitrary code."""
    path = model_file.path_of(tmp_path, "kind")
    objects = np.array([{"code": 1}], dtype=object)
    np.savez(path, kind=np.array("kind"), version=np.array(1), a=objects, allow_pickle=True)
    with pytest.raises(InputError, match="model must be whole"):
        model_file.read(tmp_path, "kind", 1)


def test_models_without_arrays_or_with_other_features_are_refused(tmp_path):
    model_file.write(tmp_path, "simple", 1, {"share": np.zeros(3)})
    with pytest.raises(InputError, match="without angle_deg"):
        Simple().load(tmp_path)
    whole = {name: np.zeros(1) for name in ("feature", "threshold", "left", "right", "value")}
    others = {"root": np.zeros(1), "start": np.zeros(()), "recalibration": np.ones(2)}
    known = {"names": np.array(["warmth"]), "projector_x_m": np.array(np.nan)}
    model_file.write(tmp_path, "trees", 1, {**whole, **others, **known})
    with pytest.raises(InputError, match="trees must be trained on the features"):
        Trees().load(tmp_path)


def test_scikit_learn_is_imported_for_training_only():
    code = (
        "import sys, starling.learning.methods.trees, starling.learning.methods.baselines;"
        "print([m for m in ('sklearn', 'torch', 'mitsuba', 'drjit') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("angle", "share"),
    [
        ([[1.0]], [0.5]),
        ([1, 2], [0.5, 0.6]),
        ([], []),
        ([1.0, 2.0], [0.5]),
        ([2.0, 1.0], [0.5, 0.6]),
        ([1.0, 2.0], [0.6, 0.5]),
        ([1.0, np.nan], [0.5, 0.6]),
        ([1.0, 2.0], [0.5, 1.5]),
    ],
)
def test_damaged_shares_are_refused(tmp_path, angle, share):
    model_file.write(
        tmp_path, "simple", 1, {"angle_deg": np.array(angle), "share": np.array(share)}
    )
    with pytest.raises(InputError, match="model must be whole"):
        Simple().load(tmp_path)
