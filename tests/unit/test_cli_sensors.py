"""The verb `sensors`, the flag --mode, and calibrations of devices on the command line."""

from __future__ import annotations

import dataclasses
import json
import tomllib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling import command_line
from starling.sim.commands import corrupt_captures, simulate_captures
from starling.sim.sensor import differences, edits, presets, resolve, sensor_file
from tests.unit.command_line import Capsys
from tests.unit.command_line import refused as _refused
from tests.unit.command_line import run as _run

CAMERA_INFO = """image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [390, 0, 320, 0, 390, 236, 0, 0, 1]}
"""


def test_sensors(capsys: Capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presets, "names", lambda: ["d415", "d435"])
    code, out, _ = _run("sensors", "--json", capsys=capsys)
    assert code == 0 and json.loads(out)["d435"]["width"] == 848
    assert "d415" in _run("sensors", "list", capsys=capsys)[1]
    assert "name must come with show" in _run("sensors", "list", "d435", capsys=capsys)[2]
    shown = _run("sensors", "show", "d435", capsys=capsys)[1]
    text = presets.text("d435").rstrip()
    assert shown.startswith(text) and shown.removeprefix(text).lstrip().startswith("# Modes")
    table = json.loads(_run("sensors", "show", "d435", "--json", capsys=capsys)[1])
    assert table["projector"]["power_w"] > 0
    assert "must be a known name; got 'd436'" in _refused("sensors", "show", "d436", capsys=capsys)
    assert "name must be given" in _refused("sensors", "show", capsys=capsys)


def test_a_sensor_file_is_shown(capsys: Capsys, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    text = "# Measured.\n" + presets.dumps(presets.load("d435"))
    file.write_text(text, encoding="utf-8")
    assert _run("sensors", "show", str(file), capsys=capsys)[1].rstrip() == text.rstrip()
    table = json.loads(_run("sensors", "show", str(file), "--json", capsys=capsys)[1])
    assert table["fx_px"] == presets.load("d435").fx_px
    file.write_text(text.replace("\nfx_px = ", "\nfx_px = -"), encoding="utf-8")
    assert "fx_px" in _refused("sensors", "show", str(file), capsys=capsys)
    missing = str(tmp_path / "missing.toml")
    assert "missing.toml" in _refused("sensors", "show", missing, capsys=capsys)


@pytest.mark.parametrize("mode", ["", "640x480@60"])
def test_a_new_file_reads_as_the_edited_base(capsys: Capsys, tmp_path: Path, mode: str) -> None:
    flags = ["--set", "baseline_m=0.095", "--set", "imager.gain=2", "--set", "right.prnu=0.01"]
    flags += ["--set", "matcher.setting=fast", "--set", "projector.position_m.x=0.04"]
    flags += ["--set", "post.near_m=0.35"]
    flags += ["--mode", mode] if mode else []
    code, text, err = _run("sensors", "new", "wide", "--from", "d435", *flags, capsys=capsys)
    assert (code, err) == (0, "")
    assert set(tomllib.loads(text)) <= {"base", "name", "mode", "baseline_m", "left", "right",
                                        "matcher", "post", "projector"}  # fmt: skip
    (tmp_path / "wide.toml").write_text(text)
    wanted = edits.apply(presets.load("d435", mode=mode), flags[1:12:2])
    loaded = presets.load(str(tmp_path / "wide.toml"))
    assert loaded == dataclasses.replace(wanted, name="wide")


def test_a_new_file_on_a_file_works_in_other_folders(
    capsys: Capsys, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "far").mkdir()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text('base = "d415"\n[right]\ngain = 2.0\n')
    (tmp_path / "a.png").write_text("")
    edit = ["--set", "projector.pattern=a.png", "--set", "projector.emitters=[]"]
    edit += ["--set", "left.gain=3"]
    text = _run("sensors", "new", "b", "--from", "a.toml", *edit, capsys=capsys)[1]
    (tmp_path / "far" / "b.toml").write_text(text)
    loaded = presets.load("far/b.toml")
    assert loaded.projector.pattern == str(tmp_path / "a.png")
    assert (loaded.left.gain, loaded.right.gain) == (3.0, 2.0)


def test_new_in_json_and_with_a_calibration(capsys: Capsys, tmp_path: Path) -> None:
    (tmp_path / "info.yaml").write_text(CAMERA_INFO)
    flags = ["--from", "d435", "--camera-matrix", tmp_path / "info.yaml", "--json"]
    table = json.loads(_run("sensors", "new", "mine", *flags, capsys=capsys)[1])
    assert table == {
        "base": "d435", "name": "mine", "mode": "640x480",
        "fx_px": 390.0, "fy_px": 390.0, "cx_px": 320.0, "cy_px": 236.0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("new", "wide"), "from must be given; got nothing. Example: starling sensors new"),
        (("new", "--from", "d435"), "name must be given; got nothing. Example"),
        (("list", "--mode", "640x480"), "mode must come with show; got 640x480"),
        (("show", "d435", "--set", "unit=3"), "from, camera-matrix, set must come with new"),
        (("show", "d435", "--mode", "800x600"), "mode must be a mode of d435; got '800x600'"),
    ],
)
def test_refused_calls(arguments: tuple[str, ...], message: str, capsys: Capsys) -> None:
    assert message in _refused("sensors", *arguments, capsys=capsys)


