"""`starling diagnose` on small captures of a second camera implementation with one effect."""

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
from starling.diagnosis.report import sentences
from starling.diagnosis.scenes import estimated, scene_model
from starling.diagnosis.scenes import observation as reading
from starling.diagnosis.validation.adapters import light_sets, own_depth
from starling.diagnosis.validation.protocol import case, shoot
from starling.diagnosis.which import attribution as named
from starling.diagnosis.which import null
from starling.diagnosis.which import table as feature_table
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.candidates import candidates as all_candidates
from starling.learning import registry
from starling.sim.captures import capture
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from tests.system.test_withheld import nominal

SCENES = ("clutter:1", "clutter:2", "tabletop:3", "clutter:4")
TRIED = ("gamma", "vignetting", "veil", "read_noise", "pixel_locking")
GAMMA = 1.3
LOCKING_PX = 0.1


def sensor() -> Sensor:
    """Return a sensor without lens blur, whose shape differs in the second implementation."""
    return with_values(nominal(), [("imager.lens.blur_px", 0.0)])


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("diagnose")
    light_sets.write(folder / "light", SCENES, sensor())
    (folder / "sensor.toml").write_text(presets.dumps(sensor()))
    cases = (("null", 7, {}), ("other", 8, {}), ("bent", 7, {"gamma": GAMMA}))
    for name, seed, settings in cases:
        kind = "single" if settings else "null"
        entry = case.Case(number=0, kind=kind, settings=settings, seed=seed)
        shoot.shoot(folder / "light", entry, folder / name, frames=2)
    return folder


@pytest.fixture
def diagnosed(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., dict[str, Any]]:
    """Run the verb with few effects in its table, and parse its output."""
    monkeypatch.setattr(
        named,
        "candidates",
        lambda *arguments: [entry for entry in all_candidates(*arguments) if entry.name in TRIED],
    )

    def run(captures: Path, *flags: str) -> dict[str, Any]:
        out = place / f"{captures.name}-report"
        base = ["--sensor", str(place / "sensor.toml"), "--out", str(out)]
        cached = ["--cache", str(place / "cache"), "--force", "--json", *flags]
        assert command_line.main(["diagnose", str(captures), *base, *cached]) == 0
        return json.loads(capsys.readouterr().out)

    return run


def test_effect_is_identified_measured_and_corrected(place, diagnosed):
    result = diagnosed(place / "bent", "--fix")
    assert result["verdict"] == "effects"
    (effect,) = result["effects"]
    assert effect["name"] == "gamma" and effect["set"] == ["gamma"]
    low, high = effect["interval"]
    assert effect["parameters"]["gamma"] == pytest.approx(GAMMA, abs=0.05) and low <= GAMMA <= high
    assert len(result["locked"]) == 1 and set(result["locked"]) < set(result["scenes"])
    features = result["howfar"]["features of the image"]
    assert features["closed_pct"] > 50 and features["after"] < features["before"]
    assert sum(result["shares"].values()) == pytest.approx(1)
    assert result["which"]["image"]["alone"][0]["name"] == effect["name"]
    assert all(map(sentences.describe_group, result["which"]["image"]["by_group"]))
    assert result["where"]["parts"]["ndp_rate"]["device"] is None
    fixed = presets.load(str(place / "bent-report" / "sensor.toml"))
    assert presets.load(str(place / "bent-report" / "base.toml")) == sensor()
    assert fixed.left.gamma == fixed.right.gamma == pytest.approx(effect["parameters"]["gamma"])
    assert json.loads((place / "bent-report" / "report.json").read_text())["says"] == result["says"]
    assert "consistent with gamma" in result["says"][1] and len(result["says"]) == 3
    assert not effect["stand_in"] and effect["evidence"]["reasons"] == []
    assert effect["closes"] == {"features of the image": features} | {
        name: result["howfar"][name] for name in effect["closes"]
    }
    assert result["unexplained_share"]["image"]["share"] == pytest.approx(
        max(1 - features["closed_pct"] / 100, 0)
    )
    assert any(note.startswith("Your exposure may be off") for note in result["notes"])
    shown = Path(result["report"])
    assert shown.parent == place / "bent-report" and "gamma" in shown.read_text("utf-8")


@pytest.mark.long
def test_left_out_family_is_not_reported(place, diagnosed):
    result = diagnosed(place / "bent", "--leave-out", "tone_curve")
    assert result["verdict"] == "none of the known"
    assert "gamma" not in [entry["name"] for entry in result["effects"]]
    assert result["which"]["image"]["unexplained"] and result["which"]["image"]["lead"]
    assert all(entry["stand_in"] for entry in result["effects"])
    assert result["unexplained_share"]["image"]["share"] == 1
    assert "known effect" in result["says"][1]


