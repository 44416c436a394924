"""The training loop: restarts, refusals, the loss curve."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from starling.learning.data.example import Example
from starling.learning.methods.cyclegan import CycleGan
from starling.learning.methods.network import Hybrid, Network
from starling.learning.methods.pix2pix import Pix2Pix
from starling.learning.networks import training
from starling.learning.networks.training import TrainingSettings, one_cycle, settings_identity
from starling.patterns.errors import InputError
from tests.unit.learning.step_scenes import step_scene

pytestmark = pytest.mark.long  # These tests train networks.

SCENES = [step_scene(number) for number in range(6)]
SHORT = TrainingSettings(steps=9, batch=2, crop_px=(32, 32), save_every=2, rate=5e-3)
METHODS = [
    Network(settings=SHORT),
    Hybrid(settings=SHORT, with_reflectance=True),
    Pix2Pix(settings=SHORT),
    CycleGan(settings=SHORT),
]


class _Killed(Exception):
    pass


class _Kill:
    """A progress bar that interrupts the training after some steps and counts them."""

    def __init__(self, after: int) -> None:
        self.after = after
        self.taken: list[int] = []

    def __call__(self, items: Sequence[Any], label: str) -> Iterable[Any]:
        for count, item in enumerate(items):
            if label.startswith("train") and count == self.after:
                raise _Killed
            yield item
            if label.startswith("train"):
                self.taken.append(item)


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_resumed_training_is_bit_identical(method: Any, tmp_path: Path) -> None:
    """On one machine with one thread count; otherwise sums can round differently."""
    whole = method.fit(SCENES, folder=tmp_path / "whole", seed=3)
    kill = _Kill(after=5)
    with pytest.raises(_Killed):
        method.fit(SCENES, folder=tmp_path / "killed", seed=3, track=kill)
    assert kill.taken == [0, 1, 2, 3, 4]
    rest = _Kill(after=100)
    resumed = method.fit(SCENES, folder=tmp_path / "killed", seed=3, track=rest)
    assert rest.taken == [4, 5, 6, 7, 8]  # From the checkpoint after four steps.
    weights = resumed.network.state_dict()
    for name, value in whole.network.state_dict().items():
        assert torch.equal(weights[name], value), name
    curves = [(tmp_path / name / training.CURVE).read_text() for name in ("whole", "killed")]
    assert curves[0] == curves[1]
    expected, answer = whole.probability(SCENES[0]), resumed.probability(SCENES[0])
    np.testing.assert_array_equal(answer, expected)


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_finished_training_is_not_repeated(method: Any, tmp_path: Path) -> None:
    first = method.fit(SCENES, folder=tmp_path, seed=0).probability(SCENES[1])
    again = method.fit(SCENES, folder=tmp_path, seed=0, track=_Kill(after=0))
    np.testing.assert_array_equal(again.probability(SCENES[1]), first)
    np.testing.assert_array_equal(method.load(tmp_path).probability(SCENES[1]), first)
    assert first.dtype == np.float32
    assert ((first >= 0) & (first <= 1)).all()


def test_the_seed_changes_the_result(tmp_path: Path) -> None:
    answers = [
        METHODS[0].fit(SCENES, folder=tmp_path / str(seed), seed=seed).probability(SCENES[0])
        for seed in (0, 1)
    ]
    assert (answers[0] != answers[1]).any()


def _other_truth() -> list[Example]:
    ndp = np.asarray(SCENES[0].ndp)[::-1].copy()
    ndp[0, 20] ^= True
    return [dataclasses.replace(SCENES[0], ndp=ndp), *SCENES[1:]]


@pytest.mark.parametrize(
    ("scenes", "seed", "rate"), [(SCENES, 1, 5e-3), (SCENES, 0, 1e-3), (_other_truth(), 0, 5e-3)]
)
def test_a_checkpoint_of_another_training_is_refused(
    scenes: list[Example], seed: int, rate: float, tmp_path: Path
) -> None:
    Network(settings=SHORT).fit(SCENES, folder=tmp_path, seed=0)
    method = Network(settings=dataclasses.replace(SHORT, rate=rate))
    with pytest.raises(InputError, match=r"checkpoint must belong to this training.*empty folder"):
        method.fit(scenes, folder=tmp_path, seed=seed)


def test_a_checkpoint_of_another_method_is_refused(tmp_path: Path) -> None:
    Pix2Pix(settings=SHORT).fit(SCENES, folder=tmp_path, seed=0)
    with pytest.raises(InputError, match="must be of 'network training'; got 'pix2pix training'"):
        Network(settings=SHORT).fit(SCENES, folder=tmp_path, seed=0)


def test_refuses_a_truncated_checkpoint(tmp_path: Path) -> None:
    Network(settings=SHORT).fit(SCENES, folder=tmp_path, seed=0)
    path = tmp_path / training.CHECKPOINT
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(InputError, match="checkpoint must be a complete file"):
        Network(settings=SHORT).fit(SCENES, folder=tmp_path, seed=0)


def test_a_loss_that_is_not_finite_stops_at_its_batch(tmp_path: Path) -> None:
    """The learning rate is so high that the first step makes the weights diverge."""
    wild = Network(settings=dataclasses.replace(SHORT, rate=1e30))
    with pytest.raises(InputError) as refused:
        wild.fit(SCENES[:1], folder=tmp_path, seed=0)
    message = str(refused.value)
    assert message.startswith("loss log_loss must be a finite number; got nan.")
    assert "Stopped at batch 1:" in message
    assert "\n" not in message
    assert not (tmp_path / training.CHECKPOINT).exists()


def test_writes_the_loss_curve(tmp_path: Path) -> None:
    Network(settings=SHORT).fit(SCENES, folder=tmp_path, seed=0)
    with (tmp_path / training.CURVE).open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["step"]) for row in rows] == list(range(9))
    assert all(float(row["log_loss"]) > 0 for row in rows)


def test_the_rate_rises_and_falls() -> None:
    settings = TrainingSettings(steps=1000, rate=2e-3)
    rates = np.array([one_cycle(step, settings) for step in range(1000)])
    top = int(rates.argmax())
    assert 90 <= top <= 110
    assert (np.diff(rates[:top]) > 0).all()
    assert (np.diff(rates[top:]) < 0).all()
    assert rates.max() == pytest.approx(2e-3)
    assert 0 < rates[-1] < 1e-6


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"steps": 0}, "steps must be in"),
        ({"batch": 0}, "batch must be in"),
        ({"crop_px": (0, 5)}, "crop_px must be in"),
        ({"rate": 0.0}, "rate must be > 0"),
        ({"weight_decay": -1.0}, "weight_decay must be in"),
        ({"averaging": 1.5}, "averaging must be in"),
        ({"hidden": 1.5}, "hidden must be in"),
    ],
)
def test_refuses_impossible_settings(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        TrainingSettings(**changes)


def test_settings_identity_has_no_class_name() -> None:
    """A checkpoint stays valid if the class of its settings gets another name."""
    assert settings_identity(SHORT).startswith("Settings(steps=9,")