def test_modes_are_shown(capsys: Capsys, tmp_path: Path) -> None:
    assert "640x480      0.6  6/15/30/60/90" in _run("sensors", "show", "d435", capsys=capsys)[1]
    table = json.loads(
        _run("sensors", "show", "d435", "--mode", "640x480", "--json", capsys=capsys)[1]
    )
    used = [row["mode"] for row in table["modes"] if row["used"]]
    assert (table["width"], used) == (640, ["640x480"])
    plain = presets.dumps(presets.load("xtion"))
    (tmp_path / "plain.toml").write_text(plain)
    shown = _run("sensors", "show", tmp_path / "plain.toml", "--json", capsys=capsys)[1]
    assert "modes" not in json.loads(shown)
    (tmp_path / "a.toml").write_text('base = "xtion"\n')
    shown = _run("sensors", "show", tmp_path / "a.toml", capsys=capsys)[1]
    assert "# All other keys are those of xtion.\n" in shown
    dumped = _run("sensors", "show", "d435", "--mode", "640x480", capsys=capsys)[1]
    assert tomllib.loads(dumped)["width"] == 640


def test_presets_on_a_base_are_listed_with_what_differs(
    capsys: Capsys, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (sensor_file.PRESETS / "d435.toml").read_text()
    (tmp_path / "d435.toml").write_text(text)
    alias = 'base = "d435"\nname = "d435f"\ndescription = "With a filter."\n'
    (tmp_path / "d435f.toml").write_text(alias + "[left.lens]\nfilter_width_nm = 80.0\n")
    (tmp_path / "d435i.toml").write_text('base = "d435"\nname = "d435i"\n')
    monkeypatch.setattr(sensor_file, "PRESETS", tmp_path)
    listed = _run("sensors", capsys=capsys)[1]
    assert "d435f: d435 with other left.lens.filter_width_nm. With a filter." in listed
    assert "d435i: d435 with other name only." in listed
    rows = json.loads(_run("sensors", "--json", capsys=capsys)[1])
    assert rows["d435f"]["differs"] == ["left.lens.filter_width_nm"]
    assert rows["d435f"]["base"] == "d435" and "base" not in rows["d435"]


def test_parts_that_a_file_leaves_out_are_named_once(tmp_path: Path) -> None:
    bare = "name='a'\nwidth=64\nheight=48\nfx_px=50.0\nfy_px=50.0\ncx_px=31.5\ncy_px=23.5\n"
    (tmp_path / "a.toml").write_text(bare + "baseline_m=0.05\n")
    (tmp_path / "b.toml").write_text('base = "a.toml"\n[left]\nread_noise_e = 3.0\n')
    (tmp_path / "c.toml").write_text('base = "d435"\n')
    notes: list[str] = []
    for name in ("a", "b", "c"):
        resolve.load(str(tmp_path / f"{name}.toml"), note=notes.append)
    resolve.load("d435", note=notes.append)
    assert len(notes) == 2
    assert "it gives no noise (an ideal imager), no lens blur (a sharp lens)" in notes[0]
    assert "no projector (pattern d435, 150 mW), no matcher (d4xx), no range (0 to" in notes[0]
    assert "noise" not in notes[1] and "no lens blur" in notes[1]


def test_a_mode_has_the_size_of_the_captures(tmp_path: Path, small_set: Path) -> None:
    with pytest.raises(
        ValueError, match=r"mode must have the captures' image size .*; got 640x480"
    ):
        resolve.load("d435", mode="640x480", captures=str(small_set))


def test_depth_images_have_the_camera_of_a_file(tmp_path: Path, capsys: Capsys) -> None:
    np.save(tmp_path / "d.npy", np.ones((480, 640), np.float32))
    np.save(tmp_path / "small.npy", np.ones((48, 64), np.float32))
    (tmp_path / "info.yaml").write_text(CAMERA_INFO)
    numbers = corrupt_captures.intrinsics_of(tmp_path / "info.yaml", tmp_path / "d.npy", "")
    assert numbers == (390.0, 390.0, 320.0, 236.0)
    four = (390.0, 390.0, 320.0, 236.0)
    assert corrupt_captures.intrinsics_of(four, tmp_path / "nowhere.npy", "") == four
    flags: list[Any] = ["--sensor", "d435", "--camera-matrix", tmp_path / "info.yaml"]
    message = _refused(
        "simulate", tmp_path / "small.npy", *flags, "--out", tmp_path / "out", capsys=capsys
    )
    assert "must have the image size 64x48; got 640x480" in message


def test_poses_and_units_reach_the_simulation(
    tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[Any] = []

    def work(scene: str, sensor: Any, out: Path, **how: Any) -> dict[str, Any]:
        calls.append(how)
        return {}

    monkeypatch.setattr(simulate_captures, "simulate_captures", work)
    (tmp_path / "path.txt").write_text("0 0 0 0 0 0 0 1\n1 0 0 0.5 0 0 0 1\n")
    flags: list[Any] = ["--sensor", "d435", "--out", tmp_path / "out"]
    look = ["--look-at", "0", "1", "2", "0", "0", "-1.5", "--up", "z", "--unit", "mm"]
    assert _run("simulate", "room.glb", *flags, *look, capsys=capsys)[0] == 0
    path = ["--pose", tmp_path / "path.txt"]
    assert _run("simulate", "room.glb", *flags, *path, capsys=capsys)[0] == 0
    towards, along = calls
    assert [view.look_at for view in towards["views"]] == [(0, 1, 2, 0, 0, -1.5)]
    assert (towards["frame"].up, towards["frame"].unit) == ("z", "mm")
    assert towards["options"]["look_at"] == (0, 1, 2, 0, 0, -1.5)
    assert [view.timestamp for view in along["views"]] == [0, 1]
    assert along["options"]["pose"] == str(tmp_path / "path.txt")


def test_depth_images_have_no_pose(tmp_path: Path, capsys: Capsys) -> None:
    np.save(tmp_path / "d.npy", np.ones((48, 64), np.float32))
    matrix = ["--camera-matrix", "60", "60", "31.5", "23.5"]
    flags: list[Any] = ["--sensor", "d435", *matrix, "--up", "z", "--out", tmp_path / "out"]
    message = _refused("simulate", tmp_path / "d.npy", *flags, capsys=capsys)
    assert "up must not be given with depth images; got {'up': 'z'}" in message


def test_a_scene_has_the_camera_of_a_device_file(
    tmp_path: Path, capsys: Capsys, small_set: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Depth images have a camera; a scene is seen by the sensor, and captures have their own."""
    calls: list[Any] = []

    def work(scene: str, sensor: Any, out: Path, **how: Any) -> dict[str, Any]:
        calls.append((sensor, how["options"]["camera_matrix"]))
        return {}

    monkeypatch.setattr(simulate_captures, "simulate_captures", work)
    path = tmp_path / "info.yaml"
    path.write_text(CAMERA_INFO)
    flags = ["--sensor", "d435", "--camera-matrix", path, "--out", tmp_path / "out"]
    assert _run("simulate", "wall", *flags, capsys=capsys)[0] == 0
    ((sensor, typed),) = calls
    assert (sensor.width, sensor.fx_px, typed) == (640, 390.0, str(path))
    message = _refused("simulate", small_set, *flags, capsys=capsys)
    assert "camera_matrix must not be given with captures; got" in message


@pytest.mark.parametrize(("flags", "count"), [(("--mode", "640x480") * 2, 1), ((), 0)])
def test_a_flag_given_twice_is_reported(flags: tuple[str, ...], count: int, capsys: Capsys) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert command_line.main(["sensors", "show", "d435", *flags]) == 0
    message = "--mode is given 2 times; the last one counts."
    assert capsys.readouterr().err.count(message) == count


def test_new_sensors_can_be_read(tmp_path: Path, capsys: Capsys) -> None:
    """Another size than the mode's is a camera of its own: the file names no mode."""
    flags = ("--from", "d555", "--mode", "640x360", "--set", "height=400", "--set", "cy_px=199.5")
    code, text, _ = _run("sensors", "new", "mine", *flags, capsys=capsys)
    assert code == 0 and "mode" not in tomllib.loads(text)
    (tmp_path / "mine.toml").write_text(text)
    mine = presets.load(str(tmp_path / "mine.toml"))
    wanted = presets.load("d555", mode="640x360")
    assert (mine.width, mine.height, mine.fx_px) == (640, 400, wanted.fx_px)


def test_a_new_sensor_that_no_file_can_hold_is_refused(
    capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(differences, "new_file", lambda *_: 'base = "d555"\nwidth = 3\n')
    message = _refused("sensors", "new", "mine", "--from", "d555", capsys=capsys)
    assert message.startswith("starling: the new file: width must be in [32, 8192]; got 3")