@pytest.mark.long
def test_only_requested_families_are_tried(place, diagnosed):
    result = diagnosed(place / "bent", "--families", "veil", "vignetting")
    tried = {entry["name"] for entry in result["which"]["image"]["alone"]}
    assert tried == {"veil", "vignetting"}


@pytest.mark.long
def test_families_that_act_on_nothing_are_refused(place, diagnosed, tmp_path, capsys):
    """A depth map of another matcher gives no verdict on effects of images."""
    shutil.copytree(place / "null", tmp_path / "sets" / "null")
    locked = with_values(sensor(), [("matcher.refinement.locking_px", LOCKING_PX)])
    own_depth.write(tmp_path / "sets", locked)
    result = diagnosed(tmp_path / "sets" / "null", "--families", "tone_curve")
    assert result["verdict"] == "no gap" and not result["which"]["depth"]["unexplained"]
    assert result["which"]["depth"]["beyond"] > result["which"]["depth"]["explained_below"]
    assert any("acts on matcher and filters" in limit for limit in result["limits"])
    for family in ("pixel_locking", "rolling_shutter"):  # One acts on depth, the other on nothing.
        line = refused(place, place / "null", tmp_path / "out", capsys, "--families", family)
        rule = "families must have an effect that acts on what these captures hold"
        assert f"{rule}; got {family}." in line


@pytest.mark.long
def test_no_gap_reports_no_effect(place, diagnosed):
    result = diagnosed(place / "null")
    assert result["verdict"] == "no gap" and result["effects"] == [] and result["howfar"] == {}
    seen = {entry["name"]: entry for entry in result["noticed"]}
    assert seen["gamma"]["below"] < seen["gamma"]["base"] == 1 < seen["gamma"]["above"]
    assert seen["vignetting"]["above"] > 0 and seen["vignetting"]["below"] is None


def test_one_scene_reports_its_limits(place, diagnosed):
    result = diagnosed(place / "bent" / "clutter-1")
    assert result["verdict"] == "cannot tell"
    assert any("Only one room" in limit for limit in result["limits"])
    assert any("Not tried" in entry and "temporal_filter" in entry for entry in result["limits"])
    assert result["where"]["maps"] == []


@pytest.mark.long
def test_two_capture_sets_are_compared(place, diagnosed):
    result = diagnosed(place / "bent", "--against", str(place / "other"), "--fix")
    assert result["verdict"] == "effects" and result["against"] == str(place / "other")
    (effect,) = result["effects"]
    assert effect["name"] == "gamma" and effect["set"] == ["gamma"]
    assert effect["parameters"]["gamma"] == pytest.approx(GAMMA, abs=0.05)
    assert list(result["howfar"]) == ["features of the image"]
    features = result["howfar"]["features of the image"]
    assert features["closed_pct"] > 50 and features["floor"] < features["after"] + 1
    assert result["shares"] == {"gamma": pytest.approx(1)}
    page = Path(result["report"]).read_text("utf-8")
    assert "Two capture sets of the same scenes are compared" in page
    assert "imulated, base" not in page and "in the other captures" in result["says"][0]


@pytest.mark.long
@pytest.mark.parametrize("name", ["other", "null"])
def test_two_captures_of_one_camera_have_no_gap(place, diagnosed, name):
    result = diagnosed(place / "null", "--against", str(place / name))
    assert result["verdict"] == "no gap" and result["effects"] == []


@pytest.mark.long
def test_matchers_of_two_devices_are_compared(place, diagnosed, tmp_path):
    """The images differ by noise alone; one of the matchers has pixel locking."""
    for name, locking_px in (("null", LOCKING_PX), ("other", 0.0)):
        shutil.copytree(place / name, tmp_path / "sets" / name)
        locked = with_values(sensor(), [("matcher.refinement.locking_px", locking_px)])
        own_depth.write(tmp_path / "sets", locked)
    result = diagnosed(tmp_path / "sets" / "null", "--against", str(tmp_path / "sets" / "other"))
    assert [(entry["name"], entry["arm"]) for entry in result["effects"]] == [
        ("pixel_locking", "depth")
    ]
    value = result["effects"][0]["parameters"]["pixel_locking"]
    assert value == pytest.approx(LOCKING_PX, abs=0.02)
    assert result["where"]["parts"]["ndp_rate"]["base_device"] is not None


