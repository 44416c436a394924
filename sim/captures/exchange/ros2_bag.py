"""A ROS 2 bag as a RealSense node would have recorded it.

    /camera/camera/infra1/image_rect_raw, infra2/image_rect_raw     mono8 or mono16
    /camera/camera/depth/image_rect_raw     16UC1 [mm], 0 = none
    .../camera_info beside each; /tf (world -> camera_link), /tf_static

Both infrared images are in the frame of the left one, and P of the right one tells the baseline
(P[0, 3] = -fx b), as stereo programs expect and realsense-ros does since its pull request 1242.
The frame `world` has the axes of the set's own world.

Source: sensor_msgs/CameraInfo and REP 103 (body axes x forward, y left, z up; optical z forward,
x right, y down); realsense2_camera's README (topics), its `ros_utils` (frames).
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
from starling.sim.captures.exchange import sequence
from starling.sim.captures.exchange.ros2_messages import Messages
from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry.frames import Pose
from starling.sim.stereo.depth import to_code

if TYPE_CHECKING:
    from rosbags.rosbag2 import Writer

_CAMERA = "/camera/camera"
_WORLD, _LINK = "world", "camera_link"
_FIRST_S = 1.0  # A stamp of 0 asks tf2 for what is newest.
_MM = 1e-3
_VERSION = 8  # Of bags: from 9 on (Jazzy) qualities of service are told in another form.
# x right, y down, z forward, in x forward, y left, z up.
_BODY_FROM_OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
_STREAMS = {"ir_left": "infra1", "ir_right": "infra2"}

Publish = Callable[[str, str, Any, float], None]  # Topic, type, message, time [s].


def export(scenes: Sequence[CapturedScene], path: Path) -> int:
    """Write scenes that follow each other in time.

    Args:
        scenes: each frame's pose is that of its `frame.json`, where it has one.
        path: folder that the bag becomes; must not exist.

    Returns:
        How many frames were written.

    Raises:
        InputError: if cameras differ, a frame has no depth, `rosbags` is not installed, or the
            disk is full.
    """
    rosbag2, typesys = _rosbags()
    types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    info, taken = scenes[0].info, sequence.of(scenes)
    first_s = taken[0].time_s
    shift_s = 0.0 if first_s > 0 else _FIRST_S - first_s
    with _refused(path), rosbag2.Writer(path, version=_VERSION) as bag:
        publish = _publisher(bag, types)
        messages = Messages(types.types)
        static = messages.transforms(_fixed(info), shift_s + first_s)
        publish("/tf_static", "tf2_msgs/msg/TFMessage", static, shift_s + first_s)
        for one in taken:
            frame, depth_m = one.read()
            time_s = shift_s + one.time_s
            world_from_left = sequence.world_from_left(frame)
            if world_from_left is not None:
                link = world_from_left @ np.linalg.inv(_BODY_FROM_OPTICAL)
                moved = messages.transforms([(_WORLD, _LINK, link)], time_s)
                publish("/tf", "tf2_msgs/msg/TFMessage", moved, time_s)
            images: dict[str, NDArray[Any]] = {"depth": to_code(depth_m, _MM)}
            for name, stream in _STREAMS.items():
                image = getattr(frame, name)
                if image is not None:
                    images[stream] = image
            for stream, image in images.items():
                topic = f"{_CAMERA}/{stream}"
                seen = messages.image(stream, image, time_s)
                publish(f"{topic}/image_rect_raw", "sensor_msgs/msg/Image", seen, time_s)
                told = messages.camera_info(stream, info, time_s)
                publish(f"{topic}/camera_info", "sensor_msgs/msg/CameraInfo", told, time_s)
    return len(taken)


def _rosbags() -> tuple[Any, Any]:
    """The modules that write bags and know ROS's types."""
    try:
        from rosbags import rosbag2, typesys
    except ImportError as error:
        raise needs("bag", "rosbags", "ros") from error
    return rosbag2, typesys


@contextmanager
def _refused(path: Path) -> Iterator[None]:
    """Turn what the bag's data base says while writing into a refusal."""
    import apsw

    try:
        yield
    except apsw.Error as error:
        raise refuse("out", "must be writable", f"{path}, {error}", "Free some space.") from error


def _publisher(bag: Writer, types: Any) -> Publish:
    """What writes a message; a topic is opened at its first."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    latched = Qos(  # What late listeners of /tf_static rely on.
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
    """Frames of the camera: the link stands in the left imager, as depth does."""
    right = np.eye(4)
    right[1, 3] = -info.baseline_m  # y points left.
    places = {"depth": np.eye(4), "infra1": np.eye(4), "infra2": right}
    found = []
    for name, pose in places.items():
        found.append((_LINK, f"camera_{name}_frame", pose))
        optical = f"camera_{name}_optical_frame"
        found.append((f"camera_{name}_frame", optical, _BODY_FROM_OPTICAL))
    return found
