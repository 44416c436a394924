"""A camera with one effect, made by the second implementation, and the verb that has to name it.

**Rationale.** Small images and a handful of effects: what is tested is that the parts work
together. How often the right effect is named is told by `starling withheld`, not here.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from starling import command_line
from starling.diagnosis.report import group_names as groups
from starling.diagnosis.scenes import estimated
from starling.diagnosis.scenes import observation as reading
from starling.diagnosis.scenes import scene_model as subject
from starling.diagnosis.validation.adapters import light_sets, own_depth
from starling.diagnosis.validation.protocol import case, shoot
from starling.diagnosis.which import attribution as named
from starling.diagnosis.which import null
from starling.diagnosis.which import table as bench
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.candidates import candidates as all_candidates
from starling.learning import registry
from starling.sim.captures import capture
from starling.sim.sensor import presets as sensors
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from tests.system.test_withheld import nominal

SCENES = ("clutter:1", "clutter:2", "tabletop:3", "clutter:4")
TRIED = ("gamma", "vignetting", "veil", "read_noise", "pixel_locking")
GAMMA = 1.3
LOCKING_PX = 0.1


def sensor() -> Sensor:
    """Without a lens's spot, whose shape is another in the second implementation."""
    return with_values(nominal(), [("imager.lens.blur_px", 0.0)])


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("diagnose")
    light_sets.write(folder / "light", SCENES, sensor())
    (folder / "sensor.toml").write_text(sensors.dumps(sensor()))
    made = (("null", 7, {}), ("other", 8, {}), ("bent", 7, {"gamma": GAMMA}))
    for name, seed, settings in made:
        kind = "single" if settings else "null"
        one = case.Case(number=0, kind=kind, settings=settings, seed=seed)
        shoot.shoot(folder / "light", one, folder / name, frames=2)
    return folder


@pytest.fixture
def diagnosed(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., dict[str, Any]]:
    """Run the verb with few effects in its table, and read what it prints."""
    monkeypatch.setattr(
        named,
        "candidates",
        lambda *asked: [one for one in all_candidates(*asked) if one.name in TRIED],
    )

    def run(captures: Path, *flags: str) -> dict[str, Any]:
        out = place / f"{captures.name}-report"
        base = ["--sensor", str(place / "sensor.toml"), "--out", str(out)]
        cached = ["--cache", str(place / "cache"), "--force", "--json", *flags]
        assert command_line.main(["diagnose", str(captures), *base, *cached]) == 0
        return json.loads(capsys.readouterr().out)

    return run


def test_an_effect_is_named_measured_and_mended(place, diagnosed):
    told = diagnosed(place / "bent", "--fix")
    assert told["verdict"] == "effects"
    (found,) = told["effects"]
    assert found["name"] == "gamma" and found["set"] == ["gamma"]
    low, high = found["interval"]
    assert found["parameters"]["gamma"] == pytest.approx(GAMMA, abs=0.05) and low <= GAMMA <= high
    assert len(told["locked"]) == 1 and set(told["locked"]) < set(told["scenes"])
    features = told["howfar"]["features of the image"]
    assert features["closed_pct"] > 50 and features["after"] < features["before"]
    assert sum(told["shares"].values()) == pytest.approx(1)
    assert told["which"]["image"]["alone"][0]["name"] == found["name"]
    assert all(map(groups.told, told["which"]["image"]["by_group"]))
    assert told["where"]["parts"]["ndp_rate"]["device"] is None
    fixed = sensors.load(str(place / "bent-report" / "sensor.toml"))
    assert sensors.load(str(place / "bent-report" / "base.toml")) == sensor()
    assert fixed.left.gamma == fixed.right.gamma == pytest.approx(found["parameters"]["gamma"])
    assert json.loads((place / "bent-report" / "report.json").read_text())["says"] == told["says"]
    assert "consistent with" in told["says"][1]
    shown = Path(told["report"])
    assert shown.parent == place / "bent-report" and "gamma" in shown.read_text("utf-8")


