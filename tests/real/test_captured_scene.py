"""A simulated real room: minimum agreement with the real frame."""

import numpy as np
import pytest

from starling.sim import metrics, simulate
from starling.sim.captures.capture import open_set
from starling.sim.scene import sources
from starling.sim.scene.captured import captured_scene
from starling.sim.sensor import resolve
from starling.sim.stereo.depth import disparity_from_depth


@pytest.fixture(scope="module")
def reading(captures):
    """The real frame and the simulated shot of scene 3617 of the D415 set."""
    path = captures / "d415-faro" / "3617"
    sensor = resolve.load("d415", captures=str(path))
    shot = simulate.simulate(sources.load(str(path), sensor), sensor)
    return open_set(path).scenes[0], sensor, shot


@pytest.mark.long
def test_room_has_its_captured_position(reading):
    """The simulated ground truth equals the reference depth, except for smoothing."""
    scene, sensor, shot = reading
    inputs = {"focal_px": sensor.fx_px, "baseline_m": sensor.baseline_m}
    truth = disparity_from_depth(scene.truth_m(), **inputs)
    seen = disparity_from_depth(shot.layers.truth.depth_m, **inputs)
    error = (seen - truth)[metrics.scored_pixels(truth)]
    assert np.nanmedian(np.abs(error)) < 0.05
    assert np.isfinite(shot.layers.truth.depth_m).mean() > 0.995


@pytest.mark.long
def test_the_simulated_infrared_looks_like_the_real_one(reading):
    """Low-passed over the dots, the two images agree pixel by pixel."""
    import cv2

    scene, _, shot = reading
    real = cv2.GaussianBlur(scene.frame(0).ir_left.astype(np.float32), (0, 0), 6)
    sim = cv2.GaussianBlur(shot.ir_left.astype(np.float32), (0, 0), 6)
    assert np.corrcoef(real.ravel(), sim.ravel())[0, 1] > 0.9


@pytest.mark.long
def test_holes_are_where_the_device_has_them(reading):
    """Far better than chance: random holes with both rates would overlap by less than 1 %."""
    scene, _, shot = reading
    reached = metrics.reached_pixels(scene.truth_m())
    assert metrics.hole_overlap(scene.frame(0).depth_m, shot.depth.depth_m, reached) > 0.2


def test_refusals(captures):
    from starling.patterns import InputError

    sensor = resolve.load("d415")
    with pytest.raises(InputError, match=r"scene must have truth.png and ir_left.png"):
        captured_scene.load(captures / "kinect-v1-tables" / "learn0", sensor)
    with pytest.raises(InputError, match="scene must be one scene of a capture set"):
        captured_scene.load(captures / "d415-faro", sensor)