@pytest.mark.long
def test_unpaired_scenes_are_left_out(place, diagnosed, tmp_path):
    fewer = tmp_path / "fewer"
    shutil.copytree(place / "other", fewer)
    shutil.rmtree(fewer / "clutter-2")
    result = diagnosed(place / "null", "--against", str(fewer))
    assert result["scenes"] == ["clutter-1", "clutter-4", "tabletop-3"]
    assert any("they are ignored: clutter-2." in limit for limit in result["limits"])


def refused(place: Path, captures: Path, out: Path, capsys: Any, *flags: str) -> str:
    """Return the single line of a refusal, which leaves no output."""
    own = () if "--sensor" in flags else ("--sensor", str(place / "sensor.toml"))
    assert command_line.main(["diagnose", str(captures), *own, "--out", str(out), *flags]) == 1
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert not out.exists()
    return line


def refused_against(place: Path, reference: Path, out: Path, capsys: Any) -> str:
    return refused(place, place / "null", out, capsys, "--against", str(reference))


def test_incomparable_captures_are_refused(place, tmp_path, capsys):
    out, reference = tmp_path / "out", tmp_path / "other"
    shutil.copytree(place / "other", reference)
    info = reference / "capture.toml"
    text = info.read_text()
    info.write_text(text.replace("baseline_m = 0.0", "baseline_m = 0.1"))
    assert "must be of one baseline_m" in refused_against(place, reference, out, capsys)
    info.write_text(text)
    camera_file = reference / "clutter-2" / "camera.toml"
    camera_file.write_text(text.replace("baseline_m = 0.0", "baseline_m = 0.1"))
    assert "must be of one camera here" in refused_against(place, reference, out, capsys)
    camera_file.unlink()
    for scene in capture.open_set(reference).scenes:
        for number in scene.frames:
            frame = scene.path / str(number)
            (frame / "ir_left.png").rename(frame / "depth.png")
            (frame / "ir_right.png").unlink()
            code = cv2.imread(str(frame / "depth.png"), cv2.IMREAD_UNCHANGED)
            cv2.imwrite(str(frame / "depth.png"), code.astype(np.uint16))
    assert "both hold infrared pairs, or both depth" in refused_against(
        place, reference, out, capsys
    )
    for scene in capture.open_set(reference).scenes:
        scene.path.rename(scene.path.with_name(f"{scene.name}-again"))
    assert "must have a scene in common" in refused_against(place, reference, out, capsys)
    assert "must lie outside its input" in refused_against(
        place, place / "other", place / "other" / "x", capsys
    )


def matched_all(scene: capture.CapturedScene) -> reading.Maps:
    """Disparity of every repeat by our matcher (n, h, w)."""
    frames = [scene.frame(number) for number in scene.frames]
    left, right = (
        np.stack([getattr(frame, name) for frame in frames]) for name in ("ir_left", "ir_right")
    )
    return reading.match_pairs(left, right, sensor())


@pytest.mark.long
def test_without_infrared_only_depth_is_diagnosed(place, diagnosed, tmp_path):
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
    result = diagnosed(bare)
    assert result["verdict"] == "no gap" and list(result["which"]) == ["whole"]
    assert any("No infrared" in limit for limit in result["limits"])
    result = diagnosed(bare, "--against", str(bare))
    assert result["verdict"] == "no gap" and list(result["which"]) == ["whole"]


def test_residual_without_torch_is_refused_early(place, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "starling.learning.methods.network", None)
    line = refused(place, place / "null", tmp_path / "out", capsys, "--residual")
    assert "hybrid needs" in line


def test_residual_against_other_captures_is_refused(place, tmp_path, capsys):
    flags = ("--against", str(place / "bent"), "--residual")
    assert "residual must be" in refused(place, place / "null", tmp_path / "out", capsys, *flags)


def test_captures_without_scenes_are_refused(place, tmp_path, capsys):
    empty = tmp_path / "empty"
    empty.mkdir()
    shutil.copyfile(place / "bent" / "capture.toml", empty / "capture.toml")
    assert refused(place, empty, tmp_path / "out", capsys)


def test_unknown_family_is_refused(place, tmp_path, capsys):
    bent, out = place / "bent", tmp_path / "out"
    assert "family" in refused(place, bent, out, capsys, "--leave-out", "tone")
    line = refused(place, bent, out, capsys, "--families", "veil", "--leave-out", "veil")
    assert "leave-out must leave at least one family to try; got veil." in line


