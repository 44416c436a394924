"""Capture sets: reading, error messages and writing."""

from __future__ import annotations

import dataclasses
import os
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.captures import info as capture_info
from starling.sim.captures.writer import info_of
from starling.sim.sensor import presets, resolve


def _change(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def _write(path: Path, image: np.ndarray) -> None:
    cv2.imwrite(str(path), image)


def test_reads_a_set(small_set: Path) -> None:
    captures = capture.open_set(small_set)
    assert [scene.name for scene in captures.scenes] == ["a", "b"]
    assert captures.info.focal_baseline_px_m == pytest.approx(4.5)
    scene = captures.scenes[0]
    assert (scene.room, scene.frames) == ("kitchen", (0,))
    frame = scene.frame(0)
    assert frame.ir_left is not None and frame.ir_right is not None and frame.depth_m is not None
    assert frame.ir_left.dtype == np.uint8 and frame.ir_left_off is None
    assert frame.record == {"gain": 1.0}
    assert np.isnan(frame.depth_m[10:20, 140:150]).all()
    assert np.nanmax(frame.depth_m) == pytest.approx(1.002)
    truth_m = scene.truth_m()
    assert truth_m is not None and truth_m == pytest.approx(1.0)


def test_reads_one_scene_of_a_set(small_set: Path) -> None:
    captures = capture.open_set(small_set / "b")
    assert [scene.name for scene in captures.scenes] == ["b"]
    assert capture.is_capture(small_set / "b") and capture.is_capture(small_set)
    assert not capture.is_capture(small_set / "a" / "0")


def test_reads_depth_alone_and_infrared_alone(small_set: Path) -> None:
    for name in ("ir_left.png", "ir_right.png", "frame.json"):
        (small_set / "a" / "0" / name).unlink()
    (small_set / "b" / "0" / "depth.png").unlink()
    (small_set / "b" / "truth.png").unlink()
    (small_set / "b" / "room").unlink()
    first, second = capture.open_set(small_set).scenes
    assert first.frame(0).ir_left is None and first.frame(0).record == {}
    assert second.frame(0).depth_m is None
    assert second.truth_m() is None
    assert second.room == "b"


def test_frames_are_numbers_in_order(small_set: Path) -> None:
    for name in ("10", "2", "old"):
        (small_set / "a" / name).mkdir()
    assert capture.open_set(small_set).scenes[0].frames == (0, 2, 10)


def test_info_round_trip(small_set: Path, tmp_path: Path) -> None:
    info = capture_info.from_table(
        {
            **_table(small_set),
            "preset": "High Density",
            "distortion": [0.0, 0.1, 0, 0, 0],
            "colour": {k: _table(small_set)[k] for k in _PINHOLE},
            "colour_from_left": [[1, 0, 0, 0.015], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        }
    )
    path = tmp_path / "capture.toml"
    path.write_text(capture_info.dumps(info))
    assert capture_info.read(path) == info


_PINHOLE = ("width", "height", "fx_px", "fy_px", "cx_px", "cy_px")


def _table(folder: Path) -> dict:
    return tomllib.loads((folder / "capture.toml").read_text())


@pytest.mark.parametrize("key", [*_PINHOLE, "baseline_m", "depth_unit_m", "sensor", "licence"])
def test_missing_key_is_refused(small_set: Path, key: str) -> None:
    path = small_set / "capture.toml"
    lines = [line for line in path.read_text().splitlines() if not line.startswith(f"{key} ")]
    path.write_text("\n".join(lines))
    with pytest.raises(InputError, match=f"capture.toml: {key} must be given; got nothing"):
        capture.open_set(small_set)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("baseline_m = 0.05", "baseline_m = -0.05", "baseline_m must be > 0; got -0.05. The left"),
        ("width = 160", "width = 0", r"width must be in \[1, 16384\]; got 0"),
        ("fx_px = 90.0", "fx_px = nan", "fx_px must be > 0; got nan"),
        ("cx_px = 79.5", "cx_px = inf", "cx_px must be in"),
        ("depth_unit_m = 0.001", "depth_unit_m = 0.0", "depth_unit_m must be > 0"),
        ("black_level_dn = 4", "black_level_dn = -1", "black_level_dn must be in"),
        ("width = 160", "width = '160'", "width must be of type int; got '160'"),
        ("width = 160", "width = ", "capture.toml must be TOML"),
        ("notes", "colour_from_left = [[1,0,0,0],[0,1,0,0],[0,0,2,0],[0,0,0,1]]\nnotes", "rigid"),
        ("notes", "colour = {width = 0}\nnotes", "colour.height must be given"),
        ("notes", "deep = " + "[" * 5000 + "]" * 5000 + "\nnotes", "capture.toml must be TOML"),
    ],
)
def test_wrong_info_is_refused(small_set: Path, old: str, new: str, message: str) -> None:
    _change(small_set / "capture.toml", old, new)
    with pytest.raises(InputError, match=message):
        capture.open_set(small_set)


