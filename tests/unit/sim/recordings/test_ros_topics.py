"""Recordings of ROS topics, written by `rosbags`; round trips of our own exports."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from starling.patterns.errors import InputError
from starling.sim.captures import capture, png
from starling.sim.captures.exchange import ros2_bag
from starling.sim.captures.recordings.import_recording import FrameChoice, import_recording
from starling.sim.captures.recordings.statement import GivenFacts
from starling.sim.geometry import frames
from tests.unit.sim.recordings import scene
from tests.unit.sim.recordings.ros import Topics

SPACE = "/camera/camera"
LEFT, RIGHT = f"{SPACE}/infra1/image_rect_raw", f"{SPACE}/infra2/image_rect_raw"
DEPTH = f"{SPACE}/depth/image_rect_raw"
GIVEN = GivenFacts(emitter="on", sensor="d435")


def imported(path: Path, out: Path, **more: Any) -> Any:
    """Import with the facts that plain topics lack."""
    import_recording(path, out, **{"flags": GIVEN, **more})
    return capture.open_set(out)


def write_set(folder: Path, *, unit_m: float) -> None:
    """Write a set with all that an export takes: colour, unlit images, poses, exposures."""
    (folder / "desk").mkdir(parents=True)
    (folder / "capture.toml").write_text(
        f"""sensor = "d435"
