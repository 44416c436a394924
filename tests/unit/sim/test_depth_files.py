"""Depth images from files, and `starling simulate` of them."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest

from starling import command_line
from starling.patterns.errors import InputError
from starling.sim import corrupt
from starling.sim.captures import capture, depth_file
from starling.sim.commands.corrupt_captures import corrupt_captures
from starling.sim.commands.simulate_captures import scene_seed
from starling.sim.console.output import RECORD
from starling.sim.sensor import edits, presets

SHAPE = (96, 128)
CAMERA = (120.0, 120.0, 63.5, 47.5)
MATRIX = np.array([[120.0, 0, 63.5], [0, 120.0, 47.5], [0, 0, 1]])
SENSOR = edits.with_camera(presets.load("d435"), MATRIX, (128, 96))
FLAGS = ("--sensor", "d435", "--camera-matrix", *map(str, CAMERA))


def depth() -> np.ndarray[Any, Any]:
    image = np.full(SHAPE, 1.25, np.float32)
    image[30:60, 50:90] = 0.75
    return image


def write_exr(path: Path, channels: dict[str, np.ndarray[Any, Any]]) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))


def written(folder: Path, name: str) -> Path:
    path = folder / name
    if path.suffix == ".npy":
        np.save(path, depth())
    elif path.suffix == ".png":
        cv2.imwrite(str(path), np.rint(depth() * 1000).astype(np.uint16))
    else:
        write_exr(path, {"Z": depth()})
    return path


@pytest.mark.parametrize("name", ["d.npy", "d.png", "d.exr", "D.NPY"])
def test_all_formats_hold_the_same_depth(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, name.lower()).rename(tmp_path / name)
    np.testing.assert_allclose(depth_file.read(path), depth(), rtol=1e-6)


@pytest.mark.parametrize(
    ("values", "unit", "expected"),
    [(1250.0, "mm", 1.25), (1250, "", 1.25), (1250, "0.002", 2.5), (1.25, "m", 1.25)],
)
def test_units(tmp_path: Path, values: float, unit: str, expected: float) -> None:
    np.save(tmp_path / "d.npy", np.full((4, 5), values))
    assert depth_file.read(tmp_path / "d.npy", unit)[0, 0] == pytest.approx(expected)


@pytest.mark.parametrize("layout", ["F", "C", ">f4", "<f2", "<f8"])
def test_layouts_of_arrays(tmp_path: Path, layout: str) -> None:
    image = np.arange(1, 13).reshape(3, 4) / 8
    arrays = {"F": np.asfortranarray(image), "C": image}
    array = arrays[layout] if layout in arrays else image.astype(layout)
    np.save(tmp_path / "d.npy", array)
    assert np.array_equal(depth_file.read(tmp_path / "d.npy"), image)


def test_numbers_in_names_are_in_order(tmp_path: Path) -> None:
    for number in (10, 9, 1):
        written(tmp_path, f"d{number}.npy")
    (tmp_path / ".hidden").write_text("")
    assert [path.stem for path in depth_file.files(tmp_path)] == ["d1", "d9", "d10"]
    for name in ("d01.npy", "d²1.npy", "²d1.npy", "²1.npy"):
        written(tmp_path, name)
    assert [path.name for path in depth_file.files(tmp_path)][:2] == ["d01.npy", "d1.npy"]
    (tmp_path / "notes.txt").write_text("")
    assert depth_file.files(tmp_path) == []
    assert depth_file.files(tmp_path / "nowhere") == []


def test_two_files_of_one_frame_are_refused(tmp_path: Path) -> None:
    """As metres and as millimetres of one image, which would be two frames."""
    for name in ("0.npy", "0.png", "1.npy"):
        written(tmp_path, name)
    with pytest.raises(InputError, match=r"scene must hold one image of each name; got 0.npy and"):
        corrupt_captures(tmp_path, SENSOR, tmp_path / "out", camera_matrix=CAMERA)


def test_nanoseconds_in_names_are_in_order(tmp_path: Path) -> None:
    stamps = [1403636579763555584, 1403636579763555585, 1403636579763555586]
    paths = [tmp_path / f"{stamp}.npy" for stamp in stamps]
    assert sorted(reversed(paths), key=depth_file.order) == paths


def write_parts(path: Path, depth_name: str = "Z") -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    colour = OpenEXR.Part({**header, "name": "rgb"}, {"RGB": np.ones((*SHAPE, 3), "f4")}, "rgb")
    other = OpenEXR.Part({**header, "name": "depth"}, {depth_name: depth()}, "depth")
    OpenEXR.File([colour, other]).write(str(path))


def test_depth_beside_colour_and_as_grey(tmp_path: Path) -> None:
    write_parts(tmp_path / "parts.exr")
    write_exr(tmp_path / "grey.exr", {"RGB": np.repeat(depth()[..., None], 3, -1)})
    for name in ("parts.exr", "grey.exr"):
        assert np.array_equal(depth_file.read(tmp_path / name), depth())


def _cropped(path: Path) -> None:
    window = (np.array([10, 10], np.int32), np.array([137, 105], np.int32))
    display = (np.array([0, 0], np.int32), np.array([159, 119], np.int32))
    header = {"type": OpenEXR.scanlineimage, "dataWindow": window, "displayWindow": display}
    OpenEXR.File(header, {"Z": depth()}).write(str(path))


def _coloured(path: Path) -> None:
    write_exr(path, {"RGB": np.stack([depth(), depth() * 2, depth()], -1)})


def _zipped(path: Path) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, a=1)
    path.write_bytes(buffer.getvalue())


def _objects(path: Path) -> None:
    np.save(path, np.array([{}], object), allow_pickle=True)


def _cut(path: Path) -> None:
    """Cut the last byte, whereupon OpenEXR omits the part of depth."""
    parts = [
        OpenEXR.Part({"type": OpenEXR.scanlineimage}, {name: depth()}, name) for name in ("R", "Z")
    ]
    OpenEXR.File(parts).write(str(path))
    path.write_bytes(path.read_bytes()[:-1])


def _truth_values_as_shape(path: Path) -> None:
    np.save(path, depth())
    data = path.read_bytes()
    path.write_bytes(data.replace(b"(96, 128), }  ", b"(True, 128), }", 1))


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        ("a.npy", lambda path: None, "must be a whole NumPy array"),
        ("a.npy", lambda path: path.write_bytes(b"\x93NUMPY"), "must be a whole NumPy array"),
        ("a.npy", _objects, "must be a whole NumPy array"),
        ("a.npy", _zipped, "must be one array"),
        ("a.npy", lambda path: np.save(path, np.zeros((2, 2, 3))), r"must hold \(h, w\) numbers"),
        ("a.npy", lambda path: np.save(path, np.zeros((2, 0))), "width must be in"),
        ("a.npy", lambda path: np.save(path, np.zeros((1, 20000))), r"width must be in \[1, 16384"),
        ("a.npy", lambda path: np.save(path, np.zeros((2, 2), "c8")), "must hold"),
        ("a.exr", lambda path: path.write_bytes(b"\x76\x2f\x31\x01"), "must be a whole OpenEXR"),
        (
            "a.exr",
            lambda path: write_exr(path, {"A": depth(), "B": depth()}),
            "must have one channel, or one of Z",
        ),
        ("a.exr", _cropped, "must not be cropped"),
        ("a.exr", _cut, "must be a whole OpenEXR file; got .*cut short"),
        ("a.npy", _truth_values_as_shape, "must be a whole NumPy array"),
        ("a.exr", _coloured, "must have one channel"),
        ("a.exr", lambda path: write_exr(path, {"Y": depth(), "RY": depth()}), "one channel"),
        ("a.exr", lambda path: write_parts(path, "X"), "must have one channel"),
        ("a.png", lambda path: path.write_bytes(b"x"), "depth must be"),
        ("a.tif", lambda path: path.write_bytes(b"x"), "must be a known name"),
    ],
)
def test_refused_files(tmp_path: Path, name: str, make: Any, message: str) -> None:
    make(tmp_path / name)
    with pytest.raises(InputError, match=message):
        depth_file.read(tmp_path / name)


@pytest.mark.parametrize("unit", ["cm", "0", "nan", "1"])
def test_refused_units(tmp_path: Path, unit: str) -> None:
    with pytest.raises(InputError, match="depth-unit must be m, mm or a step"):
        depth_file.read(written(tmp_path, "d.npy"), unit)


def test_a_depth_image_becomes_a_capture_set(tmp_path: Path) -> None:
    picture = np.full((*SHAPE, 3), 255, np.uint8)
    cv2.imwrite(str(tmp_path / "rgb.png"), picture)
    path, out = written(tmp_path, "table.npy"), tmp_path / "out"
    arguments = [str(path), *FLAGS, "--out", str(out), "--own-camera", "--frames", "2"]
    assert command_line.main(["simulate", *arguments, "--rgb", str(tmp_path / "rgb.png")]) == 0
    captures = capture.open_set(out)
    (scene,) = captures.scenes
    assert (scene.name, scene.frames) == ("table", (0, 1))
    assert captures.info.fx_px == 120 and captures.info.shape == SHAPE
    truth_m = scene.truth_m()
    assert truth_m is not None
    np.testing.assert_allclose(truth_m, depth(), atol=1e-3)
    first, second = (scene.frame(number) for number in scene.frames)
    assert first.ir_left is not None and second.ir_left is not None
    assert not np.array_equal(first.ir_left, second.ir_left)
    assert json.loads((out / RECORD).read_text())["arguments"]["own_camera"] is True


def test_a_folder_is_one_moving_scene_and_filters_go_on(tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    for number in range(3):
        written(folder, f"{number}.npy")
    filtered = edits.with_values(SENSOR, [("post.temporal_alpha", 0.1)])
    spread = {}
    for name, sensor in (("plain", SENSOR), ("filtered", filtered)):
        corrupt_captures(folder, sensor, tmp_path / name, camera_matrix=CAMERA)
        (scene,) = capture.open_set(tmp_path / name).scenes
        assert (scene.name, scene.truth_m()) == ("drive", None)
        assert scene.record(1)["counts"] == "views"
        depths = [scene.frame(number).depth_m for number in (0, 2)]
        assert depths[0] is not None and depths[1] is not None
        spread[name] = float(np.nanmean(np.abs(depths[1] - depths[0])))
    assert spread["filtered"] < 0.7 * spread["plain"]


def test_frames_of_one_image_share_their_light(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each frame equals that of a corruptor with light of its own."""
    path = written(tmp_path, "table.npy")
    lights: list[object] = []
    real = corrupt.layers
    monkeypatch.setattr(corrupt, "layers", lambda *args: lights.append(args) or real(*args))
    corrupt_captures(path, SENSOR, tmp_path / "out", camera_matrix=CAMERA, frames=3)
    assert len(lights) == 1
    camera, (scene,) = corrupt.Corruptor(SENSOR, MATRIX), capture.open_set(tmp_path / "out").scenes
    for number in range(3):
        expected = camera(depth(), seed=scene_seed(0, "table"), frame=number)
        frame = scene.frame(number)
        assert np.array_equal(frame.ir_left, expected.ir_left)
        np.testing.assert_allclose(frame.depth_m, expected.depth_m, atol=1e-3)


