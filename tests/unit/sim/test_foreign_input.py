"""Files of other people: what cannot be right is refused, or reported in one line."""

from __future__ import annotations

import dataclasses
import json
import os
import sqlite3
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from starling.patterns import image
from starling.patterns.errors import InputError
from starling.sim.captures import capture, info
from starling.sim.captures.exchange import bop, tum
from starling.sim.captures.exchange.export import export
from starling.sim.captures.exchange.stream import posed_frames
from starling.sim.captures.fusion import fuse
from starling.sim.commands.match_captures import match_captures
from starling.sim.commands.simulate_captures import simulate_captures
from starling.sim.console import output
from starling.sim.datasets.render_view import MemoryFolder
from starling.sim.geometry import frames
from starling.sim.imaging.imager.exposure import read_exposure
from starling.sim.scene import sources
from starling.sim.sensor import edits, presets, realsense, resolve
from tests.unit.command_line import Capsys, run
from tests.unit.sim.fusion.test_trajectory import pose_at, stream

SMALL = ("width=64", "height=48", "fx_px=40", "fy_px=40", "cx_px=31.5", "cy_px=23.5")


# --- pipes and devices ------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a/truth.png", "a/room", "a/0/frame.json"])
@pytest.mark.parametrize("device", [False, True])
def test_pipes_and_devices_are_refused(small_set: Path, name: str, device: bool) -> None:
    path = small_set / name
    path.unlink(missing_ok=True)
    if device:
        path.symlink_to("/dev/zero")
    else:
        os.mkfifo(path)
    with pytest.raises(InputError, match=rf"{path.name}.*pipe or a device"):
        (scene,) = capture.open_set(small_set).scenes[:1]
        scene.truth_m()
        scene.frame(0)