@pytest.mark.long
def test_a_family_that_is_left_out_is_not_named(place, diagnosed):
    told = diagnosed(place / "bent", "--leave-out", "tone_curve")
    assert told["verdict"] == "none of the known"
    assert "gamma" not in [one["name"] for one in told["effects"]]
    assert told["which"]["image"]["unexplained"] and told["which"]["image"]["lead"]
    assert "None of the known effects" in told["says"][1]


@pytest.mark.long
def test_families_that_are_asked_for_are_tried_alone(place, diagnosed):
    told = diagnosed(place / "bent", "--families", "veil", "vignetting")
    tried = {one["name"] for one in told["which"]["image"]["alone"]}
    assert tried == {"veil", "vignetting"}


def test_where_no_family_acts_that_is_asked_for_nothing_is_told(place, diagnosed, tmp_path, capsys):
    """Another matcher's depth is no verdict on effects of images."""
    shutil.copytree(place / "null", tmp_path / "sets" / "null")
    locked = with_values(sensor(), [("matcher.refinement.locking_px", LOCKING_PX)])
    own_depth.write(tmp_path / "sets", locked)
    told = diagnosed(tmp_path / "sets" / "null", "--families", "tone_curve")
    assert told["verdict"] == "no gap" and not told["which"]["depth"]["unexplained"]
    assert told["which"]["depth"]["beyond"] > told["which"]["depth"]["explained_below"]
    assert any("acts on matcher and filters" in limit for limit in told["limits"])
    flags = ["--sensor", str(place / "sensor.toml"), "--out", str(tmp_path / "out")]
    for family in ("pixel_locking", "rolling_shutter"):  # Of depth, and of nothing at all.
        asked = ["diagnose", str(place / "null"), *flags, "--families", family]
        assert command_line.main(asked) == 1
        said = f"families must have an effect that acts on what these captures hold; got {family}."
        assert said in capsys.readouterr().err


def test_of_no_gap_nothing_is_named(place, diagnosed):
    told = diagnosed(place / "null")
    assert told["verdict"] == "no gap" and told["effects"] == [] and told["howfar"] == {}
    seen = {one["name"]: one for one in told["noticed"]}
    assert seen["gamma"]["below"] < seen["gamma"]["base"] == 1 < seen["gamma"]["above"]
    assert seen["vignetting"]["above"] > 0 and seen["vignetting"]["below"] is None


def test_one_scene_says_what_it_cannot_tell(place, diagnosed):
    told = diagnosed(place / "bent" / "clutter-1")
    assert told["verdict"] == "cannot tell"
    assert any("One room alone" in limit for limit in told["limits"])
    assert any("Not tried" in one and "temporal_filter" in one for one in told["limits"])
    assert told["where"]["maps"] == []


def test_a_capture_set_is_diagnosed_against_another(place, diagnosed):
    told = diagnosed(place / "bent", "--against", str(place / "other"), "--fix")
    assert told["verdict"] == "effects" and told["against"] == str(place / "other")
    (found,) = told["effects"]
    assert found["name"] == "gamma" and found["set"] == ["gamma"]
    assert found["parameters"]["gamma"] == pytest.approx(GAMMA, abs=0.05)
    assert list(told["howfar"]) == ["features of the image"]
    features = told["howfar"]["features of the image"]
    assert features["closed_pct"] > 50 and features["floor"] < features["after"] + 1
    assert told["shares"] == {"gamma": pytest.approx(1)}
    page = Path(told["report"]).read_text("utf-8")
    assert "Two capture sets of the same scenes are compared" in page
    assert "imulated, base" not in page and "in the other captures" in told["says"][0]


