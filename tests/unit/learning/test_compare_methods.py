"""`starling compare --methods`: holes that methods draw beside the device's."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from starling.learning.commands import compare_methods
from starling.learning.commands.train_captures import train_captures
from starling.learning.data import captured, simulated
from starling.learning.data.captured import Simulation
from starling.learning.data.example import Example, Image, Physics
from starling.learning.data.learnable import known_holes
from starling.learning.features import holes
from starling.learning.methods.perfect import PerfectPredictor
from starling.learning.methods.physics import SimulatedPredictor
from starling.patterns.errors import InputError
from starling.sim.captures.capture import CaptureSet, open_set
from starling.sim.console import record
from starling.sim.plotting import sheet
from starling.sim.reason import Reason
from tests.unit.learning import capture_sets
from tests.unit.learning.step_scenes import SHAPE, step_scene

SIMULATION = Simulation(sensor=capture_sets.sensor())
DISTANCES = ("area_ks", "perimeter_ks", "run_ks")


class Device:
    """A predictor that knows the device's holes."""

    def probability(self, example: Example) -> Image:
        return known_holes(example)[0].astype(np.float32)


class Half:
    """A predictor that tells the same probability everywhere."""

    def probability(self, example: Example) -> Image:
        return np.full(example.depth_m.shape, 0.5, np.float32)


@pytest.fixture
def captures(tmp_path: Path) -> CaptureSet:
    return open_set(capture_sets.write(tmp_path / "set"))