@pytest.mark.parametrize(("level", "refused"), [(254, False), (255, True)])
def test_a_black_level_above_all_codes_is_refused(
    small_set: Path, level: int, refused: bool
) -> None:
    _change(small_set / "capture.toml", "black_level_dn = 4", f"black_level_dn = {level}")
    scene = capture.open_set(small_set).scenes[0]
    if not refused:
        assert scene.ir_left(0) is not None
        return
    rule = r"black_level_dn in capture.toml must be below 255, the largest code of .*ir_left.png"
    with pytest.raises(InputError, match=rule):
        scene.ir_left(0)
    assert scene.truth_m() is not None


def test_info_must_be_text(small_set: Path) -> None:
    (small_set / "capture.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match=r"capture.toml must be TOML"):
        capture.open_set(small_set)


def test_info_must_be_readable(small_set: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", fail)
    with pytest.raises(InputError, match=r"capture.toml must be readable; .*Permission denied"):
        capture.open_set(small_set)


def test_wrong_folders_are_refused(small_set: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"captures must be a folder; got .*It does not exist"):
        capture.open_set(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"captures must be a folder; got .*It is a file"):
        capture.open_set(small_set / "capture.toml")
    with pytest.raises(InputError, match=r"must be a capture set; .*Looked for capture.toml"):
        capture.open_set(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "capture.toml").write_text((small_set / "capture.toml").read_text())
    with pytest.raises(InputError, match="capture set must hold a scene folder"):
        capture.open_set(tmp_path / "empty")
    (small_set / "c").mkdir()
    (small_set / "c" / "room").write_text("kitchen")
    with pytest.raises(InputError, match="scene must hold a frame folder"):
        capture.open_set(small_set)


def test_folders_that_are_no_scenes_are_left_out_with_a_word(small_set: Path) -> None:
    for name in ("figures", "__MACOSX", ".cache"):
        (small_set / name).mkdir()
        (small_set / name / "plot.png").write_bytes(b"")
    with pytest.warns(UserWarning, match=r"no scenes, and left out: figures\.$"):
        captures = capture.open_set(small_set)
    assert [scene.name for scene in captures.scenes] == ["a", "b"]


@pytest.mark.parametrize("name", ["01", "-1", "1000000000", "\u0661"])
def test_folders_that_are_no_frames_are_left_out_with_a_word(small_set: Path, name: str) -> None:
    (small_set / "a" / name).mkdir()
    with pytest.warns(UserWarning, match=rf"a: no frame numbers, and left out: {name}\. Name"):
        captures = capture.open_set(small_set)
    assert captures.scenes[0].frames == (0,)


def test_scene_names_that_are_not_utf8_are_refused(small_set: Path) -> None:
    os.rename(small_set / "a", os.fsencode(small_set) + b"/\xff")
    with pytest.raises(InputError, match=r"scene must have a UTF-8 name; got b'\\xff'\. Rename"):
        capture.open_set(small_set)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("distortion = [-0.3, 0.1, 0, 0, 0]", "distortion is not applied; images are taken as"),
        ('right_fx_px = 440.0\nowner = "lab"', "unknown keys are not used: owner, right_fx_px"),
    ],
)
@pytest.mark.parametrize("file", ["capture.toml", "a/camera.toml"])
def test_values_that_nothing_uses_are_reported(
    small_set: Path, file: str, line: str, message: str
) -> None:
    text = (small_set / "capture.toml").read_text()
    (small_set / file).write_text(f"{text}{line}\n")
    with pytest.warns(UserWarning, match=f"{file}: {message}"):
        capture.open_set(small_set)


def test_distortion_of_zero_is_silent_and_unknown_keys_are_kept(small_set: Path) -> None:
    path = small_set / "capture.toml"
    path.write_text(path.read_text() + "distortion = [0, 0, 0, 0, 0]\n")
    capture.open_set(small_set)
    assert capture_info.from_table({**_table(small_set), "owner": 1}).extra == {"owner": 1}


def test_unreadable_folder_is_refused(small_set: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path) -> list[Path]:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(InputError, match=r"must be a readable folder; .*Permission denied"):
        capture.open_set(small_set)


def test_unreadable_frame_is_refused(small_set: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (scene, *_) = capture.open_set(small_set).scenes

    def refuse(self: Path) -> os.stat_result:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "lstat", refuse)
    with pytest.raises(InputError, match=r"readable folder; got .*/a/0\. Permission denied"):
        scene.frame(0)


def test_room_must_be_text(small_set: Path) -> None:
    (small_set / "a" / "room").write_bytes(b"\xff")
    with pytest.raises(InputError, match="room must be UTF-8 text"):
        capture.open_set(small_set)
    (small_set / "a" / "room").unlink()
    (small_set / "a" / "room").mkdir()
    with pytest.raises(InputError, match="room must be readable"):
        capture.open_set(small_set)


