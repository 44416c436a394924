"""Steps of a disparity, told from depth maps alone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.transfer import quantisation_step
from starling.diagnosis.which import attribution, segment
from starling.diagnosis.which.candidates import Arm
from starling.sim.captures import capture
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets

_FB = 25.0  # Focal length times baseline [px m].


def maps(step_px: float, unit_m: float = 0.001, *, count: int = 3) -> list[np.ndarray]:
    """Slanted surfaces 0.8 to 3 m away, in steps, written as whole units of depth."""
    rng = np.random.default_rng(0)
    found = []
    for _ in range(count):
        near, far = np.sort(rng.uniform(0.8, 3.0, 2))
        disparity = np.linspace(_FB / far, _FB / near, 120 * 160).reshape(120, 160)
        if step_px:
            disparity = step_px * np.rint(disparity / step_px)
        depth_m = unit_m * np.rint(_FB / disparity / unit_m)
        found.append(np.where(rng.random(disparity.shape) < 0.1, np.nan, _FB / depth_m))
    return found


@given(st.floats(1 / 16, 0.48))
def test_a_step_is_told_to_a_thousandth(step_px):
    """Not its half or third, whose waves are as high."""
    assert quantisation_step.step_px(maps(step_px)) == pytest.approx(step_px, rel=1e-3)


def test_fine_steps_are_told_in_fine_units():
    assert quantisation_step.step_px(maps(1 / 32, 0.0001)) == pytest.approx(1 / 32, rel=1e-3)


def test_without_terraces_or_depth_there_is_no_step():
    assert quantisation_step.step_px(maps(0.0)) is None
    assert quantisation_step.step_px([]) is None
    assert quantisation_step.step_px([np.full((4, 4), np.nan)]) is None


def test_what_is_right_before_the_camera_has_no_say():
    """A pixel of one millimetre stands at a disparity of 25,000 px."""
    found = maps(0.25)
    found[0][0, 0] = _FB / 0.001
    assert quantisation_step.step_px(found) == pytest.approx(0.25, rel=1e-3)
    assert quantisation_step.step_px([np.full((4, 4), _FB / 0.001)]) is None


def test_a_scene_without_depth_takes_nothing_from_the_others():
    empty = np.full((120, 160), np.nan)
    assert quantisation_step.step_px([*maps(0.25), empty]) == quantisation_step.step_px(maps(0.25))


def test_a_real_d415_counts_in_thirty_seconds_of_a_pixel(captures):
    """As the preset has it; no number of the preset has a say in what is told."""
    found = []
    for scene in capture.open_set(captures / "d415-faro").scenes:
        depth_m = scene.frame(scene.frames[0]).depth_m
        assert depth_m is not None
        found.append(scene.info.disparity_px(depth_m))
    assert quantisation_step.step_px(found) == pytest.approx(1 / 32, rel=1e-4)


@pytest.mark.parametrize("step_px, told", [(0.2371, True), (0.0, False)])
def test_the_step_that_is_told_is_tried(step_px, told):
    """Of the device's depth; images and their depth by our matcher tell nothing of it."""
    real = SimpleNamespace(device_px=np.stack(maps(step_px)))
    one: Any = SimpleNamespace(
        sensor=presets.load("d435"), scene=scenes.clutter(1), nuisances={}, against=None, real=real
    )
    without: Any = SimpleNamespace(**{**vars(one), "real": SimpleNamespace(device_px=None)})
    bench: Any = SimpleNamespace(arm=Arm.DEPTH, subjects=[one, without])
    listed = attribution.tried(Arm.DEPTH, bench.subjects)
    tried = {each.name: each for each in segment.told(listed, bench)}
    found = tried["subpixel_steps"].told
    assert found == (pytest.approx(step_px, rel=1e-3) if told else None)
    assert [each.name for each in tried.values() if each.told] == ["subpixel_steps"] * told
    images: Any = SimpleNamespace(arm=Arm.IMAGE, subjects=[one])
    assert all(
        each.told is None
        for each in segment.told(attribution.tried(Arm.IMAGE, images.subjects), images)
    )