width = {scene.WIDTH}
height = {scene.HEIGHT}
fx_px = {scene.FX}
fy_px = {scene.FX + 0.7}
cx_px = {scene.CX}
cy_px = {scene.CY}
baseline_m = 0.0501234
depth_unit_m = {unit_m}
source = "test"
licence = "none"
notes = ""
projector = "on and off"
black_level_dn = 4.5
colour_from_left = {np.linalg.inv(frames.pose((0.015, 1e-4, 2e-4), (0.1, -0.3, 0.2))).tolist()}
[colour]
width = 64
height = 48
fx_px = 60.0
fy_px = 61.0
cx_px = 31.5
cy_px = 23.5
"""
    )
    for number in range(3):
        place = folder / "desk" / str(number)
        place.mkdir()
        left, right = scene.pair(number)
        rng = np.random.default_rng(number)
        images: dict[str, Any] = {"ir_left": left, "ir_right": right}
        images |= dict(
            zip(("ir_left_off", "ir_right_off"), scene.pair(number, dots=0), strict=True)
        )
        code = scene.depth_code(unit_m)
        images["depth"] = code + rng.integers(0, 3, code.shape).astype(np.uint16) * (code > 0)
        for name, image in images.items():
            (place / f"{name}.png").write_bytes(png.encode(image))
        colour = rng.integers(0, 255, (48, 64, 3), np.uint8)
        (place / "rgb.png").write_bytes(png.encode_colour(colour))
        pose = frames.pose((0.001 * number, 0, 0), (0, 0, 0.1))
        record = {"exposure_s": round(0.0081 + 1e-4 * number, 6), "gain": 1.5, "laser_power": 150}
        record |= {"timestamp": 1000.25 + number, "left_from_world": pose.tolist()}
        (place / "frame.json").write_text(json.dumps(record))


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize("unit_m", [1e-3, 1e-4, 1 / 5000])
def test_export_and_import_lose_nothing(unit_m: float, storage: Any, tmp_path: Path):
    write_set(tmp_path / "set", unit_m=unit_m)
    before = capture.open_set(tmp_path / "set")
    ros2_bag.export(before.scenes, tmp_path / "bag", storage=storage)
    import_recording(tmp_path / "bag", tmp_path / "back")
    after = capture.open_set(tmp_path / "back")
    for key in ("width", "height", "fx_px", "fy_px", "cx_px", "cy_px", "baseline_m"):
        assert getattr(after.info, key) == getattr(before.info, key)
    for key in ("depth_unit_m", "colour", "sensor", "projector", "black_level_dn"):
        assert getattr(after.info, key) == getattr(before.info, key)
    np.testing.assert_allclose(
        after.info.colour_from_left, before.info.colour_from_left, atol=1e-12
    )
    (first,), (second,) = before.scenes, after.scenes
    assert first.frames == second.frames
    for number in first.frames:
        files = {path.name for path in (first.path / str(number)).iterdir()}
        assert files == {path.name for path in (second.path / str(number)).iterdir()}
        for name in files - {"frame.json"}:
            images = [
                cv2.imread(str(each.path / str(number) / name), cv2.IMREAD_UNCHANGED)
                for each in (first, second)
            ]
            np.testing.assert_array_equal(*images)
        old, new = first.record(number), second.record(number)
        for key in ("exposure_s", "gain", "laser_power", "timestamp"):
            assert new[key] == old[key]
        np.testing.assert_allclose(new["left_from_world"], old["left_from_world"], atol=1e-12)


def test_the_names_of_realsense_ros_are_found(tmp_path: Path):
    for number, space in enumerate(("/camera/camera", "/camera", "/d435_left")):
        topics = Topics().pair(
            f"{space}/infra1/image_rect_raw",
            f"{space}/infra2/image_rect_raw",
            depth=f"{space}/depth/image_rect_raw",
        )
        topics.image(f"{space}/aligned_depth_to_color/image_raw", 100, scene.depth_code(), "16UC1")
        captures = imported(topics.write(tmp_path / f"bag{number}"), tmp_path / f"set{number}")
        frame = captures.scenes[0].frame(2)
        np.testing.assert_array_equal(frame.ir_right, scene.pair(2)[1])
        assert captures.info.baseline_m == pytest.approx(scene.BASELINE_M, abs=1e-12)


def test_topics_are_named_by_flags(tmp_path: Path):
    path = Topics().pair("/a/eye", "/b/eye", depth="/c/z").write(tmp_path / "bag")
    with pytest.raises(InputError, match=r"must have a left infrared topic; got /a/eye.*--left TO"):
        imported(path, tmp_path / "set")
    streams = {"left": "/a/eye", "right": "/b/eye", "depth": "/c/z"}
    frame = imported(path, tmp_path / "set", streams=streams).scenes[0].frame(0)
    np.testing.assert_array_equal(frame.ir_right, scene.pair(0)[1])
    assert np.nanmedian(frame.depth_m) == pytest.approx(scene.DEPTH_M, abs=1e-3)
    with pytest.raises(
        InputError, match=r"--left must name a topic of images; got /a/eyes\. Those"
    ):
        imported(path, tmp_path / "new", streams={"left": "/a/eyes"})
    with pytest.raises(InputError, match=r"--left must name a topic.*CameraInfo"):
        imported(path, tmp_path / "new", streams={"left": "/a/camera_info"})


def test_a_folder_around_a_bag_is_read_as_the_bag(tmp_path: Path):
    topics = Topics().pair("/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw")
    topics.write(tmp_path / "out" / "one")
    assert len(imported(tmp_path / "out", tmp_path / "set").scenes) == 1
    topics.write(tmp_path / "out" / "two")
    with pytest.raises(InputError, match=r"^source must hold one bag; got one, two\. Give the"):
        imported(tmp_path / "out", tmp_path / "again")


def test_two_cameras_in_one_bag_are_refused(tmp_path: Path):
    topics = Topics().pair("/one/infra1/image_rect_raw", "/one/infra2/image_rect_raw")
    topics.pair("/two/infra1/image_rect_raw", "/two/infra2/image_rect_raw")
    with pytest.raises(InputError, match=r"bag must have one left topic; got /one.*--left TOPIC"):
        imported(topics.write(tmp_path / "bag"), tmp_path / "set")


def test_ros1_bags_of_the_driver_are_read(tmp_path: Path):
    topics = Topics(is_ros1=True).pair(
        "/camera/infra1/image_rect_raw",
        "/camera/infra2/image_rect_raw",
        depth="/camera/depth/image_rect_raw",
    )
    captures = imported(topics.write(tmp_path / "desk.bag"), tmp_path / "set")
    np.testing.assert_array_equal(captures.scenes[0].frame(1).ir_left, scene.pair(1)[0])
    assert captures.info.fx_px == scene.FX


def test_compressed_topics_are_read(tmp_path: Path):
    topics = Topics().pair("/x/left/other", "/x/right/other", count=1)
    left, right = scene.pair(0)
    codes = scene.depth_code()
    data = {
        "left": (cv2.imencode(".png", left)[1].tobytes(), "mono8; png compressed "),
        "right": (cv2.imencode(".jpg", right)[1].tobytes(), "mono8; jpeg compressed "),
        "depth": (
            struct.pack("<iff", 0, 0, 0) + cv2.imencode(".png", codes)[1].tobytes(),
            "16UC1; compressedDepth png",
        ),
    }
    streams = {name: f"/x/{name}/image/compressed" for name in data}
    for name, (content, form) in data.items():
        topics.compressed(streams[name], 100, content, form)
    topics.info("/x/left/camera_info", 100)
    topics.info("/x/right/camera_info", 100, baseline_m=0.05)
    path = topics.write(tmp_path / "bag")
    with pytest.warns(UserWarning, match="right images are compressed by jpeg"):
        frame = imported(path, tmp_path / "set", streams=streams).scenes[0].frame(0)
    np.testing.assert_array_equal(frame.ir_left, left)
    assert np.abs(frame.ir_right.astype(int) - right).mean() < 3
    assert np.isnan(frame.depth_m[0, 0]) and frame.depth_m[50, 50] == pytest.approx(
        scene.DEPTH_M, abs=1e-3
    )


@pytest.mark.parametrize("form", ["mono8; theora", "16UC1; compressedDepth rvl", ""])
def test_unknown_codecs_are_refused_by_name(form: str, tmp_path: Path):
    topics = Topics().pair("/x/left/other", "/x/right/other", count=1)
    topics.compressed("/x/left/image_rect/compressed", 100, b"0123456789abcdef", form)
    codec = form.rpartition(";")[2].strip() or "unknown"
    rule = "/x/left/image_rect/compressed must be compressed by png, jpeg or compressedDepth png"
    with pytest.raises(InputError, match=f"{rule}; got {codec}"):
        imported(topics.write(tmp_path / "bag"), tmp_path / "set")


def test_floating_point_depth_becomes_fine_codes(tmp_path: Path):
    depth_m = np.full((scene.HEIGHT, scene.WIDTH), scene.DEPTH_M, np.float32)
    depth_m[:9] = np.nan
    inverse = np.where(np.isfinite(depth_m), 100 / depth_m, 0).round().astype(np.uint16)
    data = struct.pack("<iff", 0, 100, 0) + cv2.imencode(".png", inverse)[1].tobytes()
    for number in range(2):
        topics = Topics().pair(LEFT, RIGHT, count=1)
        if number:
            topics.compressed(f"{DEPTH}/compressedDepth", 100, data, "32FC1; compressedDepth png")
        else:
            topics.image(DEPTH, 100, depth_m, "32FC1")
        captures = imported(topics.write(tmp_path / f"bag{number}"), tmp_path / f"set{number}")
        depth = captures.scenes[0].frame(0).depth_m
        assert captures.info.depth_unit_m == 1e-4
        assert np.isnan(depth[:9]).all()
        tolerance = 0.005 if number else 6e-5
        np.testing.assert_allclose(depth[9:], scene.DEPTH_M, atol=tolerance)


def test_encodings_are_converted_or_refused_by_name(tmp_path: Path):
    left, _ = scene.pair(0)
    grey = np.dstack([left] * 3)
    packed = np.dstack([left, np.full_like(left, 128)])
    wide = left.astype(">u2")
    cases = {"bgr8": grey, "rgba8": np.dstack([grey, left]), "yuv422_yuy2": packed, "mono16": wide}
    for encoding, pixels in cases.items():
        topics = Topics()
        topics.image(LEFT, 100, pixels, encoding, pad=8)
        topics.info(f"{SPACE}/infra1/camera_info", 100)
        flags = GivenFacts(emitter="on", sensor="d435", baseline_m=0.05)
        path = topics.write(tmp_path / f"bag-{encoding}")
        frame = imported(path, tmp_path / encoding, flags=flags).scenes[0].frame(0)
        slack = 20 if "yuv" in encoding else 0  # Its range is 16 to 235.
        assert np.abs(frame.ir_left.astype(int) - left).max() <= max(slack, 0) or slack
    topics = Topics()
    topics.image(LEFT, 100, left, "bayer_rggb8")
    with pytest.raises(InputError, match=r"image_rect_raw must have an encoding.*got bayer_rggb8"):
        imported(topics.write(tmp_path / "bayer"), tmp_path / "new")
    topics = Topics()
    topics.image(LEFT, 100, np.dstack([left, left // 2, left]), "rgb8")
    topics.info(f"{SPACE}/infra1/camera_info", 100)
    flags = GivenFacts(emitter="on", sensor="d435", baseline_m=0.05)
    with pytest.raises(InputError, match=r"left of frame 0 must be grey; got a colour image"):
        imported(topics.write(tmp_path / "colour"), tmp_path / "new", flags=flags)


def test_missing_intrinsics_are_asked_for(tmp_path: Path):
    topics = Topics()
    left, right = scene.pair(0)
    topics.image(LEFT, 100, left, "mono8")
    topics.image(RIGHT, 100, right, "mono8")
    path = topics.write(tmp_path / "bag")
    with pytest.raises(InputError, match=r"intrinsics must be given; got none.*--calibration FILE"):
        imported(path, tmp_path / "set")
    (tmp_path / "cal.txt").write_text(scene.LISTING)
    flags = GivenFacts(emitter="on", sensor="d435", calibration=(tmp_path / "cal.txt",))
    captures = imported(path, tmp_path / "set", flags=flags)
    assert captures.info.baseline_m == scene.BASELINE_M


def test_baseline_of_the_frames_or_the_extrinsics_topic(tmp_path: Path):
    write_set(tmp_path / "set", unit_m=1e-3)
    for number, lost in enumerate(("/tf_static", "extrinsics/depth_to_infra2")):
        source = capture.open_set(tmp_path / "set")
        bag = tmp_path / f"bag{number}"
        ros2_bag.export(source.scenes, bag)
        import sqlite3

        with sqlite3.connect(bag / f"{bag.name}.db3") as base:
            base.execute(
                "DELETE FROM messages WHERE topic_id IN (SELECT id FROM topics WHERE "
                f"name LIKE '%infra2/camera_info' OR name LIKE '%{lost}')"
            )
        flags = GivenFacts()
        after = imported(bag, tmp_path / f"back{number}", flags=flags)
        assert after.info.baseline_m == pytest.approx(0.0501234, abs=1e-9)
        base.close()


def test_unrectified_pairs_are_refused_or_rectified(tmp_path: Path):
    """The check needs no calibration; the remedy does."""
    path = Topics().pair(LEFT, RIGHT, rows_px=3).write(tmp_path / "bag")
    with pytest.raises(InputError, match=r"pair must be rectified, with rows within 1 px; got 3"):
        imported(path, tmp_path / "set")
    flags = GivenFacts(emitter="on", sensor="d435", rectify=True)
    with pytest.raises(InputError, match=r"--rectify must come with distortion of both imagers"):
        imported(path, tmp_path / "set", flags=flags)


def test_distorted_images_are_rectified_on_demand(tmp_path: Path):
    topics = Topics(distortion=(-0.05, 0.01, 0, 0, 0))
    names = [f"/cam/{side}/image_raw" for side in ("left", "right")]
    topics.pair(*names, depth=DEPTH)
    path = topics.write(tmp_path / "bag")
    with pytest.raises(InputError, match=r"images must be rectified; got distortion -0\.05, 0\.01"):
        imported(path, tmp_path / "set")
    flags = GivenFacts(emitter="on", sensor="d435", rectify=True)
    with pytest.warns(UserWarning, match="device depth is left out"):
        captures = imported(path, tmp_path / "set", flags=flags)
    frame = captures.scenes[0].frame(0)
    expected = cv2.undistort(scene.pair(0)[0], np.array(scene.K), np.array([-0.05, 0.01, 0, 0, 0]))
    # `undistort` rounds its map to 1/32 px.
    assert np.abs(frame.ir_left.astype(int) - expected).mean() < 0.3
    assert captures.info.baseline_m == pytest.approx(scene.BASELINE_M) and frame.depth_m is None
    topics = Topics(distortion=(0.1, 0, 0, 0))
    topics.model = "equidistant"
    path = topics.pair(*names).write(tmp_path / "fisheye")
    with pytest.raises(InputError, match=r"distortion model must be one of .*; got equidistant"):
        imported(path, tmp_path / "new", flags=flags)


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_truncated_recordings_give_what_is_whole(storage: str, tmp_path: Path):
    path = Topics().pair(LEFT, RIGHT, count=12, depth=DEPTH).write(tmp_path / "bag", storage)
    (file,) = (each for each in path.iterdir() if each.suffix in (".db3", ".mcap"))
    whole = file.read_bytes()
    file.write_bytes(whole[: int(0.6 * len(whole))])
    (path / "metadata.yaml").unlink()
    with pytest.warns(UserWarning) as warned:
        captures = imported(path, tmp_path / "set")
    texts = " ".join(str(each.message) for each in warned)
    assert "what is whole is imported" in texts and "metadata.yaml is missing" in texts
    (only,) = captures.scenes
    assert 4 <= len(only.frames) < 12
    np.testing.assert_array_equal(only.frame(3).ir_right, scene.pair(3)[1])


def test_other_files_are_refused_by_name(tmp_path: Path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"text")
    with pytest.raises(InputError, match="source must be an MCAP file; got"):
        imported(path, tmp_path / "set")
    path = tmp_path / "a.db3"
    path.write_bytes(b"text" * 300)
    with pytest.raises(InputError, match="source must be a ROS 2 bag; got"):
        imported(path, tmp_path / "set")
    for name in ("a.mcap.zstd", "a.avi"):
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(InputError, match=r"source must be a folder or a file of \.bag, \.db3"):
            imported(tmp_path / name, tmp_path / "set")
    packed = tmp_path / "packed"
    packed.mkdir()
    (packed / "a.db3.zstd").write_bytes(b"")
    with pytest.raises(InputError, match="source must not be compressed as a whole"):
        imported(packed, tmp_path / "set")
    with pytest.raises(InputError, match="source must exist"):
        imported(tmp_path / "none", tmp_path / "set")


def test_messages_of_other_programs_are_refused(tmp_path: Path):
    from starling.sim.captures.recordings.logs import mcap_log

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    def entry(code: int, content: bytes) -> bytes:
        return struct.pack("<BQ", code, len(content)) + content

    channel = struct.pack("<HH", 1, 0) + text("/a") + text("json") + struct.pack("<I", 0)
    path = tmp_path / "a.mcap"
    path.write_bytes(mcap_log.MAGIC + entry(4, channel))
    with pytest.raises(InputError, match=r"a\.mcap must hold messages of ROS; got /a in json"):
        imported(path, tmp_path / "set")


def test_numbers_of_frames_must_be_possible(tmp_path: Path):
    path = Topics().pair(LEFT, RIGHT, count=1).write(tmp_path / "bag")
    with pytest.raises(InputError, match="--every must be in"):
        imported(path, tmp_path / "set", choice=FrameChoice(every=0))
    with pytest.raises(InputError, match="--most-frames must be in"):
        imported(path, tmp_path / "set", choice=FrameChoice(most=-1))
