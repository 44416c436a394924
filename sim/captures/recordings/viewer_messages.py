"""Messages of librealsense besides images: options, metadata, intrinsics, poses.

ROS 1 bags have types of their own for them. Databases of librealsense 2.59.1 hold texts
`KEY=VALUE;KEY=VALUE`.

Source: librealsense: `src/media/ros`, and recordings of pyrealsense2 2.56.5 and 2.59.1.
"""

from __future__ import annotations

import re
import struct
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from starling.sim.captures.recordings import messages
from starling.sim.captures.recordings.logs.message_log import (
    LoggedMessage,
    LostMessageError,
    MessageLog,
)
from starling.sim.captures.recordings.recording import ImagerCalibration
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose

_DATA = re.compile(r"/image/data(/compressed|/compressedDepth)?$")
_OPTIONS = {  # Topics of options, and the names of the metadata with the same content.
    "Exposure": "Actual Exposure",
    "Gain": "Gain Level",
    "Laser_Power": "Frame Laser Power",
    "Emitter_Enabled": "Frame Emitter Mode",
    "Depth_Units": "depth_units",
    "Stereo_Baseline": "Stereo Baseline",
}


@dataclass(frozen=True, slots=True, eq=False)
class ViewerMessages:
    """Messages of a viewer's recording by topic."""

    is_ros1: bool
    by_topic: dict[str, list[LoggedMessage]] = field(default_factory=dict)

    @classmethod
    def of_log(cls, log: MessageLog) -> ViewerMessages:
        """Sort the messages of a log."""
        by_topic: dict[str, list[LoggedMessage]] = defaultdict(list)
        for entry in log.entries:
            by_topic[entry.topic].append(entry)
        return cls(log.is_ros1, dict(by_topic))

    def table(self, topic: str) -> dict[str, str]:
        """Return keys and values of all messages of a topic."""
        rows = (self._table(entry) for entry in self.by_topic.get(topic, []))
        return {key: value for row in rows for key, value in row.items()}

    def metadata(self, data_topic: str) -> dict[int, dict[str, str]]:
        """Return keys and values of each frame by the time of its record [ns]."""
        result: dict[int, dict[str, str]] = defaultdict(dict)
        for entry in self.by_topic.get(_stream(data_topic) + "/image/metadata", []):
            result[entry.time_ns] |= self._table(entry)
        return result

    def options(self, data_topic: str) -> dict[str, str]:
        """Return the first values of a sensor's options, under the names of the metadata."""
        sensor, options = _stream(data_topic).rsplit("/", 1)[0], {}
        for option, name in _OPTIONS.items():
            for entry in self.by_topic.get(f"{sensor}/option/{option}/value", [])[:1]:
                value = self._number(entry)
                if value:
                    options[name] = value
        return options

    def lens(self, data_topic: str) -> ImagerCalibration | None:
        """Return the intrinsics of a stream."""
        stream = _stream(data_topic)
        if self.is_ros1:
            entries = self.by_topic.get(f"{stream}/info/camera_info", [])
            return next(filter(None, map(_ros1_lens, entries)), None)
        table = self.table(f"{stream}/camera_info")
        try:
            fx, fy, cx, cy = (float(table[key]) for key in ("fx", "fy", "ppx", "ppy"))
            return ImagerCalibration(
                width=int(table["width"]),
                height=int(table["height"]),
                matrix=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
                distortion=np.array(table["coeffs"].split(","), np.float64),
            )
        except (KeyError, ValueError):
            return None

    def pose(self, data_topic: str) -> tuple[str, Pose] | None:
        """Return the group of a stream, and the stream's pose from the group's first stream."""
        prefix = _stream(data_topic) + "/tf/"
        for topic, entries in self.by_topic.items():
            if topic.startswith(prefix):
                pose = _ros1_pose(entries[0]) if self.is_ros1 else _text_pose(self.table(topic))
                return None if pose is None else (topic.removeprefix(prefix), pose)
        return None

    def _table(self, entry: LoggedMessage) -> dict[str, str]:
        try:
            if self.is_ros1:
                return dict([messages.key_value(entry)])
            text = str(messages.parse(entry, is_ros1=False).data)
        except LostMessageError:
            return {}
        pairs = (part.split("=", 1) for part in text.split(";") if "=" in part)
        return {key.strip(): value.strip() for key, value in pairs}

    def _number(self, entry: LoggedMessage) -> str:
        """Return the value of an option; empty if it is damaged."""
        try:
            if self.is_ros1:
                return f"{struct.unpack('<f', entry.read())[0]:.7g}"
            return f"{float(messages.parse(entry, is_ros1=False).data):.7g}"
        except (LostMessageError, ValueError, struct.error):
            return ""


def _stream(data_topic: str) -> str:
    """Return the prefix of a stream's topics."""
    return _DATA.sub("", data_topic)


def _ros1_lens(entry: LoggedMessage) -> ImagerCalibration | None:
    try:
        info = messages.parse(entry, is_ros1=True)
    except LostMessageError:
        return None
    return ImagerCalibration(
        width=info.width,
        height=info.height,
        matrix=np.array(info.K, np.float64).reshape(3, 3),
        distortion=np.array(info.D, np.float64),
    )


def _ros1_pose(entry: LoggedMessage) -> Pose | None:
    try:
        x, y, z, *quaternion = struct.unpack("<7d", entry.read())
    except struct.error:
        return None
    return frames.from_quaternion(np.array([x, y, z]), np.array(quaternion))


def _text_pose(table: dict[str, str]) -> Pose | None:
    """Return a pose from its texts; the rotation is stored by columns."""
    pose = np.eye(4)
    try:
        pose[:3, :3] = np.array(table["rotation"].split(","), np.float64).reshape(3, 3).T
        pose[:3, 3] = np.array(table["translation"].split(","), np.float64)
    except (KeyError, ValueError):
        return None
    return pose
