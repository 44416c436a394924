"""`starling compare --methods`: sampled holes compared with the device's."""

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
from starling.learning.data.example import Example, Image, Physics, known_holes
from starling.learning.features import holes
from starling.learning.methods.baselines import PerfectPredictor
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
    """A predictor with one probability for all pixels."""

    def probability(self, example: Example) -> Image:
        return np.full(example.depth_m.shape, 0.5, np.float32)


@pytest.fixture
def captures(tmp_path: Path) -> CaptureSet:
    return open_set(capture_sets.write(tmp_path / "set"))


@pytest.fixture
def titles(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Titles of the panels of the drawn sheet, by row; drawing is skipped because it is slow."""
    result: list[list[str]] = []

    def spied(rows, shape, **_):
        assert shape == SHAPE
        result.extend([panel.draw.keywords["title"] for panel in row] for row in rows)
        return b"picture"

    monkeypatch.setattr(sheet, "draw", spied)
    return result


def _mean_share(captures: CaptureSet) -> float:
    return captured.ndp_rate(captured.examples(captures))


@pytest.mark.usefixtures("titles")
def test_a_perfect_camera_has_no_holes(captures):
    result, _ = compare_methods.compare_methods(captures, {"perfect": PerfectPredictor()})
    assert result["real"] == {"ndp_rate": pytest.approx(_mean_share(captures))}
    perfect = result["methods"]["perfect"]
    assert (perfect["ndp_rate"], perfect["ndp_iou"], perfect["auc"]) == (0, 0, 0.5)
    # Without holes there is no distribution.
    assert all(math.isnan(perfect[name]) for name in DISTANCES)
    message = json.loads(record.dumps(result))
    assert message["methods"]["perfect"]["area_ks"] is None


@pytest.mark.usefixtures("titles")
def test_the_device_has_no_distance_from_itself(captures):
    result, _ = compare_methods.compare_methods(captures, {"device": Device()})
    device = result["methods"]["device"]
    assert device["ndp_rate"] == pytest.approx(result["real"]["ndp_rate"])
    assert [device[name] for name in ("ndp_iou", "auc", "brier")] == [1, 1, 0]
    assert {device[name] for name in DISTANCES} == {0.0}


@pytest.mark.usefixtures("titles")
def test_physics_without_depth_has_holes_everywhere(captures, monkeypatch):
    physics = step_scene(0).physics
    assert physics is not None
    nothing = dataclasses.replace(
        physics,
        ndp=np.ones(SHAPE, np.float32),
        disparity_px=np.full(SHAPE, np.nan, np.float32),
        one_draw_px=np.full(SHAPE, np.nan, np.float32),
        one_draw_ndp=np.ones(SHAPE, bool),
        reason=np.full(SHAPE, Reason.LOW_SIGNAL, np.uint32),
    )
    monkeypatch.setattr(simulated, "physics", lambda *_, **__: nothing)
    methods = {"physics": SimulatedPredictor()}
    result, _ = compare_methods.compare_methods(captures, methods, simulation=SIMULATION)
    physics_figures = result["methods"]["physics"]
    assert physics_figures["ndp_rate"] == 1
    # All scenes have the same number of counted pixels.
    assert physics_figures["ndp_iou"] == pytest.approx(result["real"]["ndp_rate"])
    counted = captured.examples(captures)[0].counted
    assert counted is not None
    real = [holes.measure(*known_holes(e)) for e in captured.examples(captures)]
    item = holes.measure(counted, counted)
    distance = holes.distance(item.area_px, holes.pool(real).area_px)
    assert physics_figures["area_ks"] == pytest.approx(distance.kolmogorov_smirnov)


@pytest.mark.usefixtures("titles")
def test_a_probability_of_one_half_gives_half_of_the_pixels_by_seed(captures):
    """Noise of 9 px has about 38 independent patches in images of 64x48 px.

    The standard deviation of the share is 8 %, and 2.6 % for the mean of ten draws. The tolerance
    is three times that.
    """
    methods = {"half": Half()}
    report = [
        compare_methods.compare_methods(captures, methods, seed=seed)[0]["methods"]["half"]
        for seed in (*range(10), 0)
    ]
    assert np.mean([item["ndp_rate"] for item in report[:10]]) == pytest.approx(0.5, abs=0.08)
    assert report[0] == report[10]
    assert len({item["ndp_iou"] for item in report}) == 10
    assert {item["auc"] for item in report} == {0.5}  # AUC of the probability, before sampling.


def test_scenes_have_independent_noise(captures, monkeypatch):
    drawn = []
    measure = holes.measure
    monkeypatch.setattr(
        holes, "measure", lambda ndp, where: drawn.append(ndp) or measure(ndp, where)
    )
    compare_methods.compare_methods(captures, {"half": Half()})
    masks = drawn[1::2]  # Alternating masks of the device and the method.
    assert len({mask.tobytes() for mask in masks}) == len(captures.scenes)


def test_the_first_four_scenes_are_shown_with_the_device_and_every_method(tmp_path, titles):
    rooms = (*capture_sets.ROOMS, "vault")
    captures = open_set(capture_sets.write(tmp_path / "set", rooms=rooms))
    methods = {"perfect": PerfectPredictor(), "half": Half()}
    result, picture = compare_methods.compare_methods(captures, methods)
    assert list(result["methods"]) == ["perfect", "half"]
    assert picture == b"picture"
    assert titles == [[f"{name}: device", "perfect", "half"] for name in capture_sets.SCENES]


def test_the_picture_is_a_png_with_the_size_of_its_panels(tmp_path):
    """One method less is one column less."""
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


def test_only_methods_with_physics_have_the_errors_of_the_simulator(captures, monkeypatch):
    """Simulated 0.5 px too near everywhere: physics gives f b / (d + 0.5), perfect f b / d."""
    drawn = []
    info = captures.info

    def built(*_: object, **__: object) -> Physics:
        physics = step_scene(0).physics
        assert physics is not None
        disparity = info.disparity_px(capture_sets.drawn(0)[0]) + np.float32(0.5)
        return dataclasses.replace(physics, one_draw_px=disparity)

    def spied(rows, shape, **_):
        drawn.extend(panel.draw.keywords["depth_m"] for panel in rows[0])
        return b""

    monkeypatch.setattr(simulated, "physics", built)
    monkeypatch.setattr(sheet, "draw", spied)
    item = dataclasses.replace(captures, scenes=captures.scenes[:1])
    methods = {"physics": PerfectPredictor(), "perfect": PerfectPredictor()}
    compare_methods.compare_methods(item, methods, simulation=SIMULATION)
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
    result = compare_methods.predictors(["physics", str(tmp_path / "model"), "perfect"])
    assert list(result) == ["physics", "simple", "perfect"]
    assert result["physics"] == SimulatedPredictor()
    for again in ("perfect", "perfect"), (str(tmp_path / "model"),) * 2:
        name = "perfect" if again[0] == "perfect" else "simple"
        with pytest.raises(InputError) as caught:
            compare_methods.predictors(again)
        assert str(caught.value) == f"methods must be different; got {name}. Name each once."
    with pytest.raises(InputError, match="model must be a folder that `starling train` has finis"):
        compare_methods.predictors(["trees"])


def test_physics_without_a_simulation_is_refused(captures):
    with pytest.raises(InputError, match="physics must be given for a method that uses it"):
        compare_methods.compare_methods(captures, {"physics": SimulatedPredictor()})


def test_captures_without_depth_are_refused(captures):
    (captures.scenes[0].path / "0" / "depth.png").unlink()
    with pytest.raises(InputError, match=r"scene attic-view must have .*; got no depth\.png"):
        compare_methods.compare_methods(captures, {"perfect": PerfectPredictor()})