@pytest.fixture
def titles(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Titles of the panels of the sheet that is drawn, by row; drawing itself takes time."""
    found: list[list[str]] = []

    def spied(rows, shape, **_):
        assert shape == SHAPE
        found.extend([panel.draw.keywords["title"] for panel in row] for row in rows)
        return b"picture"

    monkeypatch.setattr(sheet, "draw", spied)
    return found


def _mean_share(captures: CaptureSet) -> float:
    return captured.ndp_rate(captured.examples(captures))


@pytest.mark.usefixtures("titles")
def test_a_perfect_camera_draws_no_hole(captures):
    found, _ = compare_methods.compare_methods(captures, {"perfect": PerfectPredictor()})
    assert found["real"] == {"ndp_rate": pytest.approx(_mean_share(captures))}
    perfect = found["methods"]["perfect"]
    assert (perfect["ndp_rate"], perfect["ndp_iou"], perfect["auc"]) == (0, 0, 0.5)
    assert all(math.isnan(perfect[name]) for name in DISTANCES)  # No hole has no distribution.
    said = json.loads(record.dumps(found))
    assert said["methods"]["perfect"]["area_ks"] is None


@pytest.mark.usefixtures("titles")
def test_the_device_s_own_holes_are_at_no_distance(captures):
    found, _ = compare_methods.compare_methods(captures, {"device": Device()})
    device = found["methods"]["device"]
    assert device["ndp_rate"] == pytest.approx(found["real"]["ndp_rate"])
    assert [device[name] for name in ("ndp_iou", "auc", "brier")] == [1, 1, 0]
    assert {device[name] for name in DISTANCES} == {0.0}


@pytest.mark.usefixtures("titles")
def test_physics_that_never_has_depth_draws_holes_everywhere(captures, monkeypatch):
    """Share 1 in all draws is told as nearly 1, above the threshold of sure holes."""
    physics = step_scene(0).physics
    assert physics is not None
    nothing = dataclasses.replace(
        physics,
        ndp=np.ones(SHAPE, np.float32),
        disparity_px=np.full(SHAPE, np.nan, np.float32),
        one_draw_px=np.full(SHAPE, np.nan, np.float32),
        reason=np.full(SHAPE, Reason.LOW_SIGNAL, np.uint32),
    )
    monkeypatch.setattr(simulated, "physics", lambda *_, **__: nothing)
    methods = {"physics": SimulatedPredictor()}
    found, _ = compare_methods.compare_methods(captures, methods, simulation=SIMULATION)
    physics_figures = found["methods"]["physics"]
    assert physics_figures["ndp_rate"] == 1
    # Scenes count the same number of pixels: what is common is the device's share.
    assert physics_figures["ndp_iou"] == pytest.approx(found["real"]["ndp_rate"])
    counted = captured.examples(captures)[0].counted
    assert counted is not None
    real = [holes.measure(*known_holes(e)) for e in captured.examples(captures)]
    one = holes.measure(counted, counted)
    distance = holes.distance(one.area_px, holes.pool(real).area_px)
    assert physics_figures["area_ks"] == pytest.approx(distance.kolmogorov_smirnov)


@pytest.mark.usefixtures("titles")
def test_half_the_pixels_are_drawn_at_a_half_and_a_seed_fixes_which(captures):
    """Noise of 9 px on images of 64x48 px has some 38 independent patches, so that the share of a
    half deviates by 8 %, and the mean of ten draws by 2.6 %; held to three times that."""
    methods = {"half": Half()}
    told = [
        compare_methods.compare_methods(captures, methods, seed=seed)[0]["methods"]["half"]
        for seed in (*range(10), 0)
    ]
    assert np.mean([one["ndp_rate"] for one in told[:10]]) == pytest.approx(0.5, abs=0.08)
    assert told[0] == told[10]
    assert len({one["ndp_iou"] for one in told}) == 10
    assert {one["auc"] for one in told} == {0.5}  # Of the probability, which draws nothing.


def test_scenes_have_noise_of_their_own(captures, monkeypatch):
    drawn = []
    measure = holes.measure
    monkeypatch.setattr(
        holes, "measure", lambda ndp, where: drawn.append(ndp) or measure(ndp, where)
    )
    compare_methods.compare_methods(captures, {"half": Half()})
    masks = drawn[1::2]  # The device's and the method's in turn.
    assert len({mask.tobytes() for mask in masks}) == len(captures.scenes)


def test_the_first_four_scenes_are_shown_with_the_device_and_every_method(tmp_path, titles):
    rooms = (*capture_sets.ROOMS, "vault")
    captures = open_set(capture_sets.write(tmp_path / "set", rooms=rooms))
    methods = {"perfect": PerfectPredictor(), "half": Half()}
    found, picture = compare_methods.compare_methods(captures, methods)
    assert list(found["methods"]) == ["perfect", "half"]
    assert picture == b"picture"
    assert titles == [[f"{name}: device", "perfect", "half"] for name in capture_sets.SCENES]


def test_the_picture_is_a_png_as_large_as_its_panels(tmp_path):
    """One method less is a column less: columns of one width, rows of one height."""
    shapes = {}
    for rooms in (1, 2):
        path = capture_sets.write(tmp_path / f"{rooms}", rooms=capture_sets.ROOMS[:rooms])
        for count in (1, 2):
            methods = {f"perfect {n}": PerfectPredictor() for n in range(count)}
            _, picture = compare_methods.compare_methods(open_set(path), methods)
            assert picture.startswith(b"\x89PNG")
            image = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
            assert image is not None
            shapes[rooms, count] = image.shape[:2]
    heights, widths = zip(*(shapes[key] for key in ((1, 1), (1, 2), (2, 1), (2, 2))), strict=True)
    assert heights[0] == heights[1] and heights[2] == heights[3]
    assert widths[0] == widths[2] and widths[1] == widths[3]
    assert heights[2] / heights[0] == pytest.approx(2, rel=0.05)
    assert widths[1] / widths[0] == pytest.approx(1.5, rel=0.05)


def test_only_what_builds_on_physics_has_the_simulator_s_errors(captures, monkeypatch):
    """Simulated 0.5 px too near everywhere: physics draws f b / (d + 0.5), perfect f b / d."""
    drawn = []
    info = captures.info

    def made(*_: object, **__: object) -> Physics:
        physics = step_scene(0).physics
        assert physics is not None
        disparity = info.disparity_px(capture_sets.drawn(0)[0]) + np.float32(0.5)
        return dataclasses.replace(physics, one_draw_px=disparity)

    def spied(rows, shape, **_):
        drawn.extend(panel.draw.keywords["depth_m"] for panel in rows[0])
        return b""

    monkeypatch.setattr(simulated, "physics", made)
    monkeypatch.setattr(sheet, "draw", spied)
    one = dataclasses.replace(captures, scenes=captures.scenes[:1])
    methods = {"physics": PerfectPredictor(), "perfect": PerfectPredictor()}
    compare_methods.compare_methods(one, methods, simulation=SIMULATION)
    device, physics, perfect = drawn
    known = np.isfinite(perfect)
    assert np.isnan(device).any() and known[capture_sets.UNKNOWN.stop :].all()
    reference = capture_sets.drawn(0)[0]
    expected = 4.0 / (4.0 / reference + 0.5)
    np.testing.assert_allclose(physics[known], expected[known], rtol=5e-3)  # Steps of 1 mm.
    np.testing.assert_allclose(perfect[known], reference[known], atol=5e-4)


def test_methods_are_names_or_folders_of_trained_models(tmp_path):
    captures = capture_sets.write(tmp_path / "set")
    train_captures("simple", str(captures), tmp_path / "model")
    found = compare_methods.predictors(["physics", str(tmp_path / "model"), "perfect"])
    assert list(found) == ["physics", "simple", "perfect"]
    assert found["physics"] == SimulatedPredictor()
    for again in ("perfect", "perfect"), (str(tmp_path / "model"),) * 2:
        name = "perfect" if again[0] == "perfect" else "simple"
        with pytest.raises(InputError) as caught:
            compare_methods.predictors(again)
        assert str(caught.value) == f"methods must be different; got {name}. Name each once."
    with pytest.raises(InputError, match="model must be a folder that `starling train` has finis"):
        compare_methods.predictors(["trees"])


def test_physics_without_a_simulation_is_refused(captures):
    with pytest.raises(InputError, match="physics must be given to a method that builds on it"):
        compare_methods.compare_methods(captures, {"physics": SimulatedPredictor()})


def test_captures_without_depth_are_refused(captures):
    (captures.scenes[0].path / "0" / "depth.png").unlink()
    with pytest.raises(InputError, match=r"scene attic-view must have .*; got no depth\.png"):
        compare_methods.compare_methods(captures, {"perfect": PerfectPredictor()})
