"""Folders of images with calibration files, OAK folders and TUM sequences."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from starling import command_line
from starling.patterns.errors import InputError
from starling.sim.captures import capture, png
from starling.sim.captures.exchange import tum
from starling.sim.captures.recordings.import_recording import FrameChoice, import_recording
from starling.sim.captures.recordings.statement import GivenFacts
from starling.sim.console.output import OutputFolder
from starling.sim.geometry import frames
from tests.unit.sim.recordings import scene

MOVING = FrameChoice(moving=True)
STREAMS = {"left": "ir1_*.png", "right": "ir2_*.png", "depth": "d_*.png"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of three pairs with depth, and its calibrations."""
    path = tmp_path / "shots"
    path.mkdir()
    scene.write_frames(path, 3, first=8)
    (tmp_path / "left.yaml").write_text(scene.LEFT_INFO)
    (tmp_path / "right.yaml").write_text(scene.RIGHT_INFO)
    (tmp_path / "cal.txt").write_text(scene.LISTING)
    return path


def given(folder: Path, **more: Any) -> GivenFacts:
    """Return all facts that a folder of images lacks."""
    facts: dict[str, Any] = {"calibration": (folder.parent / "cal.txt",), "depth_unit": "mm"}
    return GivenFacts(**{**facts, "emitter": "on", "sensor": "d435", **more})


def imported(folder: Path, flags: GivenFacts | None = None, **more: Any) -> Any:
    """Import a folder."""
    options: dict[str, Any] = {"streams": STREAMS, "flags": flags or given(folder), "force": True}
    import_recording(folder, folder.parent / "set", **{**options, **more})
    return capture.open_set(folder.parent / "set")


def test_one_command_imports_a_folder(folder: Path, capsys: pytest.CaptureFixture[str]):
    out = folder.parent / "set"
    flags = [f"--{name}={pattern}" for name, pattern in STREAMS.items()]
    calibration = [
        "--calibration",
        *(str(folder.parent / f"{side}.yaml") for side in ("left", "right")),
    ]
    facts = ["--depth-unit", "mm", "--emitter", "on", "--sensor", "d435", "--black-level", "4"]
    command = ["import", str(folder), "--out", str(out), *flags, *calibration, *facts, "--json"]
    assert command_line.main(command) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["frames"] == 3 and report["seen"]["dots"] == "yes"
    captures = capture.open_set(out)
    assert captures.info.baseline_m == pytest.approx(scene.BASELINE_M)
    assert captures.info.black_level_dn == 4
    for number in captures.scenes[0].frames:  # In the order of numbers, not of texts.
        np.testing.assert_array_equal(
            captures.scenes[0].frame(number).ir_left, scene.pair(number)[0]
        )
    assert command_line.main(["match", str(out), "--sensor", "d435", "--setting", "fast"]) == 0
    assert "pair" in capsys.readouterr().out


def test_pipes_and_capture_sets_are_refused(folder: Path):
    os.mkfifo(folder.parent / "pipe.bag")
    with pytest.raises(InputError, match="source must be no pipe or device; got"):
        imported(folder.parent / "pipe.bag")
    (folder / "capture.toml").write_text("")
    with pytest.raises(
        InputError, match=r"source must be no capture set; got .*It needs no import"
    ):
        imported(folder)


def test_every_missing_fact_is_asked_for_by_its_flag(folder: Path):
    camera = folder.parent / "left.yaml"
    cases = {
        "calibration": ((), "intrinsics must be given; .*--calibration FILE"),
        "depth_unit": ("", "unit of the depth values must be given; .*--depth-unit mm"),
        "emitter": (None, "emitter must be given, .*; got dots in the images.*--emitter on"),
        "sensor": ("", "sensor must be given, .*--sensor NAME"),
    }
    for name, (value, message) in cases.items():
        with pytest.raises(InputError, match=message):
            imported(folder, given(folder, **{name: value}))
    alone = {"calibration": (camera,)}
    with pytest.raises(
        InputError, match=r"baseline must be given; .*--baseline METRES, 0\.05\d* as"
    ):
        imported(folder, given(folder, **alone))
    captures = imported(folder, given(folder, **alone, baseline_m=0.0499))
    assert captures.info.baseline_m == 0.0499
    with pytest.raises(InputError, match="--calibration must be one file, or those of left and ri"):
        imported(folder, given(folder, calibration=(camera,) * 3))


