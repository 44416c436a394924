"""Export to a ROS 2 bag with the topics of a RealSense node.

    /camera/camera/infra1/image_rect_raw, infra2/image_rect_raw     mono8 or mono16
    /camera/camera/depth/image_rect_raw     16UC1 [mm], 0 = none
    .../camera_info for each image topic; /tf (world -> camera_link), /tf_static

Both infrared images are in the left imager's frame. P of the right image holds the baseline
(P[0, 3] = -fx b). Stereo programs expect this, and realsense-ros does it since pull request 1242.
The frame `world` has the axes of the capture set's world.

Source: sensor_msgs/CameraInfo. REP 103: body axes x forward, y left, z up; optical axes z forward,
x right, y down. realsense2_camera: README (topics), `ros_utils` (frames).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import needs, refuse
from starling.sim.captures.capture import CapturedScene
from starling.sim.captures.exchange.stream import in_time_order, pose_of_left
from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose

if TYPE_CHECKING:
    from rosbags.rosbag2 import Writer

_CAMERA = "/camera/camera"
_WORLD, _LINK = "world", "camera_link"
_FIRST_S = 1.0  # First time stamp [s]; 0 has the special meaning "latest" in tf2.
_MM = 1e-3
_UNSAFE = frozenset("%?#")  # SQLite reads them in the name of a database.
_VERSION = 8  # Version of the bag format; from 9 on (Jazzy), QoS is stored in another form.
# Axes of the optical frame (x right, y down, z forward) in the body frame.
_BODY_FROM_OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
_STREAMS = {"ir_left": "infra1", "ir_right": "infra2"}

Publish = Callable[[str, str, Any, float], None]  # Topic, type, message, time [s].


def export(scenes: Sequence[CapturedScene], path: Path) -> int:
    """Write scenes in order of time.

    Args:
        scenes: the poses are those in `frame.json`, or else `scene.toml`.
        path: folder of the bag; must not exist.

    Returns:
        Number of written frames.

    Raises:
        InputError: if cameras differ, a frame has no depth, `rosbags` is not installed, or the
            disk is full.
    """
    rosbag2, typesys = _rosbags()
    if _UNSAFE & set(str(path)):
        rule = f"must hold none of {' '.join(sorted(_UNSAFE))} for a bag"
        raise refuse("out", rule, path, "Choose another folder; the database reads them.")
    types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    info, ordered = scenes[0].info, in_time_order(scenes)
    first_s = ordered[0].time_s
    shift_s = 0.0 if first_s > 0 else _FIRST_S - first_s
    with _refused(path), rosbag2.Writer(path, version=_VERSION) as bag:
        publish = _publisher(bag, types)
        messages = Messages(types.types)
        static = messages.transforms(_fixed(info), shift_s + first_s)
        publish("/tf_static", "tf2_msgs/msg/TFMessage", static, shift_s + first_s)
        for timed in ordered:
            frame, code = timed.read(_MM)
            time_s = shift_s + timed.time_s
            world_from_left = pose_of_left(timed.scene, frame.record)
            if world_from_left is not None:
                link = world_from_left @ np.linalg.inv(_BODY_FROM_OPTICAL)
                moved = messages.transforms([(_WORLD, _LINK, link)], time_s)
                publish("/tf", "tf2_msgs/msg/TFMessage", moved, time_s)
            images: dict[str, NDArray[Any]] = {"depth": code}
            for name, stream in _STREAMS.items():
                image = getattr(frame, name)
                if image is not None:
                    images[stream] = image
            for stream, image in images.items():
                topic = f"{_CAMERA}/{stream}"
                picture = messages.image(stream, image, time_s)
                publish(f"{topic}/image_rect_raw", "sensor_msgs/msg/Image", picture, time_s)
                message = messages.camera_info(stream, info, time_s)
                publish(f"{topic}/camera_info", "sensor_msgs/msg/CameraInfo", message, time_s)
    return len(ordered)


def _rosbags() -> tuple[Any, Any]:
    """Import the modules that write bags and define ROS types."""
    try:
        from rosbags import rosbag2, typesys
    except ImportError as error:
        raise needs("bag", "rosbags", "ros") from error
    return rosbag2, typesys


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
            qos = [latched] if topic == "/tf_static" else []
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
    transforms = []
    for name, pose in places.items():
        transforms.append((_LINK, f"camera_{name}_frame", pose))
        optical = f"camera_{name}_optical_frame"
        transforms.append((f"camera_{name}_frame", optical, _BODY_FROM_OPTICAL))
    return transforms


class Messages:
    """Builds ROS messages from captures."""

    def __init__(self, types: dict[str, Any]) -> None:
        """Store the message classes by type name, as `rosbags` provides them."""
        self._types = types

    def image(self, stream: str, image: NDArray[Any], time_s: float) -> Any:
        """Return an image message with one channel."""
        height, width = image.shape
        little = np.ascontiguousarray(image, image.dtype.newbyteorder("<"))
        return self._types["sensor_msgs/msg/Image"](
            header=self._header(stream, time_s),
            height=height,
            width=width,
            encoding="16UC1" if stream == "depth" else f"mono{8 * image.itemsize}",
            is_bigendian=0,
            step=width * image.itemsize,
            data=little.view(np.uint8).ravel(),
        )

    def camera_info(self, stream: str, info: CaptureInfo, time_s: float) -> Any:
        """Return the intrinsics of rectified images, without distortion."""
        shift = -info.fx_px * info.baseline_m if stream == "infra2" else 0.0
        k = [info.fx_px, 0, info.cx_px, 0, info.fy_px, info.cy_px, 0, 0, 1]
        p = [info.fx_px, 0, info.cx_px, shift, 0, info.fy_px, info.cy_px, 0, 0, 0, 1, 0]
        roi = self._types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self._types["sensor_msgs/msg/CameraInfo"](
            header=self._header(stream, time_s),
            height=info.height,
            width=info.width,
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=np.array(k, float),
            r=np.eye(3).ravel(),
            p=np.array(p, float),
            binning_x=0,
            binning_y=0,
            roi=roi,
        )

    def transforms(self, poses: Sequence[tuple[str, str, Pose]], time_s: float) -> Any:
        """Return the transforms of (parent, child, `parent_from_child`)."""
        kind = self._types
        transforms = []
        for parent, child, pose in poses:
            x, y, z, w = frames.to_quaternion(pose)
            place = [float(component) for component in pose[:3, 3]]
            transform = kind["geometry_msgs/msg/Transform"](
                translation=kind["geometry_msgs/msg/Vector3"](*place),
                rotation=kind["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w),
            )
            header = kind["std_msgs/msg/Header"](stamp=_stamp(kind, time_s), frame_id=parent)
            transforms.append(
                kind["geometry_msgs/msg/TransformStamped"](
                    header=header, child_frame_id=child, transform=transform
                )
            )
        return kind["tf2_msgs/msg/TFMessage"](transforms=transforms)

    def _header(self, stream: str, time_s: float) -> Any:
        frame = "depth" if stream == "depth" else "infra1"
        return self._types["std_msgs/msg/Header"](
            stamp=_stamp(self._types, time_s), frame_id=f"camera_{frame}_optical_frame"
        )


def _stamp(types: dict[str, Any], time_s: float) -> Any:
    seconds, rest = divmod(round(time_s * 1e9), 10**9)
    return types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
