"""A ROS 2 bag, read back by its ecosystem's own reader."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.captures import capture, png
from starling.sim.captures.exchange import ros2_bag, ros_types
from starling.sim.captures.exchange.stream import in_time_order
from starling.sim.geometry import frames

rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="the extra ros is not installed")

CAMERA = "/camera/camera"


def edit_records(folder: Path, **more: Any) -> None:
    """Add entries to every frame's record; `make(number)` returns the value for each frame."""
    places = [
        scene.path / str(number)
        for scene in capture.open_set(folder).scenes
        for number in scene.frames
    ]
    for place, path in enumerate(places):
        file = path / "frame.json"
        record = json.loads(file.read_text()) if file.exists() else {}
        file.write_text(json.dumps({**record, **{key: make(place) for key, make in more.items()}}))


def played(bag: Path) -> dict[str, list[Any]]:
    """Messages of each topic, in order."""
    types = ros_types.typestore(is_ros1=False)
    result: dict[str, list[Any]] = {}
    with rosbag2.Reader(bag) as reader:
        for connection, time_ns, data in reader.messages():
            message = types.deserialize_cdr(data, connection.msgtype)
            header = getattr(message, "header", None) or message.transforms[0].header
            assert time_ns == header.stamp.sec * 10**9 + header.stamp.nanosec
            result.setdefault(connection.topic, []).append(message)
    return result


def image(message: Any) -> np.ndarray:
    """Decode an image message as a ROS node does."""
    kind = {"mono8": "u1", "mono16": "<u2", "16UC1": "<u2"}[message.encoding]
    assert message.step == message.width * np.dtype(kind).itemsize and not message.is_bigendian
    return message.data.view(kind).reshape(message.height, message.width)


def pose(transform: Any) -> np.ndarray:
    """Return `parent_from_child` of a transform, by the quaternion formula."""
    q, t = transform.transform.rotation, transform.transform.translation
    x, y, z, w = q.x, q.y, q.z, q.w
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = [t.x, t.y, t.z]
    return matrix


def test_images_and_intrinsics_are_those_of_the_captures(small_set: Path, tmp_path: Path):
    captures = capture.open_set(small_set)
    count = ros2_bag.export(captures.scenes, tmp_path / "bag")
    result = played(tmp_path / "bag")
    readings = [scene.frame(number) for scene in captures.scenes for number in scene.frames]
    assert count == len(readings)
    names = {"depth": "depth_m", "infra1": "ir_left", "infra2": "ir_right"}
    for stream, name in names.items():
        images = result[f"{CAMERA}/{stream}/image_rect_raw"]
        infos = result[f"{CAMERA}/{stream}/camera_info"]
        assert len(images) == len(infos) == count
        for message, info, frame in zip(images, infos, readings, strict=True):
            assert message.header == info.header
            seen, inputs = image(message), getattr(frame, name)
            if stream == "depth":
                known = np.isfinite(inputs)
                np.testing.assert_allclose(seen[known] * 1e-3, inputs[known], atol=0.5001e-3)
                assert (seen[~known] == 0).all()
            else:
                np.testing.assert_array_equal(seen, inputs)
    info = captures.info
    right = result[f"{CAMERA}/infra2/camera_info"][0]
    np.testing.assert_allclose(
        right.p.reshape(3, 4)[0], [info.fx_px, 0, info.cx_px, -info.fx_px * info.baseline_m]
    )
    assert right.header.frame_id == "camera_infra1_optical_frame"
    assert result[f"{CAMERA}/depth/camera_info"][0].p[3] == 0


def test_a_point_has_the_position_given_by_the_frames(small_set: Path, tmp_path: Path):
    """The TF chain from world to the optical frame equals `left_from_world`."""
    poses = {place: frames.pose((1, 2, 3), (10.0 * place, 20, 30)) for place in range(20)}
    edit_records(small_set, left_from_world=lambda place: np.linalg.inv(poses[place]).tolist())
    scenes = capture.open_set(small_set).scenes
    ros2_bag.export(scenes, tmp_path / "bag")
    result = played(tmp_path / "bag")
    fixed = {frame.child_frame_id: frame for frame in result["/tf_static"][0].transforms}
    point = np.array([0.3, -0.2, 1.7, 1])
    for place, message in enumerate(result["/tf"]):
        (moved,) = message.transforms
        assert (moved.header.frame_id, moved.child_frame_id) == ("world", "camera_link")
        chain = pose(moved)
        for child in ("camera_depth_frame", "camera_depth_optical_frame"):
            chain = chain @ pose(fixed[child])
        np.testing.assert_allclose(
            np.linalg.inv(chain) @ point, np.linalg.inv(poses[place]) @ point, atol=1e-9
        )
    right = pose(fixed["camera_infra2_frame"]) @ pose(fixed["camera_infra2_optical_frame"])
    left = pose(fixed["camera_infra1_frame"]) @ pose(fixed["camera_infra1_optical_frame"])
    np.testing.assert_allclose(
        (np.linalg.inv(left) @ right)[:3, 3], [scenes[0].info.baseline_m, 0, 0], atol=1e-12
    )


