"""What a camera gave of a scene, repeat by repeat."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from starling.diagnosis.scenes import observation
from starling.patterns.errors import InputError
from starling.sim.captures.capture import Frame
from starling.sim.imaging.imager import smoothing
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


def read(*frames: Frame, sensor: Any = SENSOR) -> observation.Reading:
    scene: Any = FakeScene(*frames)
    return observation.read(scene, sensor)


def test_a_pair_stands_beside_the_depth_of_its_own_repeat():
    bare = Frame(number=0, depth_m=depth(1.0), record={"exposure_s": 1.0, "gain": 1.0})
    whole = Frame(
        number=1,
        ir_left=image(50),
        ir_right=image(60),
        depth_m=depth(2.0),
        record={"exposure_s": 2.0, "gain": 1.0},
    )
    blind = Frame(number=2, ir_left=image(70), ir_right=image(80))
    found = read(bare, whole, blind)
    assert found.repeats == 1 and found.left is not None and found.device_px is not None
    np.testing.assert_array_equal(found.left[0], whole.ir_left)
    assert (found.device_px == 0.5).all()
    assert found.exposure is not None and found.exposure.exposure_s == 2.0


def test_where_no_repeat_has_both_pairs_come_before_depth():
    bare = Frame(number=0, depth_m=depth(1.0))
    pair = Frame(number=1, ir_left=image(50), ir_right=image(60))
    found = read(bare, pair)
    assert found.left is not None and found.device_px is None
    alone = read(bare, Frame(number=1, ir_left=image(50)))  # One imager alone is no pair.
    assert alone.left is None and alone.device_px is not None and alone.repeats == 1
    with pytest.raises(InputError, match="scene attic must hold infrared pairs or depth"):
        read(Frame(number=0, ir_left=image(50)))


def test_without_projector_the_pairs_that_were_captured_so_are_taken():
    frame = Frame(
        number=0,
        ir_left=image(50),
        ir_right=image(60),
        ir_left_off=image(20),
        ir_right_off=image(30),
        depth_m=depth(1.0),
    )
    lit, off = read(frame), read(frame, sensor=DARK)
    assert lit.left is not None and not lit.unlit and lit.device_px is not None
    assert off.left is not None and off.unlit and off.device_px is None
    np.testing.assert_array_equal(off.left[0], frame.ir_left_off)
    plain = Frame(number=0, ir_left=image(50), ir_right=image(60))
    assert not read(plain, sensor=DARK).unlit


def added(level: int, sensor: Any) -> list[np.ndarray]:
    """What one more exposure adds to even images, left and right: the difference of two."""
    flat = np.full((1, 400, 400), level, np.uint8)
    still = observation.Reading(left=flat, right=flat, ours_px=None, device_px=None)
    one, other = (
        observation.exposed_again(still, sensor, np.random.default_rng(seed)) for seed in (3, 4)
    )
    pairs = ((one.left, other.left), (one.right, other.right))
    found = []
    for first, second in pairs:
        assert first is not None and second is not None and first.dtype == np.uint8
        found.append((first[0].astype(float) - second[0]) / np.sqrt(2))
    return found


def test_one_more_exposure_is_averaged_as_the_device_averages_codes():
    """Law: noise keeps the square of what averaging along an axis keeps, and is correlated."""
    device = with_values(SENSOR, [("imager.smoothing_px", 0.6)])
    rounding = 1 / 12
    (alone, _), (averaged, _) = added(80, SENSOR), added(80, device)
    point = np.zeros((11, 11), np.float32)
    point[5, 5] = 1
    spot = smoothing.smoothed(point, 0.6)
    kept = float((spot**2).sum())
    assert averaged.var() - rounding == pytest.approx(kept * (alone.var() - rounding), rel=0.05)
    beside = (averaged[:, 1:] * averaged[:, :-1]).mean() / (averaged.var() - rounding)
    assert beside == pytest.approx(float((spot[:, 1:] * spot[:, :-1]).sum()) / kept, abs=0.02)
    assert abs((alone[:, 1:] * alone[:, :-1]).mean()) < 0.03


def test_noise_weaker_than_half_a_code_turns_as_many_codes_as_it_would():
    """Law: of levels evenly over a code, noise of sigma carries 0.8 sigma over an edge."""
    quiet = with_values(
        SENSOR,
        [("imager.shot_noise", 0.0), ("imager.read_noise_e", 0.1 / SENSOR.left.dn_per_electron)],
    )
    flat = np.full((1, 400, 400), 80, np.uint8)
    still = observation.Reading(left=flat, right=flat, ours_px=None, device_px=None)
    found = observation.exposed_again(still, quiet, np.random.default_rng(3)).left
    assert found is not None
    share = float(np.sqrt(2 / np.pi)) * 0.1
    assert (found != 80).mean() == pytest.approx(share, rel=0.25)


@pytest.mark.parametrize("level, shot", [(80, 1.0), (80, 0.6), (20, 0.6)])
def test_one_more_exposure_has_the_noise_of_photon_transfer(level: int, shot: float):
    """Law: its variance is shot^2 g S + (g r)^2, S being the signal above black [DN]."""
    edits = [("imager.shot_noise", shot), ("imager.read_noise_e", 9.0), ("imager.gain", 2.0)]
    device = with_values(SENSOR, [*edits, ("imager.black_level_dn", 6.0)])
    scale = device.left.dn_per_electron
    wanted = shot**2 * scale * (level - 6.0) + (scale * 9.0) ** 2
    for noise in added(level, device):
        assert noise.var() - 1 / 12 == pytest.approx(wanted, rel=0.05)