@pytest.mark.long
@pytest.mark.parametrize("name", ["other", "null"])
def test_against_another_capture_of_one_camera_there_is_no_gap(place, diagnosed, name):
    told = diagnosed(place / "null", "--against", str(place / name))
    assert told["verdict"] == "no gap" and told["effects"] == []


@pytest.mark.long
def test_two_devices_matchers_are_compared(place, diagnosed, tmp_path):
    """Their images differ by noise alone; one matcher pulls to whole pixels, the other does not."""
    for name, locking_px in (("null", LOCKING_PX), ("other", 0.0)):
        shutil.copytree(place / name, tmp_path / "sets" / name)
        locked = with_values(sensor(), [("matcher.refinement.locking_px", locking_px)])
        own_depth.write(tmp_path / "sets", locked)
    told = diagnosed(tmp_path / "sets" / "null", "--against", str(tmp_path / "sets" / "other"))
    assert [(one["name"], one["arm"]) for one in told["effects"]] == [("pixel_locking", "depth")]
    value = told["effects"][0]["parameters"]["pixel_locking"]
    assert value == pytest.approx(LOCKING_PX, abs=0.02)
    assert told["where"]["parts"]["ndp_rate"]["base_device"] is not None


@pytest.mark.long
def test_scenes_of_one_set_alone_are_left_aside(place, diagnosed, tmp_path):
    fewer = tmp_path / "fewer"
    shutil.copytree(place / "other", fewer)
    shutil.rmtree(fewer / "clutter-2")
    told = diagnosed(place / "null", "--against", str(fewer))
    assert told["scenes"] == ["clutter-1", "clutter-4", "tabletop-3"]
    assert any("left aside: clutter-2." in limit for limit in told["limits"])


def refused_against(place: Path, other: Path, out: Path, capsys: Any) -> str:
    flags = ["--sensor", str(place / "sensor.toml"), "--out", str(out), "--against", str(other)]
    assert command_line.main(["diagnose", str(place / "null"), *flags]) == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert not out.exists()
    return line


def test_captures_that_cannot_be_compared_are_refused(place, tmp_path, capsys):
    out, other = tmp_path / "out", tmp_path / "other"
    shutil.copytree(place / "other", other)
    info = other / "capture.toml"
    text = info.read_text()
    info.write_text(text.replace("baseline_m = ", "baseline_m = 1"))
    assert "must be of one baseline_m" in refused_against(place, other, out, capsys)
    info.write_text(text)
    own = other / "clutter-2" / "camera.toml"
    own.write_text(text.replace("baseline_m = ", "baseline_m = 1"))
    assert "must be of one camera here" in refused_against(place, other, out, capsys)
    own.unlink()
    for scene in capture.open_set(other).scenes:
        for number in scene.frames:
            frame = scene.path / str(number)
            (frame / "ir_left.png").rename(frame / "depth.png")
            (frame / "ir_right.png").unlink()
            code = cv2.imread(str(frame / "depth.png"), cv2.IMREAD_UNCHANGED)
            cv2.imwrite(str(frame / "depth.png"), code.astype(np.uint16))
    assert "both hold infrared pairs, or both depth" in refused_against(place, other, out, capsys)
    for scene in capture.open_set(other).scenes:
        scene.path.rename(scene.path.with_name(f"{scene.name}-again"))
    assert "must have a scene in common" in refused_against(place, other, out, capsys)
    assert "apart" in refused_against(place, place / "other", place / "other" / "x", capsys)


def matched_all(scene: capture.CapturedScene) -> reading.Maps:
    """Disparity of every repeat by our matcher (n, h, w)."""
    frames = [scene.frame(number) for number in scene.frames]
    left, right = (
        np.stack([getattr(frame, name) for frame in frames]) for name in ("ir_left", "ir_right")
    )
    return reading.matched(left, right, sensor())


