"""Export to a ROS 2 bag with the topics of realsense-ros 4.x.

    /camera/camera/infra1/image_rect_raw, infra2/image_rect_raw     mono8 or mono16
    /camera/camera/depth/image_rect_raw     16UC1 [mm], 0 = none; 32FC1 [m] of finer depth
    /camera/camera/color/image_raw, aligned_depth_to_color/image_raw
    .../camera_info for each image topic; infra1/metadata, depth/metadata
    /camera/camera/extrinsics/depth_to_infra1, depth_to_infra2, depth_to_color
    /tf (world -> camera_link), /tf_static

Both infrared images are in the left imager's frame. P of the right image holds the baseline
(P[0, 3] = -fx b). Stereo programs expect this, and realsense-ros does it since pull request 1242.
The frame `world` has the axes of the capture set's world. Images with the projector off follow
half a period after the lit ones, with `frame_laser_power_mode` 0.

Source: sensor_msgs/CameraInfo. REP 103: body axes x forward, y left, z up; optical axes z forward,
x right, y down. REP 118: depth images. realsense2_camera 4.x: README (topics), `ros_utils`
(frames), `base_realsense_node` (metadata, extrinsics).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim.arrays import Image
from starling.sim.captures.capture import CapturedScene, Frame
from starling.sim.captures.exchange.ros2_messages import Messages
from starling.sim.captures.exchange.ros_types import EXTRINSICS, METADATA, typestore
from starling.sim.captures.exchange.stream import TimedFrame, in_time_order, pose_of_left
from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.stereo.depth import to_code

if TYPE_CHECKING:
    from rosbags.rosbag2 import Writer

_CAMERA = "/camera/camera"
_WORLD, _LINK = "world", "camera_link"
_FIRST_S = 1.0  # First time stamp [s]; 0 has the special meaning "latest" in tf2.
_MM = 1e-3
_UNSAFE = frozenset("%?#")  # SQLite reads them in the name of a database.
_VERSION = 8  # Version of the bag format; from 9 on (Jazzy), QoS is stored in another form.
_PERIOD_S = 1 / 30  # Least period that is assumed of frames [s].
# Axes of the optical frame (x right, y down, z forward) in the body frame.
_BODY_FROM_OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
_STREAMS = {"ir_left": "infra1", "ir_right": "infra2"}
_FACTS = {"gain": "gain_level", "laser_power": "frame_laser_power"}
_IMAGE, _INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
_TRANSFORMS = "tf2_msgs/msg/TFMessage"

Publish = Callable[[str, str, Any, float], None]  # Topic, type, message, time [s].
Storage = Literal["sqlite3", "mcap"]


def export(scenes: Sequence[CapturedScene], path: Path, *, storage: Storage = "sqlite3") -> int:
    """Write scenes in order of time.

    Args:
        scenes: the poses are those in `frame.json`, or else `scene.toml`.
        path: folder of the bag; must not exist.
        storage: kind of file in the bag.

    Returns:
        Number of written frames.

    Raises:
        InputError: if cameras differ, a frame has no depth, `rosbags` is not installed, or the
            disk is full.
    """
    types = typestore(is_ros1=False)
    from rosbags import rosbag2

    if _UNSAFE & set(str(path)):
        rule = f"must hold none of {' '.join(sorted(_UNSAFE))} for a bag"
        raise refuse("out", rule, path, "Choose another folder; the database reads them.")
    info, ordered = scenes[0].info, in_time_order(scenes)
    first_s = ordered[0].time_s
    shift_s = 0.0 if first_s > 0 else _FIRST_S - first_s
    plugin = rosbag2.StoragePlugin[storage.upper()]
    with _refused(path), rosbag2.Writer(path, version=_VERSION, storage_plugin=plugin) as bag:
        publish = _publisher(bag, types)
        messages = Messages(types.types)
        _publish_places(publish, messages, info, shift_s + first_s)
        half_s = _half_period_s([timed.time_s for timed in ordered])
        for timed in ordered:
            _publish_frame(publish, messages, timed, shift_s, half_s)
    return len(ordered)


def _half_period_s(times_s: Sequence[float]) -> float:
    """Return half of the shortest time between frames [s]."""
    steps = [after - before for before, after in itertools.pairwise(times_s)]
    return min([_PERIOD_S, *steps]) / 2


def _publish_places(publish: Publish, messages: Messages, info: CaptureInfo, time_s: float) -> None:
    """Publish the static frames, and the extrinsics from the depth image."""
    publish("/tf_static", _TRANSFORMS, messages.transforms(_fixed(info), time_s), time_s)
    right_from_depth = np.eye(4)
    right_from_depth[0, 3] = -info.baseline_m
    places = {"infra1": np.eye(4), "infra2": right_from_depth}
    if info.colour_from_left is not None:
        places["color"] = np.array(info.colour_from_left)
    for stream, pose in places.items():
        topic = f"{_CAMERA}/extrinsics/depth_to_{stream}"
        publish(topic, EXTRINSICS, messages.extrinsics(pose, time_s), time_s)


def _publish_frame(
    publish: Publish, messages: Messages, timed: TimedFrame, shift_s: float, half_s: float
) -> None:
    frame, depth = _read(timed)
    time_s, scene, info = shift_s + timed.time_s, timed.scene, timed.scene.info
    world_from_left = pose_of_left(scene, frame.record)
    if world_from_left is not None:
        link = world_from_left @ np.linalg.inv(_BODY_FROM_OPTICAL)
        moved = messages.transforms([(_WORLD, _LINK, link)], time_s)
        publish("/tf", _TRANSFORMS, moved, time_s)
    images: dict[str, NDArray[Any]] = {"depth": depth}
    images |= _pair(frame, "")
    facts = _metadata(frame, info, is_lit=info.projector != "off")
    colour = scene.colour(frame.number)
    if colour is not None:
        images["color"] = colour
    aligned = scene.depth_in_colour_m(frame.number)
    if aligned is not None:
        images["aligned_depth_to_color"] = _as_published(aligned, info.depth_unit_m)
    _publish_images(publish, messages, info, images, facts, time_s)
    unlit = _pair(frame, "_off")
    if unlit:
        facts = _metadata(frame, info, is_lit=False)
        _publish_images(publish, messages, info, unlit, facts, time_s + half_s)


def _read(timed: TimedFrame) -> tuple[Frame, NDArray[Any]]:
    """Return a frame and its depth as it is published."""
    frame, code = timed.read(_MM)
    if frame.depth_m is None or timed.scene.info.depth_unit_m == _MM:
        return frame, code
    return frame, _as_published(frame.depth_m, timed.scene.info.depth_unit_m)


def _as_published(depth_m: Image, unit_m: float) -> NDArray[Any]:
    """Return depth as codes of a millimetre, or [m] where its steps are others."""
    return to_code(depth_m, _MM) if unit_m == _MM else depth_m.astype(np.float32)


def _pair(frame: Frame, suffix: str) -> dict[str, NDArray[Any]]:
    """Return the infrared images of a frame by stream."""
    images = {stream: getattr(frame, name + suffix) for name, stream in _STREAMS.items()}
    return {stream: image for stream, image in images.items() if image is not None}


def _metadata(frame: Frame, info: CaptureInfo, *, is_lit: bool) -> dict[str, Any]:
    """Return the known facts under the names of realsense-ros, exposure in microseconds.

    `depth_units`, `device` and `black_level_dn` are additions, so that an import has them.
    """
    facts: dict[str, Any] = {"frame_number": frame.number, "depth_units": info.depth_unit_m}
    facts |= {"device": info.sensor}
    if info.black_level_dn is not None:
        facts["black_level_dn"] = info.black_level_dn
    if info.projector is not None:
        facts["frame_laser_power_mode"] = int(is_lit)
    if "exposure_s" in frame.record:
        facts["actual_exposure"] = float(f"{frame.record['exposure_s'] * 1e6:.12g}")
    return facts | {name: frame.record[key] for key, name in _FACTS.items() if key in frame.record}


def _publish_images(
    publish: Publish,
    messages: Messages,
    info: CaptureInfo,
    images: dict[str, NDArray[Any]],
    facts: dict[str, Any],
    time_s: float,
) -> None:
    for stream, image in images.items():
        topic, name = f"{_CAMERA}/{stream}", "image_rect_raw"
        camera: Pinhole | None = Pinhole.from_camera(info)
        if "color" in stream:
            name, camera = "image_raw", info.colour
        publish(f"{topic}/{name}", _IMAGE, messages.image(stream, image, time_s), time_s)
        if camera is not None:
            baseline_m = info.baseline_m if stream == "infra2" else 0.0
            message = messages.camera_info(stream, camera, time_s, baseline_m=baseline_m)
            publish(f"{topic}/camera_info", _INFO, message, time_s)
        if stream in ("infra1", "depth"):
            message = messages.metadata(stream, facts, time_s)
            publish(f"{topic}/metadata", METADATA, message, time_s)


@contextmanager
def _refused(path: Path) -> Iterator[None]:
    """Turn write errors of the bag's database into `InputError`."""
    import apsw

    try:
        yield
    except apsw.Error as error:
        raise refuse("out", "must be writable", f"{path}, {error}", "Free some space.") from error


