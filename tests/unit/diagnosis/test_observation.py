"""Observations: reading of repeats, and the noise of one more exposure."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from starling.diagnosis.scenes import observation
from starling.diagnosis.scenes.observation import (
    DepthObservation,
    FullObservation,
    StereoObservation,
)
from starling.patterns.errors import InputError
from starling.sim.captures.capture import Frame
from starling.sim.imaging.imager import converter
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values

SHAPE = (96, 160)
SENSOR = with_values(
    presets.load("d435"),
    [
        *(("width", SHAPE[1]), ("height", SHAPE[0]), ("cx_px", 79.5), ("cy_px", 47.5)),
        ("matcher.search_px", 32),
    ],
)
DARK = with_values(SENSOR, [("projector.power_w", 0.0)])


def image(level: int) -> np.ndarray:
    rng = np.random.default_rng(level)
    return (level + rng.integers(0, 9, SHAPE)).astype(np.uint8)


def depth(metres: float) -> np.ndarray:
    return np.full(SHAPE, metres, np.float32)


class FakeScene:
    """Frames in memory; disparity is 1 over depth."""

    name = "attic"

    def __init__(self, *frames: Frame) -> None:
        self.frames = tuple(range(len(frames)))
        self.frame = frames.__getitem__
        self.info: Any = self

    def disparity_px(self, depth_m: np.ndarray) -> np.ndarray:
        return 1 / depth_m


def read(*frames: Frame, sensor: Any = SENSOR) -> observation.SceneObservation:
    scene: Any = FakeScene(*frames)
    return observation.read_observation(scene, sensor)


def test_pair_and_depth_are_of_the_same_repeat():
    bare = Frame(number=0, depth_m=depth(1.0), record={"exposure_s": 1.0, "gain": 1.0})
    whole = Frame(
        number=1,
        ir_left=image(50),
        ir_right=image(60),
        depth_m=depth(2.0),
        record={"exposure_s": 2.0, "gain": 1.0},
    )
    blind = Frame(number=2, ir_left=image(70), ir_right=image(80))
    read_back = read(bare, whole, blind)
    assert isinstance(read_back, FullObservation) and read_back.repeats == 1
    np.testing.assert_array_equal(read_back.left[0], whole.ir_left)
    assert (read_back.device_px == 0.5).all()
    (exposure,) = read_back.exposures
    assert exposure.exposure_s == 2.0


@pytest.mark.parametrize("beyond", [-1, 0, 1])
def test_only_the_first_repeats_are_read(beyond: int) -> None:
    count = observation.MOST_REPEATS + beyond
    frames = [Frame(number=n, depth_m=depth(1.0 + n)) for n in range(count)]
    read_back = read(*frames)
    assert read_back.repeats == min(count, observation.MOST_REPEATS)


def test_without_complete_repeats_pairs_take_priority_over_depth():
    bare = Frame(number=0, depth_m=depth(1.0))
    pair = Frame(number=1, ir_left=image(50), ir_right=image(60))
    read_back = read(bare, pair)
    assert type(read_back) is StereoObservation
    alone = read(bare, Frame(number=1, ir_left=image(50)))  # One image is no pair.
    assert type(alone) is DepthObservation and alone.repeats == 1
    with pytest.raises(InputError, match="scene attic must hold infrared pairs or depth"):
        read(Frame(number=0, ir_left=image(50)))


def test_without_projector_the_unlit_pairs_are_read():
    frame = Frame(
        number=0,
        ir_left=image(50),
        ir_right=image(60),
        ir_left_off=image(20),
        ir_right_off=image(30),
        depth_m=depth(1.0),
    )
    lit, off = read(frame), read(frame, sensor=DARK)
    assert type(lit) is FullObservation and not lit.unlit
    assert type(off) is StereoObservation and off.unlit
    np.testing.assert_array_equal(off.left[0], frame.ir_left_off)
    plain = Frame(number=0, ir_left=image(50), ir_right=image(60))
    assert not read(plain, sensor=DARK).unlit


def added_noise(level: int, sensor: Any) -> list[np.ndarray]:
    """Return the noise of one more exposure in uniform images, left and right."""
    flat = np.full((1, 400, 400), level, np.uint8)
    still = StereoObservation(left=flat, right=flat, ours_px=flat.astype(np.float32))
    first, second = (
        observation.add_exposure_noise(still, sensor, np.random.default_rng(seed))
        for seed in (3, 4)
    )
    noise = []
    for a, b in ((first.left, second.left), (first.right, second.right)):
        assert a.dtype == np.uint8
        noise.append((a[0].astype(float) - b[0]) / np.sqrt(2))
    return noise


def test_the_noise_of_one_more_exposure_is_smoothed_by_the_device():
    """Law: smoothing scales the variance by the sum of squared weights, and correlates pixels."""
    device = with_values(SENSOR, [("imager.smoothing_px", 0.6)])
    rounding = 1 / 12
    (alone, _), (averaged, _) = added_noise(80, SENSOR), added_noise(80, device)
    point = np.zeros((11, 11), np.float32)
    point[5, 5] = 1
    spot = converter.smooth(point, 0.6)
    squares = float((spot**2).sum())
    assert averaged.var() - rounding == pytest.approx(squares * (alone.var() - rounding), rel=0.05)
    correlation = (averaged[:, 1:] * averaged[:, :-1]).mean() / (averaged.var() - rounding)
    assert correlation == pytest.approx(
        float((spot[:, 1:] * spot[:, :-1]).sum()) / squares, abs=0.02
    )
    assert abs((alone[:, 1:] * alone[:, :-1]).mean()) < 0.03


def test_noise_below_half_a_code_changes_the_right_share_of_codes():
    """Law: noise of sigma changes a share of 0.8 sigma of levels that are uniform in a code."""
    quiet = with_values(
        SENSOR,
        [("imager.shot_noise", 0.0), ("imager.read_noise_e", 0.1 / SENSOR.left.dn_per_electron)],
    )
    flat = np.full((1, 400, 400), 80, np.uint8)
    still = StereoObservation(left=flat, right=flat, ours_px=flat.astype(np.float32))
    exposed = observation.add_exposure_noise(still, quiet, np.random.default_rng(3)).left
    share = float(np.sqrt(2 / np.pi)) * 0.1
    assert (exposed != 80).mean() == pytest.approx(share, rel=0.25)


@pytest.mark.parametrize("level, shot", [(80, 1.0), (80, 0.6), (20, 0.6)])
def test_the_noise_of_one_more_exposure_follows_photon_transfer(level: int, shot: float):
    """Law: its variance is shot^2 g S + (g r)^2, S being the signal above black [DN]."""
    edits = [("imager.shot_noise", shot), ("imager.read_noise_e", 9.0), ("imager.gain", 2.0)]
    device = with_values(SENSOR, [*edits, ("imager.black_level_dn", 6.0)])
    scale = device.left.dn_per_electron
    expected = shot**2 * scale * (level - 6.0) + (scale * 9.0) ** 2
    for noise in added_noise(level, device):
        assert noise.var() - 1 / 12 == pytest.approx(expected, rel=0.05)