@pytest.mark.long
def test_without_infrared_depth_alone_is_asked(place, diagnosed, tmp_path):
    bare = tmp_path / "bare"
    shutil.copytree(place / "null", bare)
    captures = capture.open_set(bare)
    for scene in captures.scenes:
        for number, disparity_px in enumerate(matched_all(scene)):
            depth_m = captures.info.fx_px * captures.info.baseline_m / disparity_px
            code = np.nan_to_num(np.rint(depth_m / captures.info.depth_unit_m)).astype(np.uint16)
            folder = scene.path / str(number)
            cv2.imwrite(str(folder / "depth.png"), code)
            (folder / "ir_left.png").unlink()
            (folder / "ir_right.png").unlink()
    told = diagnosed(bare)
    assert told["verdict"] == "no gap" and list(told["which"]) == ["whole"]
    assert any("No infrared" in limit for limit in told["limits"])
    told = diagnosed(bare, "--against", str(bare))
    assert told["verdict"] == "no gap" and list(told["which"]) == ["whole"]


def test_without_what_a_residual_needs_nothing_is_begun(place, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "starling.learning.methods.hybrid", None)
    flags = ["--sensor", str(place / "sensor.toml"), "--out", str(tmp_path / "out")]
    assert command_line.main(["diagnose", str(place / "null"), *flags, "--residual"]) == 1
    assert "hybrid needs" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_a_residual_is_not_learnt_against_other_captures(place, tmp_path, capsys):
    flags = ["--sensor", str(place / "sensor.toml"), "--out", str(tmp_path / "out")]
    other = ["--against", str(place / "bent"), "--residual"]
    assert command_line.main(["diagnose", str(place / "null"), *other, *flags]) == 1
    assert "residual must be" in capsys.readouterr().err


def test_captures_without_scenes_are_refused(place, tmp_path, capsys):
    empty = tmp_path / "empty"
    empty.mkdir()
    shutil.copyfile(place / "bent" / "capture.toml", empty / "capture.toml")
    flags = ["--sensor", str(place / "sensor.toml"), "--out", str(tmp_path / "out")]
    assert command_line.main(["diagnose", str(empty), *flags]) == 1
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_family_that_is_none_is_refused(place, tmp_path, capsys):
    flags = ["--sensor", str(place / "sensor.toml"), "--out", str(tmp_path / "out")]
    assert command_line.main(["diagnose", str(place / "bent"), *flags, "--leave-out", "tone"]) == 1
    assert "family" in capsys.readouterr().err and not (tmp_path / "out").exists()
    nothing = ["--families", "veil", "--leave-out", "veil"]
    assert command_line.main(["diagnose", str(place / "bent"), *flags, *nothing]) == 1
    assert "leave-out must leave a family to try; got veil." in capsys.readouterr().err


@pytest.mark.long
def test_a_residual_is_learnt_and_judged_where_it_has_not_learnt(place, diagnosed, monkeypatch):
    monkeypatch.setattr(registry, "method", partial(registry.method, steps=3))
    told = diagnosed(place / "bent", "--residual")
    assert [one["name"] for one in told["effects"]] == ["gamma"]
    for name in ("ndp_brier", "ndp_1_auc", "ndp_ece"):
        assert 0 <= told["howfar"][name]["bound"] <= 1
        assert told["howfar"][name]["after"] is not None
    gain = told["absorption"]
    assert None not in (gain["gain_before"], gain["gain_after"], gain["gain_floor"])
    assert "A learned residual takes" in told["says"][2]
    told = diagnosed(place / "bent" / "clutter-1", "--residual")
    assert any("No residual was learnt: locked scenes must" in limit for limit in told["limits"])
    assert told["howfar"] == {} and told["absorption"] == {}