@pytest.mark.long
def test_residual_is_evaluated_on_held_out_scenes(place, diagnosed, monkeypatch):
    monkeypatch.setattr(registry, "method", partial(registry.method, steps=3))
    result = diagnosed(place / "bent", "--residual")
    assert [entry["name"] for entry in result["effects"]] == ["gamma"]
    for name in ("ndp_brier", "ndp_1_auc", "ndp_ece"):
        assert 0 <= result["howfar"][name]["bound"] <= 1
        assert result["howfar"][name]["after"] is not None
    gain = result["absorption"]
    assert None not in (gain["gain_before"], gain["gain_after"], gain["gain_floor"])
    assert any("A learned residual changes" in note for note in result["notes"])
    result = diagnosed(place / "bent" / "clutter-1", "--residual")
    assert any(
        "No residual was learned: held-out scenes must" in limit for limit in result["limits"]
    )
    assert result["howfar"] == {} and result["absorption"] == {}


def test_unusable_captures_are_refused(place, tmp_path, capsys):
    bare = shutil.copytree(place / "null", tmp_path / "bare")
    for path in bare.rglob("ir_right.png"):
        path.unlink()
    out = tmp_path / "out"
    assert "hold infrared pairs or depth; got neither" in refused(place, bare, out, capsys)
    unknown = shutil.copytree(place / "null", tmp_path / "unknown")
    for name in ("scene.toml", "truth.png"):
        for path in unknown.rglob(name):
            path.unlink()
    assert "have a scene.toml or reference depth" in refused(place, unknown, out, capsys)
    blank = shutil.copytree(place / "null", tmp_path / "blank")
    for path in blank.rglob("truth.png"):
        cv2.imwrite(str(path), np.zeros_like(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)))
    assert "must have reference depth; got none" in refused(place, blank, out, capsys)
    for path in blank.rglob("scene.toml"):
        path.unlink()
    assert "have a scene.toml or reference depth" in refused(place, blank, out, capsys)
    line = refused(place, place / "null", out, capsys, "--sensor", "kinect-v1")
    assert "sensor must be a stereo camera's; got structured_light" in line
    line = refused(place, place / "null", out, capsys, "--set", "width=64", "--set", "cx_px=31.5")
    assert "must be of the sensor's size, " in line


@pytest.mark.long
def test_estimated_reflectance_absorbs_light(place, diagnosed, tmp_path):
    guessed = tmp_path / "guessed"
    guessed.mkdir()
    shutil.copy(place / "null" / "capture.toml", guessed)
    for name in ("clutter-1", "clutter-2"):
        shutil.copytree(place / "null" / name, guessed / name)
        (guessed / name / "scene.toml").unlink()
    result = diagnosed(guessed, "--families", "veil")
    assert any(
        "Reflectance and ambient light were estimated" in limit for limit in result["limits"]
    )
    assert any(
        "Only effects of these families were tried: veil" in entry for entry in result["limits"]
    )
    assert all("ambient" in fitted for fitted in result["fitted"].values())
    scene = scene_model.load_scene_model(capture.open_set(guessed).scenes[0], sensor())
    table = feature_table.build_feature_table([scene], Segment.IMAGE)
    changes = null.estimate_changes(table)
    assert len(changes) == len(scene.estimates) == 4
    darker = dict(zip(table.names, changes[0][0], strict=True))
    assert darker["level.percentile 50"] < -0.1
    floor = null.simulate_base(table, seeds=2).floor
    for change in changes:
        assert (floor >= np.abs(np.nan_to_num(change)) - 1e-12).all()
    known = scene_model.load_scene_model(capture.open_set(place / "null").scenes[0], sensor())
    plain = feature_table.build_feature_table([known], Segment.IMAGE)
    assert known.estimates == () and null.estimate_changes(plain) == []
    for frame in ("0", "1"):
        folder = guessed / "clutter-2" / frame
        shutil.copy(guessed / "clutter-2" / "truth.png", folder / "depth.png")
        for side in ("left", "right"):
            (folder / f"ir_{side}.png").unlink()
    unseen, others = estimated.load_scene(capture.open_set(guessed).scenes[1], sensor())
    assert len(others) == 3 and (np.unique(unseen.bodies[0].texture) == 0.5).all()


@pytest.mark.long
def test_captures_of_another_device_are_reported(place, diagnosed, tmp_path):
    reference = shutil.copytree(
        place / "null" / "clutter-1", tmp_path / "other" / "clutter-1"
    ).parent
    info = (place / "null" / "capture.toml").read_text()
    (reference / "capture.toml").write_text(info.replace('sensor = "', 'sensor = "not-'))
    result = diagnosed(reference)
    assert "name a not-" in result["limits"][0]
    assert not any("as their device" in entry for entry in diagnosed(place / "null")["limits"])
