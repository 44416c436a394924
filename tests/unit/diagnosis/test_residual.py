"""The learned residual on synthetic scene models with a synthetic method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.howfar import residual
from starling.diagnosis.howfar.distances import hole_figures
from starling.diagnosis.howfar.evaluation import DRAWS, OTHER
from starling.diagnosis.scenes.observation import StereoObservation
from starling.diagnosis.scenes.request import Request
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.learning.data.example import Example, Image, Physics
from starling.learning.data.physics import physics_probability
from starling.patterns.errors import InputError
from tests.unit.diagnosis.test_features import DISPARITY, GROUND

HOLES = np.zeros(DISPARITY.shape, bool)
HOLES[:40, -60:] = True
BASE_HOLES = HOLES.copy()  # Holes that the base simulates.
BASE_HOLES[:, -30:] = False
LEARNT = 0.3  # Share of the error of physics that the synthetic method leaves.


def simulated(settings: Mapping[str, float]) -> np.ndarray:
    """Return the holes of all draws; with the true effect they are the real ones."""
    return HOLES if "true" in settings else BASE_HOLES


def made_physics(ndp: np.ndarray) -> Physics:
    """Return draws with equal holes; other inputs do not matter here."""
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


def observation(ndp: np.ndarray) -> StereoObservation:
    dark = np.zeros((1, *DISPARITY.shape), np.uint8)
    return StereoObservation(left=dark, right=dark, ours_px=maps(ndp))


class FakeScene:
    """A scene of whose holes the base simulates half."""

    def __init__(self, number: int, *, device: bool = True) -> None:
        self.name, self.room, self.strata = f"scene{number}", f"room{number}", GROUND
        self.device = device
        self.real = observation(HOLES)
        if device:
            self.real = observation(~HOLES).with_depth(maps(HOLES))

    request = SceneModel.request

    def observe(self, request: Request) -> StereoObservation:
        assert request.seed == request.device == OTHER
        holes = simulated(request.settings)
        pair = observation(holes)
        return pair.with_depth(maps(holes)) if self.device else pair

    def physics(self, settings: Mapping[str, float], *, seeds: Sequence[int]) -> Physics:
        assert len(seeds) == DRAWS
        return made_physics(simulated(settings))


class Knowing:
    """A method that knows the holes and leaves a fixed share of the error of physics."""

    seen: list[list[str]]

    def __init__(self) -> None:
        self.seen = []

    def fit(self, examples: Sequence[Example], *, folder: Path, seed: int, track: Any) -> Knowing:
        assert folder.is_dir()
        self.seen.append([example.scene for example in examples])
        return self

    def probability(self, example: Example) -> Image:
        assert example.physics is not None and example.ndp is not None
        probability = physics_probability(example.physics)
        return (example.ndp + LEARNT * (probability - example.ndp)).astype(np.float32)


def learn(method: Knowing, settings: Mapping[str, float], **how: bool) -> residual.LearnedResidual:
    training: Any = [FakeScene(number, **how) for number in range(3)]
    held_out: Any = [FakeScene(number, **how) for number in (3, 4, 5)]
    return residual.learn_residual(method, training, held_out, settings)


@pytest.fixture
def method() -> Knowing:
    return Knowing()


def test_hole_figures_match_their_definitions():
    probability = np.where(HOLES, 0.5, 0.25).astype(np.float32)
    result = hole_figures(probability, HOLES, np.ones_like(HOLES))
    share = HOLES.mean()
    assert result["ndp_brier"] == pytest.approx(share * 0.25 + (1 - share) / 16)
    assert result["ndp_ece"] == pytest.approx(share * 0.5 + (1 - share) * 0.25)
    assert result["ndp_1_auc"] == 0
    assert np.isnan(hole_figures(probability, HOLES, HOLES)["ndp_1_auc"])
    with pytest.raises(InputError, match="counted must hold a pixel"):
        hole_figures(probability, HOLES, np.zeros_like(HOLES))


def test_without_effects_only_the_bound_is_reported(method):
    result = learn(method, {})
    probability = physics_probability(made_physics(BASE_HOLES))
    assert result.alone == hole_figures(probability, HOLES, GROUND.counted)
    assert result.bound["ndp_brier"] == pytest.approx(LEARNT**2 * result.alone["ndp_brier"])
    gain = result.absorption
    assert gain.closable and gain.gain_after is gain.share is gain.interval is None
    right = hole_figures(probability, BASE_HOLES, GROUND.counted)["ndp_brier"]
    assert gain.gain_floor == pytest.approx((1 - LEARNT**2) * right)
    assert method.seen == [["scene0", "scene1", "scene2"]] * 2


def test_our_matcher_replaces_missing_device_depth(method):
    assert learn(method, {}, device=False) == learn(method, {})


def test_true_effect_absorbs_the_gain_and_surrogate_does_not(method):
    gain = learn(method, {"true": 1.0}).absorption
    assert gain.gain_after is not None
    assert 0 < gain.gain_after == gain.gain_floor < gain.gain_before
    assert gain.share == pytest.approx(1) and gain.interval == pytest.approx((1, 1))
    imitated = learn(method, {"imitating": 1.0}).absorption
    assert imitated.closable and imitated.share == pytest.approx(0)
    assert imitated.gain_after == imitated.gain_before == gain.gain_before


def test_one_scene_gives_no_interval(method):
    many: Any = [FakeScene(0), FakeScene(1)]
    gain = residual.learn_residual(method, many[:1], many[1:], {"true": 1.0}).absorption
    assert gain.share == pytest.approx(1) and gain.interval is None


def test_no_gain_has_no_share(method, monkeypatch):
    monkeypatch.setattr(
        Knowing, "probability", lambda self, example: physics_probability(example.physics)
    )
    gain = learn(method, {"true": 1.0}).absorption
    assert gain.gain_before == gain.gain_after == gain.gain_floor == 0
    assert not gain.closable and gain.share is gain.interval is None


def test_held_out_scene_is_required(method):
    training: Any = [FakeScene(0)]
    with pytest.raises(InputError, match="held-out scenes must be at least 1; got 0"):
        residual.learn_residual(method, training, [], {})
    assert method.seen == []


def test_mean_ignores_missing_figures():
    many = [{"a": 1.0, "b": float("nan")}, {"a": 3.0, "b": 2.0}, {"a": 2.0, "b": 4.0}]
    assert residual._mean(many) == {"a": 2.0, "b": 3.0}
    assert np.isnan(residual._mean([{"a": float("nan")}])["a"])