def test_late_subscribers_receive_static_frames(small_set: Path, tmp_path: Path):
    ros2_bag.export(capture.open_set(small_set).scenes, tmp_path / "bag")
    with rosbag2.Reader(tmp_path / "bag") as reader:
        (fixed,) = [
            connection for connection in reader.connections if connection.topic == "/tf_static"
        ]
        (quality,) = fixed.ext.offered_qos_profiles
        assert quality.durability.name == "TRANSIENT_LOCAL"
        assert reader.start_time == 10**9  # A stamp of 0 would mean "now" to tf2.


def test_frames_are_ordered_by_their_time_stamps(small_set: Path, tmp_path: Path):
    edit_records(small_set, timestamp=lambda place: 100.25 - place)
    taken = in_time_order(capture.open_set(small_set).scenes)
    assert [frame.time_s for frame in taken] == sorted(frame.time_s for frame in taken)
    assert taken[-1].time_s == 100.25 and taken[-1].number == 0
    ros2_bag.export(capture.open_set(small_set).scenes, tmp_path / "bag")
    stamps = [
        frame.header.stamp for frame in played(tmp_path / "bag")[f"{CAMERA}/depth/camera_info"]
    ]
    assert (stamps[-1].sec, stamps[-1].nanosec) == (100, 250_000_000)
    edit_records(small_set, timestamp=lambda place: 5.0)  # All at once: their order is the set's.
    with pytest.warns(UserWarning, match="time stamps are missing or equal; none is used"):
        taken = in_time_order(capture.open_set(small_set).scenes)
    assert [frame.time_s for frame in taken] == pytest.approx([n / 30 for n in range(len(taken))])