def _publisher(bag: Writer, types: Any) -> Publish:
    """Return a function that writes a message; a topic is created with its first message."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    latched = Qos(  # Late subscribers of /tf_static rely on it.
        history=QosHistory.KEEP_LAST,
        depth=1,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL,
        deadline=QosTime(0, 0),
        lifespan=QosTime(0, 0),
        liveliness=QosLiveliness.SYSTEM_DEFAULT,
        liveliness_lease_duration=QosTime(0, 0),
        avoid_ros_namespace_conventions=False,
    )
    topics: dict[str, Any] = {}

    def publish(topic: str, kind: str, message: Any, time_s: float) -> None:
        if topic not in topics:
            is_fixed = topic == "/tf_static" or "/extrinsics/" in topic
            qos = [latched] if is_fixed else []
            topics[topic] = bag.add_connection(
                topic, kind, typestore=types, offered_qos_profiles=qos
            )
        bag.write(topics[topic], round(time_s * 1e9), types.serialize_cdr(message, kind))

    return publish


def _fixed(info: CaptureInfo) -> list[tuple[str, str, Pose]]:
    """Return the static frames of the camera; the link and depth are at the left imager."""
    right = np.eye(4)
    right[1, 3] = -info.baseline_m  # y points left.
    places = {"depth": np.eye(4), "infra1": np.eye(4), "infra2": right}
    if info.colour_from_left is not None:
        left_from_colour = np.linalg.inv(np.array(info.colour_from_left))
        places["color"] = _BODY_FROM_OPTICAL @ left_from_colour @ _BODY_FROM_OPTICAL.T
    transforms = []
    for name, pose in places.items():
        transforms.append((_LINK, f"camera_{name}_frame", pose))
        optical = f"camera_{name}_optical_frame"
        transforms.append((f"camera_{name}_frame", optical, _BODY_FROM_OPTICAL))
    return transforms
