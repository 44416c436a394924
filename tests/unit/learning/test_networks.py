"""Training of networks, and the hybrid, which initially equals the physics."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.learning.data.example import Example
from starling.learning.data.physics import physics_probability
from starling.learning.evaluation.metrics import judge, pool, roc
from starling.learning.method import Predictor
from starling.learning.methods.network import Hybrid, HybridPredictor, Network, corrected
from starling.learning.networks.channels import channels
from starling.learning.networks.device import run_network
from starling.learning.networks.training import TrainingSettings
from starling.learning.networks.unet import UNet
from starling.patterns.errors import InputError
from tests.unit.learning.step_scenes import SHAPE, step_scene

pytestmark = pytest.mark.long  # These tests train networks.

LEARNT_FROM = [step_scene(number) for number in range(24)]
UNSEEN = [step_scene(number) for number in range(100, 116)]
QUICK = TrainingSettings(steps=60, batch=4, rate=5e-3, averaging=0.9)


def doubled(example: Example) -> Example:
    """The same scene in an image of twice the size."""

    def larger(image: Any) -> Any:
        return np.repeat(np.repeat(image, 2, axis=0), 2, axis=1)

    physics = example.physics
    assert physics is not None
    images = {
        field.name: getattr(physics, field.name)
        for field in dataclasses.fields(physics)
        if field.name != "draws"
    }
    images = {
        name: larger(image) * (2 if name.endswith("_px") else 1) for name, image in images.items()
    }
    info = example.info
    return dataclasses.replace(
        example,
        info=dataclasses.replace(
            info,
            width=2 * info.width,
            height=2 * info.height,
            fx_px=2 * info.fx_px,
            fy_px=2 * info.fy_px,
            cx_px=2 * info.cx_px + 0.5,
            cy_px=2 * info.cy_px + 0.5,
        ),
        depth_m=larger(example.depth_m),
        reflectance=None if example.reflectance is None else larger(example.reflectance),
        physics=dataclasses.replace(physics, **images),
    )


def _area(predictor: Predictor) -> float:
    return roc(
        pool(
            judge(predictor.probability(item), np.asarray(item.ndp), item.counted)
            for item in UNSEEN
        )
    ).area


def test_the_network_learns_half_occlusion_from_depth(tmp_path: Path) -> None:
    """0.997 measured, on one law in one kind of synthetic scene."""
    predictor = Network(settings=QUICK).fit(LEARNT_FROM, folder=tmp_path, seed=0)
    assert _area(predictor) > 0.97
    report = np.concatenate([predictor.probability(item)[item.counted] for item in UNSEEN])
    true = np.concatenate([np.asarray(item.ndp)[item.counted] for item in UNSEEN])
    assert report.mean() == pytest.approx(true.mean(), rel=0.25)  # Classes are not weighted.


def test_nothing_is_learnt_from_holes_of_other_scenes(tmp_path: Path) -> None:
    """Shuffled pairs: only the random places of 24 pillars remain."""
    shuffled = [
        dataclasses.replace(item, ndp=LEARNT_FROM[(place + 7) % 24].ndp)
        for place, item in enumerate(LEARNT_FROM)
    ]
    assert _area(Network(settings=QUICK).fit(shuffled, folder=tmp_path, seed=0)) < 0.7


def test_the_hybrid_beats_its_physics(tmp_path: Path) -> None:
    """0.998 measured; physics that misses the upper half of every hole has 0.87."""
    before = roc(
        pool(
            judge(_predicted(item), np.asarray(item.ndp), item.counted)
            for item in map(_blind, UNSEEN)
        )
    ).area
    predictor = Hybrid(settings=QUICK).fit(
        [_blind(item) for item in LEARNT_FROM], folder=tmp_path, seed=0
    )
    after = roc(
        pool(
            judge(predictor.probability(_blind(item)), np.asarray(item.ndp), item.counted)
            for item in UNSEEN
        )
    ).area
    assert after > 0.98
    assert before < 0.9


def _blind(example: Example) -> Example:
    assert example.physics is not None
    seen = example.physics.ndp.copy()
    seen[: SHAPE[0] // 2] = 0.125
    return dataclasses.replace(example, physics=dataclasses.replace(example.physics, ndp=seen))


def _predicted(example: Example) -> np.ndarray:
    assert example.physics is not None
    return physics_probability(example.physics)


@settings(max_examples=20)
@given(st.integers(1, 64), st.integers(0, 2**32 - 1), st.booleans())
def test_an_untrained_hybrid_equals_physics_bit_for_bit(
    draws: int, seed: int, with_reflectance: bool
) -> None:
    share = np.random.default_rng(seed).integers(0, draws + 1, SHAPE) / draws
    example = step_scene(0)
    assert example.physics is not None
    physics = dataclasses.replace(example.physics, ndp=share.astype(np.float32), draws=draws)
    example = dataclasses.replace(example, physics=physics)
    network = Hybrid(with_reflectance=with_reflectance).untrained().eval()
    predictor = HybridPredictor(network, with_reflectance, SHAPE)
    np.testing.assert_array_equal(predictor.probability(example), physics_probability(physics))


@given(st.floats(0, 1, width=32))
def test_a_zero_correction_changes_no_probability(probability: float) -> None:
    image = np.full((1, 1), probability, np.float32)
    np.testing.assert_array_equal(corrected(image, np.zeros((1, 1), np.float32)), image)


def test_a_correction_is_added_to_the_logit() -> None:
    """Compared with the logistic function in 64 bits, within the range of 32 bits."""
    probability = np.linspace(0.01, 0.99, 99, dtype=np.float32)[:, None]
    correction = np.linspace(-60, 60, 121, dtype=np.float32)
    p, c = np.broadcast_arrays(probability.astype(np.float64), correction.astype(np.float64))
    wanted = 1 / (1 + (1 - p) / p * np.exp(-c))
    report = corrected(np.broadcast_to(probability, p.shape), np.broadcast_to(correction, p.shape))
    np.testing.assert_allclose(report, wanted, rtol=2e-5)
    extreme = corrected(np.full(2, 0.5, np.float32), np.array([-1e4, 1e4], np.float32))
    np.testing.assert_array_equal(extreme, [0, 1])


def test_the_trained_hybrid_is_scale_times_logit_plus_network() -> None:
    """The logit in training and the prediction in odds are equal."""
    network = Hybrid().untrained().eval()
    torch.manual_seed(0)
    with torch.no_grad():
        network.scale.fill_(0.6)
        network.unet.head.weight.normal_(0, 0.3)
    example = step_scene(5)
    seen = channels(example, with_reflectance=False, with_physics=True)
    logit = run_network(network, seen)
    share = _predicted(example).astype(np.float64)
    wanted = 0.6 * np.log(share / (1 - share)) + run_network(network.unet, seen)
    np.testing.assert_allclose(logit, wanted, atol=1e-4)
    report = HybridPredictor(network, False, SHAPE).probability(example)
    np.testing.assert_allclose(report, 1 / (1 + np.exp(-wanted)), atol=1e-5)
    assert np.abs(logit).max() > 0.5


@pytest.mark.parametrize("width", [1, 33, 64])
def test_inference_is_the_network(width: int) -> None:
    torch.manual_seed(0)
    network = UNet(3).eval()
    with torch.no_grad():
        network.head.weight.normal_()
        image = torch.randn(1, 3, 40, width)
        wanted = network(image)[0, 0].numpy()
    report = run_network(network, image[0].numpy())
    assert report.shape == (40, width)
    np.testing.assert_allclose(report, wanted, atol=1e-4)


@pytest.mark.parametrize("method", [Network(), Hybrid()], ids=lambda method: method.name)
def test_scenes_of_another_size_are_predicted_at_the_training_scale(
    method: Any, tmp_path: Path
) -> None:
    """Every pixel of a scene becomes 2x2 pixels: the same prediction, but for interpolation."""
    short = dataclasses.replace(QUICK, steps=8)
    predictor = dataclasses.replace(method, settings=short).fit(
        LEARNT_FROM[:4], folder=tmp_path, seed=0
    )
    small, large = UNSEEN[0], doubled(UNSEEN[0])
    predicted = predictor.probability(large)
    assert predicted.shape == large.depth_m.shape
    means = predicted.reshape(SHAPE[0], 2, SHAPE[1], 2).mean((1, 3))
    assert np.corrcoef(means.ravel(), predictor.probability(small).ravel())[0, 1] > 0.9


def test_scenes_without_an_input_are_refused(tmp_path: Path) -> None:
    short = dataclasses.replace(QUICK, steps=1)
    bare = dataclasses.replace(UNSEEN[0], reflectance=None, physics=None)
    network = Network(settings=short, with_reflectance=True)
    predictor = network.fit(LEARNT_FROM[:2], folder=tmp_path / "network", seed=0)
    with pytest.raises(InputError, match="reflectance must be given"):
        predictor.probability(bare)
    hybrid = Hybrid(settings=short).fit(LEARNT_FROM[:2], folder=tmp_path / "hybrid", seed=0)
    with pytest.raises(InputError, match="physics must be given"):
        hybrid.probability(bare)


@pytest.mark.parametrize("kind", [Network, Hybrid])
def test_training_starts_from_initial_weights(kind: Any, tmp_path: Path) -> None:
    """A learning rate near zero keeps the initial weights; a new network differs."""
    first, last = tmp_path / "first", tmp_path / "last"
    learnt = kind(settings=QUICK).fit(LEARNT_FROM[:4], folder=first, seed=0)
    still = dataclasses.replace(QUICK, start=first, steps=1, rate=1e-9)
    gone_on = kind(settings=still).fit(LEARNT_FROM[4:6], folder=last, seed=1)
    report = learnt.probability(UNSEEN[0])
    np.testing.assert_allclose(gone_on.probability(UNSEEN[0]), report, atol=1e-5)
    anew = kind(settings=dataclasses.replace(still, start=None))
    second = anew.fit(LEARNT_FROM[4:6], folder=tmp_path / "anew", seed=1)
    assert np.abs(second.probability(UNSEEN[0]) - report).max() > 0.1


def test_weights_of_other_channels_are_refused(tmp_path: Path, monkeypatch: Any) -> None:
    short = dataclasses.replace(QUICK, steps=1)
    Network(settings=short).fit(LEARNT_FROM[:2], folder=tmp_path, seed=0)
    monkeypatch.setattr(
        "starling.learning.methods.network.names", lambda **_: ("disparity", "colour")
    )
    with pytest.raises(InputError, match="must be trained on disparity, colour; got"):
        Network().load(tmp_path)