def test_missing_package_message_names_the_extra(
    small_set: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(__import__("sys").modules, "rosbags", None)
    ros_types.typestore.cache_clear()
    with pytest.raises(InputError, match=r"bag needs rosbags; got none\. .*'\.\[ros\]'"):
        ros2_bag.export(capture.open_set(small_set).scenes, tmp_path / "bag")


@pytest.mark.parametrize("character", "?#%")
def test_paths_that_the_database_would_change_are_refused(
    small_set: Path, tmp_path: Path, character: str
):
    scenes = capture.open_set(small_set).scenes
    with pytest.raises(InputError, match=r"out must hold none of # % \? for a bag"):
        ros2_bag.export(scenes, tmp_path / f"a{character}b" / "bag")
    assert list(tmp_path.iterdir()) == [small_set]


def test_full_disk_is_refused(small_set: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    import apsw

    def full(*_: object) -> None:
        raise apsw.FullError("database or disk is full")

    monkeypatch.setattr(rosbag2.Writer, "write", full)
    with pytest.raises(InputError, match=r"out must be writable; got .*database or disk is full"):
        ros2_bag.export(capture.open_set(small_set).scenes, tmp_path / "bag")


# Source: realsense-ros 4.x, README (topics), `ros_utils` (frames). Its node publishes more, such
# as `imu`, of which a capture set has nothing.
DRIVER_TOPICS = {
    "infra1/image_rect_raw": "sensor_msgs/msg/Image",
    "infra1/camera_info": "sensor_msgs/msg/CameraInfo",
    "infra1/metadata": "realsense2_camera_msgs/msg/Metadata",
    "infra2/image_rect_raw": "sensor_msgs/msg/Image",
    "infra2/camera_info": "sensor_msgs/msg/CameraInfo",
    "depth/image_rect_raw": "sensor_msgs/msg/Image",
    "depth/camera_info": "sensor_msgs/msg/CameraInfo",
    "depth/metadata": "realsense2_camera_msgs/msg/Metadata",
    "color/image_raw": "sensor_msgs/msg/Image",
    "color/camera_info": "sensor_msgs/msg/CameraInfo",
    "aligned_depth_to_color/image_raw": "sensor_msgs/msg/Image",
    "aligned_depth_to_color/camera_info": "sensor_msgs/msg/CameraInfo",
    "extrinsics/depth_to_infra1": "realsense2_camera_msgs/msg/Extrinsics",
    "extrinsics/depth_to_infra2": "realsense2_camera_msgs/msg/Extrinsics",
    "extrinsics/depth_to_color": "realsense2_camera_msgs/msg/Extrinsics",
}
DRIVER_FRAMES = {
    f"camera_{name}_{kind}"
    for name in ("depth", "infra1", "infra2", "color")
    for kind in ("frame", "optical_frame")
}


def add_colour(folder: Path) -> np.ndarray:
    """Add colour images, depth in their view, and the colour camera; return its pose."""
    pose = frames.pose((0.015, 1e-3, 2e-3), (1.0, -2.0, 0.5))
    with (folder / "capture.toml").open("a") as file:
        file.write(f"colour_from_left = {np.linalg.inv(pose).tolist()}\n")
        file.write("[colour]\nwidth = 8\nheight = 6\nfx_px = 9.0\nfy_px = 9.5\n")
        file.write("cx_px = 3.5\ncy_px = 2.5\n")
    for scene in capture.open_set(folder).scenes:
        for number in scene.frames:
            rgb = np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)
            (scene.path / str(number) / "rgb.png").write_bytes(png.encode_colour(rgb))
            code = np.full((6, 8), 700, np.uint16)
            (scene.path / str(number) / "depth_colour.png").write_bytes(png.encode(code))
    return np.linalg.inv(pose)


def test_topics_types_and_frames_are_those_of_the_driver(small_set: Path, tmp_path: Path):
    colour_from_left = add_colour(small_set)
    ros2_bag.export(capture.open_set(small_set).scenes, tmp_path / "bag")
    with rosbag2.Reader(tmp_path / "bag") as reader:
        topics = {connection.topic: connection.msgtype for connection in reader.connections}
    expected = {f"{CAMERA}/{topic}": kind for topic, kind in DRIVER_TOPICS.items()}
    assert expected.items() <= topics.items()
    assert topics.keys() - expected.keys() <= {"/tf", "/tf_static"}
    result = played(tmp_path / "bag")
    fixed = {frame.child_frame_id: frame for frame in result["/tf_static"][0].transforms}
    assert fixed.keys() == DRIVER_FRAMES
    optical = {
        name: pose(fixed[f"camera_{name}_frame"]) @ pose(fixed[f"camera_{name}_optical_frame"])
        for name in ("color", "depth")
    }
    chain = np.linalg.inv(optical["color"]) @ optical["depth"]
    np.testing.assert_allclose(chain, colour_from_left, atol=1e-9)
    message = result[f"{CAMERA}/extrinsics/depth_to_color"][0]
    np.testing.assert_allclose(message.rotation.reshape(3, 3).T, colour_from_left[:3, :3])
    np.testing.assert_allclose(message.translation, colour_from_left[:3, 3])
    colour = result[f"{CAMERA}/color/image_raw"][0]
    assert (colour.encoding, colour.step, colour.header.frame_id) == (
        *("rgb8", 24),
        "camera_color_optical_frame",
    )
    np.testing.assert_array_equal(colour.data, np.arange(144))
    aligned = result[f"{CAMERA}/aligned_depth_to_color/image_raw"][0]
    assert (image(aligned) == 700).all() and aligned.header.frame_id == colour.header.frame_id
    assert result[f"{CAMERA}/color/camera_info"][0].k[0] == 9.0
    facts = json.loads(result[f"{CAMERA}/infra1/metadata"][0].json_data)
    assert facts["depth_units"] == capture.open_set(small_set).info.depth_unit_m


def test_bags_of_mcap_are_read_by_the_ecosystem(small_set: Path, tmp_path: Path):
    ros2_bag.export(capture.open_set(small_set).scenes, tmp_path / "a", storage="mcap")
    ros2_bag.export(capture.open_set(small_set).scenes, tmp_path / "b")
    assert list((tmp_path / "a").glob("*.mcap"))
    first, second = played(tmp_path / "a"), played(tmp_path / "b")
    assert {topic: len(rows) for topic, rows in first.items()} == {
        topic: len(rows) for topic, rows in second.items()
    }