@pytest.mark.parametrize("frames", [1, 3])
def test_one_image_without_a_surface_is_refused(tmp_path: Path, frames: int) -> None:
    np.save(tmp_path / "d.npy", depth() * 0)
    with pytest.raises(InputError, match=r"npy must have a surface in view; got none"):
        corrupt_captures(
            tmp_path / "d.npy", SENSOR, tmp_path / "out", camera_matrix=CAMERA, frames=frames
        )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("share", [0, 1])  # Without a surface, and outside the view.
def test_depth_images_without_a_surface_in_view_need_empty(tmp_path: Path, share: int) -> None:
    path, out = tmp_path / "d.npy", tmp_path / "out"
    np.save(path, depth() * share)
    camera = (CAMERA[0], CAMERA[1], CAMERA[2] - 1e4 * share, CAMERA[3])
    with pytest.raises(InputError, match=r"d.npy must have a surface in view; got none"):
        corrupt_captures(path, SENSOR, out, camera_matrix=camera)
    assert not out.exists()
    corrupt_captures(path, SENSOR, out, camera_matrix=camera, empty=True, frames=2)
    (scene,) = capture.open_set(out).scenes
    for number in (0, 1):
        depth_m = scene.frame(number).depth_m
        assert depth_m is not None and np.isnan(depth_m).all()


