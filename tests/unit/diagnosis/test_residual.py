"""The learned residual as bound and witness, of made subjects and a made method."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.howfar import holes, residual
from starling.diagnosis.howfar.evaluation import DRAWS, OTHER
from starling.diagnosis.scenes.observation import Reading
from starling.learning.data.example import Example, Image, Physics
from starling.learning.data.physics_probability import physics_probability
from starling.patterns.errors import InputError
from tests.unit.diagnosis.test_features import DISPARITY, GROUND

HOLES = np.zeros(DISPARITY.shape, bool)
HOLES[:40, -60:] = True
SEEN = HOLES.copy()  # By the base.
SEEN[:, -30:] = False
LEARNT = 0.3  # The method that is made up here leaves this share of what physics gets wrong.


def simulated(settings: Mapping[str, float]) -> np.ndarray:
    """Holes of all draws: with the true effect those of the real captures."""
    return HOLES if "true" in settings else SEEN


def made_physics(ndp: np.ndarray) -> Physics:
    """Draws with the same holes; nothing else is looked at here."""
    plain = np.zeros(DISPARITY.shape, np.float32)
    return Physics(
        ndp=ndp.astype(np.float32),
        draws=DRAWS,
        infrared=plain,
        contrast=plain,
        disparity_px=DISPARITY,
        one_draw_px=DISPARITY,
        one_draw_ndp=ndp,
        reason=np.zeros(DISPARITY.shape, np.uint32),
    )


def maps(ndp: np.ndarray) -> np.ndarray:
    return np.where(ndp, np.nan, DISPARITY)[None].astype(np.float32)


class Made:
    """A scene whose holes the base sees half of."""

    def __init__(self, number: int, *, device: bool = True) -> None:
        self.name, self.room, self.ground = f"scene{number}", f"room{number}", GROUND
        self.real = Reading(left=None, right=None, ours_px=maps(HOLES), device_px=None)
        if device:
            self.real = dataclasses.replace(self.real, ours_px=maps(~HOLES), device_px=maps(HOLES))

    def another(self, number: int) -> Made:
        assert number == OTHER
        return self

    def like_captured(self, settings: Mapping[str, float], *, seed: int) -> Reading:
        assert seed == OTHER
        found = maps(simulated(settings))
        device = None if self.real.device_px is None else found
        return Reading(left=None, right=None, ours_px=found, device_px=device)

    def physics(self, settings: Mapping[str, float], *, seeds: Sequence[int]) -> Physics:
        assert len(seeds) == DRAWS
        return made_physics(simulated(settings))


class Knowing:
    """A method that knows the holes, and leaves a fixed share of what physics gets wrong."""

    seen: list[list[str]]

    def __init__(self) -> None:
        self.seen = []

    def fit(self, examples: Sequence[Example], *, folder: Path, seed: int, track: Any) -> Knowing:
        assert folder.is_dir()
        self.seen.append([one.scene for one in examples])
        return self

    def probability(self, example: Example) -> Image:
        assert example.physics is not None and example.ndp is not None
        told = physics_probability(example.physics)
        return (example.ndp + LEARNT * (told - example.ndp)).astype(np.float32)


def learn(method: Knowing, settings: Mapping[str, float], **how: bool) -> residual.Residual:
    asked: Any = [Made(number, **how) for number in range(3)]
    locked: Any = [Made(number, **how) for number in (3, 4, 5)]
    return residual.learn(method, asked, locked, settings)


@pytest.fixture
def method() -> Knowing:
    return Knowing()


def test_the_figures_of_holes_are_those_of_an_evaluation():
    told = np.where(HOLES, 0.5, 0.25).astype(np.float32)
    found = holes.figures(told, HOLES, np.ones_like(HOLES))
    share = HOLES.mean()
    assert found["ndp_brier"] == pytest.approx(share * 0.25 + (1 - share) / 16)
    assert found["ndp_ece"] == pytest.approx(share * 0.5 + (1 - share) * 0.25)
    assert found["ndp_1_auc"] == 0
    assert np.isnan(holes.figures(told, HOLES, HOLES)["ndp_1_auc"])
    with pytest.raises(InputError, match="counted must hold a pixel"):
        holes.figures(told, HOLES, np.zeros_like(HOLES))


def test_without_effects_the_bound_alone_is_told(method):
    found = learn(method, {})
    told = physics_probability(made_physics(SEEN))
    assert found.alone == holes.figures(told, HOLES, GROUND.counted)
    assert found.bound["ndp_brier"] == pytest.approx(LEARNT**2 * found.alone["ndp_brier"])
    gain = found.absorption
    assert gain.closable and gain.gain_after is gain.share is gain.interval is None
    right = holes.figures(told, SEEN, GROUND.counted)["ndp_brier"]
    assert gain.gain_floor == pytest.approx((1 - LEARNT**2) * right)
    assert method.seen == [["scene0", "scene1", "scene2"]] * 2


def test_holes_are_our_matcher_s_where_the_device_has_no_depth(method):
    assert learn(method, {}, device=False) == learn(method, {})


def test_a_true_effect_leaves_no_more_to_learn_than_noise_and_a_stand_in_as_much(method):
    gain = learn(method, {"true": 1.0}).absorption
    assert gain.gain_after is not None
    assert 0 < gain.gain_after == gain.gain_floor < gain.gain_before
    assert gain.share == pytest.approx(1) and gain.interval == pytest.approx((1, 1))
    imitated = learn(method, {"imitating": 1.0}).absorption
    assert imitated.closable and imitated.share == pytest.approx(0)
    assert imitated.gain_after == imitated.gain_before == gain.gain_before


def test_of_one_scene_there_is_no_interval(method):
    many: Any = [Made(0), Made(1)]
    gain = residual.learn(method, many[:1], many[1:], {"true": 1.0}).absorption
    assert gain.share == pytest.approx(1) and gain.interval is None


def test_where_nothing_is_gained_there_is_no_share(method, monkeypatch):
    monkeypatch.setattr(
        Knowing, "probability", lambda self, example: physics_probability(example.physics)
    )
    gain = learn(method, {"true": 1.0}).absorption
    assert gain.gain_before == gain.gain_after == gain.gain_floor == 0
    assert not gain.closable and gain.share is gain.interval is None


def test_without_a_locked_scene_nothing_is_learnt(method):
    asked: Any = [Made(0)]
    with pytest.raises(InputError, match="locked scenes must be at least 1; got 0"):
        residual.learn(method, asked, [], {})
    assert method.seen == []


def test_a_figure_that_a_scene_has_not_is_left_out_of_the_mean():
    many = [{"a": 1.0, "b": float("nan")}, {"a": 3.0, "b": 2.0}, {"a": 2.0, "b": 4.0}]
    assert residual._mean(many) == {"a": 2.0, "b": 3.0}
    assert np.isnan(residual._mean([{"a": float("nan")}])["a"])