def test_files_larger_than_memory_are_refused(
    small_set: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(path: Path) -> bytes:
        raise MemoryError

    monkeypatch.setattr(Path, "read_bytes", fail)
    with pytest.raises(InputError, match=r"capture.toml must be readable; .*fit into memory"):
        capture.open_set(small_set)


def test_a_pattern_that_is_a_device_is_refused() -> None:
    with pytest.raises(InputError, match="pattern file must be readable; got /dev/zero"):
        image.load("/dev/zero", fov_x_deg=60, fov_y_deg=40)


def test_null_bytes_in_names_are_refused() -> None:
    with pytest.raises(InputError, match=r"pattern file must be readable; .*null byte"):
        image.load("a\0.png", fov_x_deg=60, fov_y_deg=40)
    with pytest.raises(InputError, match="out must hold no null byte"):
        output.OutputFolder("a\0b")


def test_names_that_are_too_long_are_refused() -> None:
    assert not capture.is_capture("x" * 400)
    with pytest.raises(InputError, match="scene must be a known name"):
        sources.load("x" * 400, presets.load("d435"))


def test_a_material_that_is_a_pipe_is_as_missing(tmp_path: Path) -> None:
    box = trimesh.creation.box().export(file_type="obj")
    (tmp_path / "box.obj").write_text(f"mtllib m.mtl\nusemtl a\n{box}")
    os.mkfifo(tmp_path / "m.mtl")
    with pytest.warns(UserWarning, match=r"not used: files that are missing \(m\.mtl\)"):
        ((_, part),) = sources.mesh_parts(tmp_path / "box.obj")
    assert len(part.faces) == 12


# --- device presets and sensors ---------------------------------------------------------------


def preset(path: Path, table: Any) -> str:
    path.write_text(json.dumps(table))
    return str(path)


def test_a_preset_of_another_device_is_reported(tmp_path: Path) -> None:
    table = {"device": {"name": "Intel RealSense D405"}, "parameters": {}}
    name = preset(tmp_path / "p.json", table)
    with pytest.warns(UserWarning, match=r"p.json was exported from a D405; it is applied to d435"):
        realsense.with_preset(presets.load("d435"), name)
    own = {"device": {"name": "Intel RealSense D435I"}, "parameters": {}}
    realsense.with_preset(presets.load("d435"), preset(tmp_path / "own.json", own))


def test_an_hdr_preset_is_refused(tmp_path: Path) -> None:
    name = preset(tmp_path / "hdr.json", {"hdr-preset": {"id": "0", "iterations": "0"}})
    with pytest.raises(InputError, match="must hold controls; got an hdr-preset"):
        realsense.with_preset(presets.load("d435"), name)


def test_an_exposure_of_the_right_imager_is_reported(tmp_path: Path) -> None:
    sensor = edits.apply(presets.load("d435"), ["left.exposure_s=0.01"])
    (tmp_path / "s.toml").write_text(presets.dumps(sensor))
    with pytest.warns(UserWarning, match="right.exposure_s not used: both imagers take the left"):
        presets.load(str(tmp_path / "s.toml"))


def test_an_exposure_without_gain_is_reported() -> None:
    with pytest.warns(UserWarning, match="exposure_s is not used without gain"):
        assert read_exposure({"exposure_s": 0.01}) is None


# --- match ------------------------------------------------------------------------------------


def matched(folder: Path) -> Any:
    sensor = resolve.load("d435", captures=str(folder), edits=["matcher.search_px=32"])
    return match_captures(str(folder), sensor)["scenes"]["a"]["pair"]


def test_match_measures_fill_and_agreement_without_reference(small_set: Path) -> None:
    for scene in ("a", "b"):
        (small_set / scene / "truth.png").unlink()
        (small_set / scene / "0" / "depth.png").unlink()
    figures = matched(small_set)
    assert 0.5 < figures["fill"] <= 1 and 0.9 < figures["left_right_agreement"] <= 1


def test_a_swapped_pair_is_reported(small_set: Path) -> None:
    for scene in ("a", "b"):
        left, right = (small_set / scene / "0" / f"ir_{side}.png" for side in ("left", "right"))
        left.rename(small_set / "x.png")
        right.rename(left)
        (small_set / "x.png").rename(right)
    with pytest.warns(UserWarning, match=r"if swapped. Are left and right swapped\?"):
        assert matched(small_set)["fill"] < 0.3


def test_structured_light_is_refused_for_an_infrared_pair(small_set: Path) -> None:
    sensor = resolve.load("kinect-v1", captures=str(small_set), edits=["imager.bit_depth=8"])
    with pytest.raises(InputError, match="sensor must be a stereo camera's; got structured_light"):
        match_captures(str(small_set), sensor)


def test_a_sensor_of_another_camera_than_the_captures_is_refused(small_set: Path) -> None:
    wide = resolve.load("d435", captures=str(small_set), edits=["width=80", "cx_px=39.5"])
    with pytest.raises(InputError, match=r"sensor must have images of 160x48; got 80x48\. Scene a"):
        match_captures(str(small_set), wide)
    (scene,) = capture.open_set(small_set / "a").scenes
    (small_set / "a" / "0" / "ir_right.png").unlink()
    kinect = dataclasses.replace(scene.info, sensor="kinect-v1")
    with pytest.raises(
        InputError, match=r"must be of structured light; got stereo\. Scene a is of"
    ):
        dataclasses.replace(scene, info=kinect).refuse_other_sensor(presets.load("d435"))


def test_match_writes_the_geometry_of_its_depth(tmp_path: Path, small_set: Path) -> None:
    edits = ["matcher.search_px=32", "baseline_m=0.1"]
    sensor = resolve.load("d435", captures=str(small_set), edits=edits)
    match_captures(str(small_set), sensor, out=tmp_path / "out")
    assert info.read(tmp_path / "out" / "capture.toml").baseline_m == 0.1


# --- simulate ---------------------------------------------------------------------------------


def block(path: Path, wide_m: float, far_m: float = 0.0) -> str:
    trimesh.creation.box((wide_m,) * 3).apply_translation((far_m, 0, 0)).export(path)
    return str(path)


@pytest.mark.filterwarnings("default")
def test_a_truth_beyond_the_depth_image_needs_empty(tmp_path: Path, capsys: Capsys) -> None:
    scene = block(tmp_path / "block.ply", 90.0)
    sets = [word for edit in SMALL for word in ("--set", edit)]
    flags = ["simulate", scene, "--sensor", "d435", "--out", tmp_path / "out", *sets]
    code, _, err = run(*flags, capsys=capsys)
    assert code == 1 and "block must have a surface in view; got surfaces beyond 65.535 m" in err
    assert not (tmp_path / "out").exists()
    code, _, err = run(*flags, "--empty", capsys=capsys)
    assert (
        code == 0
        and ": 100 % of the surface lies beyond 65.535 m, the end of the depth image" in err
    )
    truth = cv2.imread(str(tmp_path / "out" / "block" / "truth.png"), cv2.IMREAD_UNCHANGED)
    assert truth is not None and not truth.any()


def test_a_scene_without_surface_in_view_needs_empty(tmp_path: Path) -> None:
    sensor = resolve.load("d435", edits=SMALL)
    (tmp_path / "away.xml").write_text(
        '<scene version="3.0.0"><shape type="sphere">'
        '<point name="center" x="0" y="0" z="-5"/></shape></scene>'
    )
    with pytest.raises(InputError, match="away must have a surface in view; got no surface"):
        simulate_captures(str(tmp_path / "away.xml"), sensor, tmp_path / "out")
    simulate_captures(str(tmp_path / "away.xml"), sensor, tmp_path / "out", empty=True)


# --- output -----------------------------------------------------------------------------------


def test_write_errors_of_sqlite_are_refused(tmp_path: Path) -> None:
    message = r"out must be writable; got .*SQLite: locked"
    with pytest.raises(InputError, match=message), output.refused(tmp_path):
        raise sqlite3.OperationalError("locked")
    full = sqlite3.OperationalError("database or disk is full")
    full.sqlite_errorname = "SQLITE_FULL"
    message = "out must have room on its disk"
    with pytest.raises(InputError, match=message), output.refused(tmp_path):
        raise full


def test_a_path_that_is_not_utf8_is_refused_in_one_line(tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff"))
    message = r"out must be a UTF-8 path; got b'.*\\xff'"
    with pytest.raises(InputError, match=message) as caught, output.refused(path):
        str(path).encode()
    str(caught.value).encode()


# --- streams and exports ----------------------------------------------------------------------


@pytest.mark.parametrize("unit", [1.0, 5.0])
def test_depth_in_other_steps_is_reported(unit: float, recwarn: Any) -> None:
    def depth() -> np.ndarray:
        return np.full((90, 120), 1.0 / unit, np.float32)

    moments = posed_frames(stream(pose_at(0), pose_at(0.1)))
    for posed in moments:
        object.__setattr__(posed.moment, "depth", depth)
    fuse._warn_small(moments, "kitchen")
    said = [str(item.message) for item in recwarn]
    assert said == [] if unit == 1 else "Is depth in millimetres?" in said[0]


def test_a_pose_that_is_not_finite_costs_its_frame_only(tmp_path: Path, small_set: Path) -> None:
    (tmp_path / "t.txt").write_text("1 0 0 0 0 0 0 1\n2 nan 0 0 0 0 0 1\n3 1 0 0 0 0 0 1\n")
    with pytest.warns(UserWarning, match="1 poses are not finite; these frames have none"):
        poses = tum.poses_by_time(tum._lines(tmp_path / "t.txt"), tmp_path / "t.txt")
    assert [time for time, _ in poses] == [1, 3]


def test_colour_is_not_exported_and_said_so(small_set: Path, tmp_path: Path) -> None:
    cv2.imwrite(str(small_set / "a" / "0" / "rgb.png"), np.zeros((48, 160, 3), np.uint8))
    with pytest.warns(UserWarning, match="rgb.png is not exported; the layout takes ir_left.png"):
        export(str(small_set), "tum", tmp_path / "tum", meshes=tmp_path)


@pytest.fixture
def shown(small_set: Path, tmp_path: Path) -> tuple[Path, Path]:
    """A set that shows two meshes of one file name in different folders."""
    from hashlib import sha256

    objects, pose = [], frames.pose((0, 0, 1)).tolist()
    for number, name in enumerate(("box", "can")):
        path = tmp_path / "meshes" / name / "textured.obj"
        path.parent.mkdir(parents=True)
        block(path, 0.1 + 0.1 * number)
        digest = sha256(path.read_bytes()).hexdigest()
        mesh = f"{name}/textured.obj"
        objects.append({"body": name, "mesh": mesh, "sha256": digest, "left_from_mesh": pose})
    record = {"bodies": ["box", "can"], "objects": objects}
    for scene in ("a", "b"):
        (small_set / scene / "0" / "frame.json").write_text(json.dumps(record))
    return small_set, tmp_path / "meshes"


def exported(shown: tuple[Path, Path]) -> dict[str, bytes]:
    folder = MemoryFolder(Path("out"))
    bop.export(capture.open_set(shown[0]), shown[1], folder)
    return folder.content


def test_meshes_of_one_file_name_are_two_models(shown: tuple[Path, Path]) -> None:
    content = exported(shown)
    info = json.loads(content["models/models_info.json"])
    assert [info[number]["size_x"] for number in ("1", "2")] == pytest.approx([100, 200])
    truth = json.loads(content["train_starling/000000/scene_gt.json"])["0"]
    assert [entry["obj_id"] for entry in truth] == [1, 2]


def test_a_mesh_that_changed_is_refused(shown: tuple[Path, Path]) -> None:
    path = shown[1] / "can" / "textured.obj"
    path.write_bytes(path.read_bytes().replace(b"0.1", b"0.3"))
    with pytest.raises(InputError, match=r"hold the can/textured\.obj that was rendered"):
        exported(shown)