def test_captures_that_cannot_be_asked_are_refused(place, tmp_path, capsys):
    bare = shutil.copytree(place / "null", tmp_path / "bare")
    for path in bare.rglob("ir_right.png"):
        path.unlink()
    flags = ["--sensor", str(place / "sensor.toml"), "--out", str(tmp_path / "out")]
    assert command_line.main(["diagnose", str(bare), *flags]) == 1
    assert "must hold infrared pairs or depth; got neither" in capsys.readouterr().err
    unknown = shutil.copytree(place / "null", tmp_path / "unknown")
    for name in ("scene.toml", "truth.png"):
        for path in unknown.rglob(name):
            path.unlink()
    assert command_line.main(["diagnose", str(unknown), *flags]) == 1
    assert "must have a scene.toml or reference depth" in capsys.readouterr().err
    blank = shutil.copytree(place / "null", tmp_path / "blank")
    for path in blank.rglob("truth.png"):
        cv2.imwrite(str(path), np.zeros_like(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)))
    assert command_line.main(["diagnose", str(blank), *flags]) == 1
    assert "must have reference depth; got none" in capsys.readouterr().err
    for path in blank.rglob("scene.toml"):
        path.unlink()
    assert command_line.main(["diagnose", str(blank), *flags]) == 1
    assert "must have a scene.toml or reference depth" in capsys.readouterr().err
    flags[1] = "kinect-v1"
    assert command_line.main(["diagnose", str(place / "null"), *flags]) == 1
    assert "sensor must be a stereo camera's; got structured_light" in capsys.readouterr().err
    flags[1] = str(place / "sensor.toml")
    assert command_line.main(["diagnose", str(place / "null"), *flags, "--set", "width=64"]) == 1
    assert "must be of the sensor's size, " in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_reflectance_that_is_estimated_is_said_to_take_up_light(place, diagnosed, tmp_path):
    """What another estimate would change no effect is named for: half the light is no gap."""
    guessed = tmp_path / "guessed"
    guessed.mkdir()
    shutil.copy(place / "null" / "capture.toml", guessed)
    for name in ("clutter-1", "clutter-2"):
        shutil.copytree(place / "null" / name, guessed / name)
        (guessed / name / "scene.toml").unlink()
    told = diagnosed(guessed, "--families", "veil")
    assert any("Reflectance and ambient light were estimated" in limit for limit in told["limits"])
    assert any("Only effects of these families were tried: veil" in one for one in told["limits"])
    assert all("ambient" in fitted for fitted in told["fitted"].values())
    scene = subject.subject(capture.open_set(guessed).scenes[0], sensor())
    table = bench.bench([scene], Arm.IMAGE)
    changes = table.otherwise()
    assert len(changes) == len(scene.estimates) == 4
    darker = dict(zip(table.names, changes[0][0], strict=True))
    assert darker["level.percentile 50"] < -0.1
    floor = null.base(table, seeds=2).floor
    for change in changes:
        assert (floor >= np.abs(np.nan_to_num(change)) - 1e-12).all()
    known = subject.subject(capture.open_set(place / "null").scenes[0], sensor())
    assert known.estimates == () and bench.bench([known], Arm.IMAGE).otherwise() == []
    for frame in ("0", "1"):
        folder = guessed / "clutter-2" / frame
        shutil.copy(guessed / "clutter-2" / "truth.png", folder / "depth.png")
        for side in ("left", "right"):
            (folder / f"ir_{side}.png").unlink()
    unseen, others = estimated.scene(capture.open_set(guessed).scenes[1], sensor())
    assert len(others) == 3 and (np.unique(unseen.bodies[0].texture) == 0.5).all()


@pytest.mark.long
def test_another_device_s_captures_are_said_to_be_so(place, diagnosed, tmp_path):
    other = shutil.copytree(place / "null" / "clutter-1", tmp_path / "other" / "clutter-1").parent
    info = (place / "null" / "capture.toml").read_text()
    (other / "capture.toml").write_text(info.replace('sensor = "', 'sensor = "not-'))
    told = diagnosed(other)
    assert "they are of a not-" in told["limits"][0]
    assert not any("say that they are" in one for one in diagnosed(place / "null")["limits"])
