"""Disparity steps estimated from depth maps."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.scenes.observation import DepthObservation, StereoObservation
from starling.diagnosis.transfer import quantisation_step
from starling.diagnosis.which.attribution import segment_candidates
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.segment import add_measured_values
from starling.sim.captures import capture
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets

_FB = 25.0  # Focal length times baseline [px m].


def maps(step_px: float, unit_m: float = 0.001, *, count: int = 3) -> list[np.ndarray]:
    """Return slanted surfaces at 0.8 to 3 m, quantised in disparity and in depth."""
    rng = np.random.default_rng(0)
    surfaces = []
    for _ in range(count):
        near, far = np.sort(rng.uniform(0.8, 3.0, 2))
        disparity = np.linspace(_FB / far, _FB / near, 120 * 160).reshape(120, 160)
        if step_px:
            disparity = step_px * np.rint(disparity / step_px)
        depth_m = unit_m * np.rint(_FB / disparity / unit_m)
        surfaces.append(np.where(rng.random(disparity.shape) < 0.1, np.nan, _FB / depth_m))
    return surfaces


@given(st.floats(1 / 16, 0.48))
def test_a_step_is_estimated_to_a_thousandth(step_px: float):
    """Not its half or third, whose spectral peaks are as high."""
    assert quantisation_step.estimate_step_px(maps(step_px)) == pytest.approx(step_px, rel=1e-3)


def test_fine_steps_are_found_in_fine_depth_units():
    step_px = quantisation_step.estimate_step_px(maps(1 / 32, 0.0001))
    assert step_px == pytest.approx(1 / 32, rel=1e-3)


def test_without_terraces_or_depth_there_is_no_step():
    assert quantisation_step.estimate_step_px(maps(0.0)) is None
    assert quantisation_step.estimate_step_px([]) is None
    assert quantisation_step.estimate_step_px([np.full((4, 4), np.nan)]) is None


def test_very_near_pixels_are_ignored():
    """A depth of one millimetre is a disparity of 25,000 px."""
    surfaces = maps(0.25)
    surfaces[0][0, 0] = _FB / 0.001
    assert quantisation_step.estimate_step_px(surfaces) == pytest.approx(0.25, rel=1e-3)
    assert quantisation_step.estimate_step_px([np.full((4, 4), _FB / 0.001)]) is None


def test_a_scene_without_depth_has_no_influence():
    empty = np.full((120, 160), np.nan)
    step_px = quantisation_step.estimate_step_px([*maps(0.25), empty])
    assert step_px == quantisation_step.estimate_step_px(maps(0.25))


def test_a_real_d415_has_steps_of_a_thirty_second_of_a_pixel(captures):
    """The preset has the same value, and the estimate does not use it."""
    maps_px = []
    for scene in capture.open_set(captures / "d415-faro").scenes:
        depth_m = scene.frame(scene.frames[0]).depth_m
        assert depth_m is not None
        maps_px.append(scene.info.disparity_px(depth_m))
    assert quantisation_step.estimate_step_px(maps_px) == pytest.approx(1 / 32, rel=1e-4)


@pytest.mark.parametrize("step_px, has_step", [(0.2371, True), (0.0, False)])
def test_the_estimated_step_is_a_node(step_px: float, has_step: bool):
    """In the depth segment only, because it is estimated from device depth."""
    real = DepthObservation(device_px=np.stack(maps(step_px)))
    scene: Any = SimpleNamespace(
        sensor=presets.load("d435"), scene=scenes.clutter(1), nuisances={}, against=None, real=real
    )
    dark = np.zeros((1, 2, 2), np.uint8)
    pair = StereoObservation(left=dark, right=dark, ours_px=np.zeros((1, 2, 2), np.float32))
    without: Any = SimpleNamespace(**{**vars(scene), "real": pair})
    table: Any = SimpleNamespace(segment=Segment.DEPTH, scene_models=[scene, without])
    listed = segment_candidates(Segment.DEPTH, table.scene_models)
    tried = {candidate.name: candidate for candidate in add_measured_values(listed, table)}
    measured = tried["subpixel_steps"].measured
    assert measured == (pytest.approx(step_px, rel=1e-3) if has_step else None)
    names = [candidate.name for candidate in tried.values() if candidate.measured]
    assert names == ["subpixel_steps"] * has_step
    images: Any = SimpleNamespace(segment=Segment.IMAGE, scene_models=[scene])
    listed = segment_candidates(Segment.IMAGE, images.scene_models)
    assert all(candidate.measured is None for candidate in add_measured_values(listed, images))