def test_the_flag_empty_allows_depth_images_without_a_surface(tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    for number in range(2):
        np.save(folder / f"{number}.npy", depth() * 0)
    arguments = ["simulate", str(folder), *FLAGS, "--own-camera", "--out", str(tmp_path / "out")]
    assert command_line.main(arguments) == 1
    assert command_line.main([*arguments, "--empty"]) == 0


def test_pictures_of_another_size_are_named(tmp_path: Path) -> None:
    path, picture = written(tmp_path, "d.npy"), tmp_path / "rgb.png"
    cv2.imwrite(str(picture), np.zeros((128, 96, 3), np.uint8))
    message = r"^rgb must be \(96, 128\), as d.npy; got .*rgb.png with \(128, 96\). Resize it"
    with pytest.raises(InputError, match=message):
        corrupt_captures(path, SENSOR, tmp_path / "out", camera_matrix=CAMERA, rgb=picture)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frames": 2}, "frames must be 1 for a folder of depth images; got 2"),
        ({"rgb": "pictures"}, "rgb must hold 2 pictures, as many as depth images; got 1 in"),
        ({"path": "nowhere.txt"}, r"scene must hold depth images \(.npy, .png, .exr\)"),
        ({"path": "."}, r"scene must hold depth images .*; got .*/drive"),
        ({"seed": -1}, "seed must be an integer in"),
        ({"out": "drive/out"}, "out must"),
    ],
)
def test_refused_runs(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    for folder, names in (("drive", ("0.npy", "1.npy")), ("pictures", ("0.png",))):
        (tmp_path / folder).mkdir()
        for name in names:
            written(tmp_path / folder, name)
    options = {"path": "drive", "out": "out", **change}
    paths = {key: tmp_path / options.pop(key) for key in ("path", "out", "rgb") if key in options}
    with pytest.raises(InputError, match=message):
        corrupt_captures(sensor=SENSOR, camera_matrix=CAMERA, **paths, **options)
    assert not (tmp_path / "out").exists()


def test_images_of_two_sizes_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    written(folder, "1.npy")
    np.save(folder / "2.npy", depth()[:90])
    with pytest.raises(InputError, match=r"2.npy must be \(96, 128\), as 1.npy; got \(90, 128"):
        corrupt_captures(folder, SENSOR, tmp_path / "out", camera_matrix=CAMERA)


@pytest.mark.parametrize("empty", [0, 1])
def test_an_image_without_a_surface_is_a_frame_without_depth(tmp_path: Path, empty: int) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    for number in range(2):
        np.save(folder / f"{number}.npy", depth() * (number != empty))
    with pytest.warns(
        UserWarning, match=f"^1 of 2 depth images have no surface in view, {empty}.npy first"
    ):
        corrupt_captures(folder, SENSOR, tmp_path / "out", camera_matrix=CAMERA)
    (scene,) = capture.open_set(tmp_path / "out").scenes
    for number in range(2):
        depth_m = scene.frame(number).depth_m
        assert depth_m is not None and np.isnan(depth_m).all() == (number == empty)
    for number in range(2):
        np.save(folder / f"{number}.npy", depth() * 0)
    with pytest.raises(InputError, match=r"npy must have a surface in view; got none"):
        corrupt_captures(folder, SENSOR, tmp_path / "all", camera_matrix=CAMERA)
    assert not (tmp_path / "all").exists()


def test_bytes_without_a_unit_give_a_warning(tmp_path: Path) -> None:
    np.save(tmp_path / "d.npy", np.full((4, 4), 200, np.uint8))
    with pytest.warns(UserWarning, match="8-bit depth images are taken as millimetres"):
        assert depth_file.read(tmp_path / "d.npy")[0, 0] == pytest.approx(0.2)
    assert depth_file.read(tmp_path / "d.npy", "0.01")[0, 0] == pytest.approx(2)
    assert not (tmp_path / "out").exists()


def test_hidden_files_are_no_pictures(tmp_path: Path) -> None:
    pictures = tmp_path / "rgb"
    pictures.mkdir()
    cv2.imwrite(str(pictures / "1.png"), np.full((*SHAPE, 3), 255, np.uint8))
    (pictures / ".hidden").write_text("")
    path = written(tmp_path, "d.npy")
    corrupt_captures(path, SENSOR, tmp_path / "out", camera_matrix=CAMERA, rgb=pictures)
    assert (tmp_path / "out").exists()


def test_names_that_are_not_utf8_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "d.npy").rename(tmp_path / "\udcff.npy")
    with pytest.raises(InputError, match="scene must have a UTF-8 name"):
        corrupt_captures(path, SENSOR, tmp_path / "out", camera_matrix=CAMERA)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--sensor", "d435"), "camera-matrix must be given with depth images"),
        ((*FLAGS, "--samples", "4"), "samples, quality must not be given with depth"),
        (("--sensor", "d435", "--camera-matrix", "120", "120", "1e9", "47.5"), "cx must be in"),
        (("--sensor", "d435", "--camera-matrix", "1e300", "120", "63.5", "47.5"), "fx must be in"),
        ((*FLAGS, "--quality", "draft"), "samples, quality must not be given with depth"),
        (
            (*FLAGS, "--own-camera", "--set", "width=640", "--set", "cx_px=319.5"),
            "set must not change the camera",
        ),
    ],
)
def test_refused_flags(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], flags: tuple[str, ...], message: str
) -> None:
    path = written(tmp_path, "d.npy")
    arguments = ["simulate", str(path), "--out", str(tmp_path / "out"), *flags]
    assert command_line.main(arguments) == 1
    assert message in capsys.readouterr().err