def _colour(image: np.ndarray) -> np.ndarray:
    return np.dstack([image] * 3)


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        ("ir_left", _colour, "ir_left must be a grey PNG of 8 or 16 bits; got .* 8-bit colour"),
        (
            "ir_right",
            lambda im: im[:, :-8],
            "ir_right must be 160x48 as capture.toml says; .*152x48",
        ),
        ("ir_right", lambda im: im.astype(np.uint16), "ir pair must be of one bit depth"),
        ("depth", lambda im: im.astype(np.uint8), "depth must be a 16-bit PNG"),
        ("depth", lambda im: im[:-8], "depth must be 160x48"),
    ],
)
def test_wrong_images_are_refused(small_set: Path, name: str, make: Callable, message: str) -> None:
    path = small_set / "a" / "0" / f"{name}.png"
    _write(path, make(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)))
    with pytest.raises(InputError, match=message):
        capture.open_set(small_set).scenes[0].frame(0)


def test_wrong_frames_are_refused(small_set: Path) -> None:
    scene = capture.open_set(small_set).scenes[0]
    folder = small_set / "a" / "0"
    with pytest.raises(InputError, match=r"frame of a must exist; got 7. There are: 0."):
        scene.frame(7)
    for content, message in {
        b"{": "frame.json must be JSON",
        b"[]": "frame.json must be one object",
        b"\xff": "frame.json must be UTF-8",
        b"[" * 100_000: "frame.json must be JSON",
    }.items():
        (folder / "frame.json").write_bytes(content)
        with pytest.raises(InputError, match=message):
            scene.frame(0)
    (folder / "frame.json").unlink()
    (folder / "ir_left.png").unlink()
    with pytest.raises(InputError, match="ir pair must have its left image"):
        scene.frame(0)
    (folder / "ir_right.png").unlink()
    (folder / "depth.png").unlink()
    with pytest.raises(InputError, match=r"frame must hold ir_left.png or depth.png"):
        scene.frame(0)


def test_a_pair_of_equal_images_is_reported(small_set: Path) -> None:
    folder = small_set / "a" / "0"
    shutil.copyfile(folder / "ir_left.png", folder / "ir_right.png")
    with pytest.warns(UserWarning, match="ir pair has two equal images"):
        capture.open_set(small_set).scenes[0].frame(0)


def test_sensor_takes_the_captures_geometry(small_set: Path) -> None:
    from starling.sim.sensor import presets

    info = capture.open_set(small_set).info
    sensor = info.geometry_into(presets.load("d415"))
    assert (sensor.width, sensor.fx_px, sensor.baseline_m) == (160, 90.0, 0.05)


def test_captures_of_another_size_have_other_pixels(small_set: Path) -> None:
    """The nearest depth follows the focal length, as the search has a fixed number of pixels."""
    from starling.sim.sensor import presets

    info, device = capture.open_set(small_set).info, presets.load("d415")
    ratio = info.fx_px / device.fx_px
    sensor = info.geometry_into(device)
    assert sensor.post.near_m == pytest.approx(ratio * device.post.near_m)
    assert sensor.left.pixel_pitch_m == pytest.approx(device.left.pixel_pitch_m / ratio)
    same_size = dataclasses.replace(info, width=1280, height=720, fx_px=899.8, fy_px=899.8)
    same = same_size.geometry_into(device)
    assert (same.left, same.post) == (device.left, device.post)


def test_fullest_frame_is_the_first_with_a_pair_and_depth(small_set: Path) -> None:
    scene = small_set / "a"
    for number in "123":
        shutil.copytree(scene / "0", scene / number)

    def fullest() -> int:
        return capture.open_set(scene).scenes[0].fullest().number

    assert fullest() == 0
    (scene / "0" / "ir_right.png").unlink()
    (scene / "1" / "depth.png").unlink()
    assert fullest() == 2
    for number in "23":
        (scene / number / "depth.png").unlink()
    assert fullest() == 1
    for number in "123":
        (scene / number / "ir_right.png").unlink()
    assert fullest() == 0
    (scene / "0" / "ir_left.png").unlink()
    assert fullest() == 1
    for number in "123":
        shutil.rmtree(scene / number)
    assert fullest() == 0


def test_scene_can_have_its_own_camera(small_set: Path) -> None:
    captures = capture.open_set(small_set)
    captures.refuse_mixed()
    scene = captures.scenes[0]
    second = dataclasses.replace(captures.info, fx_px=captures.info.fx_px * 1.1, sensor="another")
    (scene.path / "camera.toml").write_text(capture_info.dumps(second))
    mixed = capture.open_set(small_set)
    assert mixed.scenes[0].info == second and mixed.info == captures.info
    alone = capture.open_set(scene.path)
    assert alone.info == second
    alone.refuse_mixed()
    with pytest.raises(InputError, match=r"captures must be of one camera here; got .*camera.toml"):
        mixed.refuse_mixed()
    with pytest.raises(InputError, match="captures must be of one camera here"):
        resolve.load("d435", captures=str(small_set))


@pytest.mark.parametrize("name", ["cx_px", "cy_px"])
def test_a_sensor_with_another_centre_is_another_camera(name: str) -> None:
    sensor = presets.load("d435")
    info = info_of(sensor, source="", licence="", notes="")
    assert info.are_of(sensor)
    off = getattr(sensor, name) + 0.006 * sensor.width
    assert not info.are_of(dataclasses.replace(sensor, **{name: off}))