def test_a_unit_ten_times_too_large_is_refused(folder: Path):
    """The depth of a D405 in 0.1 mm, read as millimetres."""
    for path in folder.glob("d_*.png"):
        path.write_bytes(png.encode(scene.depth_code(1e-4)))
    with pytest.raises(InputError, match=r"depth must agree.*got 10 times.*--depth-unit 0\.0001"):
        imported(folder)
    assert imported(folder, given(folder, depth_unit="0.0001")).info.depth_unit_m == 1e-4


def test_a_slightly_wrong_baseline_is_warned_of(folder: Path):
    with pytest.warns(UserWarning, match=r"depth is 0\.909 times what the infrared pair gives"):
        imported(folder, given(folder, baseline_m=0.055))


def test_numpy_and_tiff_files_are_read(folder: Path):
    for number in range(3):
        left, right = scene.pair(number)
        np.save(folder / f"l{number}.npy", left[..., None])
        cv2.imwrite(str(folder / f"r{number}.tiff"), right)
        np.save(folder / f"z{number}.npy", scene.depth_code() * np.float32(1e-3))
        cv2.imwrite(str(folder / f"t{number}.tif"), scene.depth_code() * np.float32(1e-3))
    streams = {"left": "l*.npy", "right": "r*.tiff", "depth": "z*.npy", "truth": "t0.tif"}
    captures = imported(folder, given(folder, depth_unit="m"), streams=streams)
    (only,) = captures.scenes
    np.testing.assert_array_equal(only.frame(2).ir_left, scene.pair(2)[0])
    assert captures.info.depth_unit_m == 1e-4
    np.testing.assert_allclose(np.nanmedian(only.frame(1).depth_m), scene.DEPTH_M, atol=1e-3)
    np.testing.assert_array_equal(only.truth_m(), only.frame(0).depth_m)
    np.save(folder / "z1.npy", np.full((scene.HEIGHT, scene.WIDTH), 9e9, np.float32))
    with pytest.raises(InputError, match=r"depth must be below 655\.35 m"):
        imported(folder, given(folder, depth_unit="m"), streams=streams)
    np.save(folder / "z1.npy", np.array({"a": 1}, dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="depth must be a whole NumPy array"):
        imported(folder, given(folder, depth_unit="m"), streams=streams)
    np.save(folder / "z1.npy", np.zeros(5))
    with pytest.raises(
        InputError, match=r"depth must be an image \(h, w\); got .*z1\.npy with \(5,"
    ):
        imported(folder, given(folder, depth_unit="m"), streams=streams)


def test_whole_numbers_of_more_bits_are_refused(folder: Path):
    for number in range(3):
        np.save(folder / f"z{number}.npy", scene.depth_code().astype(np.int32) * 1000)
    with pytest.raises(InputError, match="depth must be at most 65535, 16 bits; got"):
        imported(folder, streams={**STREAMS, "depth": "z*.npy"})


def test_pictures_that_are_no_infrared_image_are_refused(folder: Path):
    for number in range(3):
        np.save(folder / f"f{number}.npy", scene.pair(number)[0].astype(np.float32))
        (folder / f"w{number}.png").write_bytes(png.encode(scene.pair(number)[1].astype(np.uint16)))
    (folder / "bad0.tif").write_bytes(b"none")
    with pytest.raises(InputError, match="left of frame 0 must be of 8 or 16 bits; got float32"):
        imported(folder, streams={**STREAMS, "left": "f*.npy"})
    with pytest.raises(InputError, match="frame 0 must have left and right of one bit depth"):
        imported(folder, streams={**STREAMS, "right": "w*.png"})
    with pytest.raises(InputError, match="left must be a readable image"):
        imported(folder, streams={"left": "bad0.tif"})


def test_patterns_must_fit_images_of_the_folder(folder: Path):
    with pytest.raises(InputError, match=r"--left must fit files of the folder; got x_\*\.png"):
        imported(folder, streams={**STREAMS, "left": "x_*.png"})
    with pytest.raises(InputError, match="--left must be a pattern inside the folder"):
        imported(folder, streams={**STREAMS, "left": "../set/*.png"})
    (folder / "notes.txt").write_text("")
    with pytest.raises(InputError, match=r"--left must name images; got .*notes\.txt"):
        imported(folder, streams={**STREAMS, "left": "notes*"})
    for path in folder.glob("ir1_*.png"):
        path.rename(folder / f"a{path.name}")
    with pytest.raises(InputError, match=r"source must hold left infrared images; .*--left 'ir1_"):
        imported(folder, streams={"depth": "d_*.png"})


def test_images_are_paired_by_their_numbers_or_in_order(folder: Path):
    (folder / "ir2_9.png").unlink()
    report = import_recording(folder, folder.parent / "a", streams=STREAMS, flags=given(folder))
    assert report["frames"] == 2 and report["left_out"]["unpaired"] == 1
    for number, path in enumerate([folder / "ir2_8.png", folder / "ir2_10.png"]):
        path.rename(folder / f"ir2_x{number}.png")
    with pytest.raises(
        InputError, match="images must have names with equal numbers; got 3 left, 2"
    ):
        imported(folder)
    (folder / "ir1_9.png").unlink()
    (folder / "d_9.png").unlink()
    captures = imported(folder)
    np.testing.assert_array_equal(captures.scenes[0].frame(1).ir_right, scene.pair(2)[1])


def test_truth_is_one_image_or_one_for_each_frame(folder: Path):
    for number in range(3):
        (folder / f"gt_{number}.png").write_bytes(png.encode(scene.depth_code() + number))
    captures = imported(folder, streams={**STREAMS, "truth": "gt_*.png"}, choice=MOVING)
    assert captures.scenes[2].truth_m()[50, 50] == pytest.approx(scene.DEPTH_M + 0.002, abs=1e-3)
    (folder / "gt_2.png").unlink()
    with pytest.raises(InputError, match="--truth must be one image, or one for each frame; got 2"):
        imported(folder, streams={**STREAMS, "truth": "gt_*.png"})


def test_images_of_unequal_sizes_are_refused(folder: Path):
    (folder / "d_9.png").write_bytes(png.encode(scene.depth_code()[:100]))
    with pytest.raises(InputError, match=r"depth of frame 1 must be 320x240 as the left image"):
        imported(folder)
    for path in folder.glob("ir*.png"):
        path.write_bytes(png.encode(scene.dotted(width=160, height=120)))
    with pytest.raises(InputError, match=r"camera_matrix in .* must have the image size 160x120"):
        imported(folder, streams={"left": "ir1_*.png"})


def test_swapped_and_unrectified_pairs_are_refused(folder: Path):
    swapped = {**STREAMS, "left": STREAMS["right"], "right": STREAMS["left"]}
    with pytest.raises(InputError, match=r"pair must have the left image first; got a median d"):
        imported(folder, streams=swapped)
    for number in range(3):
        _, right = scene.pair(number, rows_px=2)
        (folder / f"ir2_{number + 8}.png").write_bytes(png.encode(right))
    with pytest.raises(InputError, match=r"pair must be rectified, .*--rectify"):
        imported(folder)
    both = tuple(folder.parent / f"{side}.yaml" for side in ("left", "right"))
    with pytest.raises(InputError, match=r"pair must be rectified.*Is the calibration that of th"):
        imported(folder, given(folder, calibration=both, rectify=True))


def test_calibrations_of_an_unrectified_pair_must_be_whole(folder: Path):
    left, right = (folder.parent / f"{side}.yaml" for side in ("left", "right"))

    def refused(message: str) -> None:
        with pytest.raises(InputError, match=message):
            imported(folder, given(folder, calibration=(left, right), rectify=True))

    right.write_text(scene.RIGHT_INFO.replace(f"{scene.FX}, 0, {scene.CX}, -", "230.0, 0, 1.0, -"))
    refused("calibration must have P of one rectified pair; got fx 240.5 and 230")
    right.write_text(scene.LEFT_INFO)
    refused("calibration must give the right imager's place")
    right.write_text(scene.RIGHT_INFO.replace("image_height: 240", "image_height: 200"))
    refused("calibration must be of images as wide and high as 320x240, or scaled alike")
    right.write_text("image_width: 3")
    refused("right.yaml must be a camera_info with width, height, K, D, R and P")


def oak(folder: Path, *, distortion: tuple[float, ...], turn_deg: float) -> None:
    """Write an OAK's folder: distorted, turned images, and its calibration."""
    turn = frames.pose((0, 0, 0), (turn_deg, -turn_deg, turn_deg / 2))[:3, :3]
    k, d = np.array(scene.K), np.array(distortion)
    for side in ("left", "right", "depth"):
        (folder / side).mkdir(parents=True)
    for number in range(2):
        left, right = scene.pair(number)
        for name, image, rotation in (("left", left, np.eye(3)), ("right", right, turn)):
            shown = _distorted(image, k, d, rotation)
            (folder / name / f"{number}.png").write_bytes(png.encode(shown))
        (folder / "depth" / f"{number}.png").write_bytes(png.encode(scene.depth_code()))
    place = -100 * scene.BASELINE_M * turn[:, 0]  # Centimetres.
    none = {"rotationMatrix": [], "toCameraSocket": -1}
    linked = {"rotationMatrix": turn.tolist(), "toCameraSocket": 2}
    linked |= {"translation": dict(zip("xyz", place, strict=True))}
    camera = {"width": 2 * scene.WIDTH, "height": 2 * scene.HEIGHT, "cameraType": 0}
    double = np.array(scene.K)
    double[:2] *= 2
    double[:2, 2] += 0.5
    camera |= {"intrinsicMatrix": double.tolist(), "distortionCoeff": [*distortion, *[0.0] * 9]}
    table = {
        "cameraData": [[1, {**camera, "extrinsics": linked}], [2, {**camera, "extrinsics": none}]],
        "stereoRectificationData": {"leftCameraSocket": 1, "rightCameraSocket": 2},
    }
    (folder / "calib.json").write_text(json.dumps(table))


def _distorted(
    image: NDArray[np.uint8], k: NDArray[Any], d: NDArray[Any], turn: NDArray[Any]
) -> NDArray[np.uint8]:
    """Return what a turned, distorted imager sees where an ideal one sees `image`."""
    x, y = np.meshgrid(np.arange(scene.WIDTH), np.arange(scene.HEIGHT))
    pixels = np.stack([x, y], axis=-1).reshape(-1, 1, 2).astype(np.float64)
    rays = cv2.undistortPoints(pixels, k, d)[:, 0]
    rays = np.column_stack([rays, np.ones(len(rays))]) @ turn
    seen = (rays @ k.T)[:, :2] / rays[:, 2:]
    maps = seen.reshape(scene.HEIGHT, scene.WIDTH, 2).astype(np.float32)
    return cv2.remap(image, maps[..., 0], maps[..., 1], cv2.INTER_CUBIC, borderValue=40)


def test_an_oak_folder_is_read_as_it_is_or_rectified(tmp_path: Path):
    folder = tmp_path / "oak"
    oak(folder, distortion=(0.0,) * 5, turn_deg=0.0)
    flags = GivenFacts(depth_unit="mm", emitter="on", sensor="oak-d-pro")
    captures = imported(folder, flags, streams={})
    assert captures.info.baseline_m == pytest.approx(scene.BASELINE_M)
    assert captures.info.fx_px == pytest.approx(scene.FX)
    assert captures.info.cx_px == pytest.approx(scene.CX)
    assert captures.scenes[0].frame(1).depth_m is not None


def test_a_distorted_turned_oak_pair_is_rectified(tmp_path: Path):
    folder = tmp_path / "oak"
    oak(folder, distortion=(-0.08, 0.02, 1e-3, -1e-3, 0.0), turn_deg=1.2)
    flags = GivenFacts(depth_unit="mm", emitter="on", sensor="oak-d-pro")
    with pytest.raises(InputError, match="pair must be rectified"):
        imported(folder, flags, streams={})
    flags = GivenFacts(depth_unit="mm", emitter="on", sensor="oak-d-pro", rectify=True)
    with pytest.warns(UserWarning, match="device depth is left out"):
        report = import_recording(folder, tmp_path / "new", flags=flags)
    assert report["seen"]["row_spread_px"] < 0.1 and report["seen"]["windows"] > 54
    depth_m = report["camera"]["fx_px"] * report["baseline_m"] / report["seen"]["disparity_px"]
    assert depth_m == pytest.approx(scene.DEPTH_M, rel=0.03)  # The plane is turned by half of 1.2.


def test_a_damaged_oak_calibration_is_refused(tmp_path: Path):
    folder = tmp_path / "oak"
    oak(folder, distortion=(0.0,) * 5, turn_deg=0.0)
    table = json.loads((folder / "calib.json").read_text())
    for key in ("stereoRectificationData", "cameraData"):
        broken = {**table, key: {"cameraData": 0}}
        (folder / "calib.json").write_text(json.dumps(broken))
        with pytest.raises(InputError, match=r"calib\.json must have cameraData, stereoRect"):
            imported(folder, GivenFacts(depth_unit="mm", rectify=True), streams={})
    table["cameraData"][0][1]["cameraType"] = 1
    (folder / "calib.json").write_text(json.dumps(table))
    with pytest.raises(InputError, match="a distortion that is not OpenCV's"):
        imported(folder, GivenFacts(depth_unit="mm", rectify=True), streams={})


def test_tum_sequences_keep_depth_colour_and_poses(small_set: Path, tmp_path: Path):
    opened = capture.open_set(small_set)
    with OutputFolder(tmp_path / "tum") as folder:
        tum.export(opened.scenes, folder)
    flags = GivenFacts(sensor="kinect-v1", baseline_m=0.075, emitter="on")
    import_recording(tmp_path / "tum", tmp_path / "back", flags=flags, choice=MOVING)
    captures = capture.open_set(tmp_path / "back")
    frame = captures.scenes[0].frame(0)
    assert captures.info.depth_unit_m == tum.UNIT_M and captures.info.fx_px == opened.info.fx_px
    np.testing.assert_allclose(
        frame.depth_m, opened.scenes[0].frame(opened.scenes[0].frames[0]).depth_m, atol=2e-4
    )
    path = tmp_path / "tum" / "camera.txt"
    camera = path.read_text()
    path.unlink()
    import_recording(tmp_path / "tum", tmp_path / "new", flags=flags, camera=camera, choice=MOVING)
    other = " ".join([*camera.split()[:4], "100", "100"])
    with pytest.raises(InputError, match=r"intrinsics must be of images of .*; got 100x100"):
        import_recording(tmp_path / "tum", tmp_path / "other", flags=flags, camera=other)


def test_colour_of_any_kind_and_depth_of_exr_are_read(folder: Path):
    import OpenEXR

    for number in range(3):
        depth_m = scene.depth_code().astype(np.float32) * np.float32(1e-3)
        channels = {"Z": np.where(depth_m > 0, depth_m, np.float32(np.nan))}
        OpenEXR.File({}, channels).write(str(folder / f"z{number}.exr"))
        deep = np.full((10, 12, 3), 513 * (number + 1), np.uint16)
        cv2.imwrite(str(folder / f"c{number}.png"), deep if number else deep[..., 0])
    streams = {**STREAMS, "depth": "z*.exr", "colour": "c*.png"}
    captures = imported(folder, given(folder, depth_unit="m"), streams=streams)
    (only,) = captures.scenes
    assert [int(only.colour(number)[0, 0, 1]) for number in range(3)] == [2, 4, 6]
    assert np.nanmedian(only.frame(1).depth_m) == pytest.approx(scene.DEPTH_M, abs=1e-3)


def test_a_slight_skew_of_rows_is_warned_of(folder: Path):
    turn = cv2.getRotationMatrix2D((scene.WIDTH / 2, scene.HEIGHT / 2), 0.45, 1.0)
    for number in range(3):
        right = scene.pair(number)[1]
        turned = cv2.warpAffine(right, turn, right.shape[::-1], borderValue=40)
        (folder / f"ir2_{number + 8}.png").write_bytes(png.encode(turned))
    with pytest.warns(UserWarning, match=r"rows of left and right differ by up to 0\.\d+ px"):
        imported(folder)
