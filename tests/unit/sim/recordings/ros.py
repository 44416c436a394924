"""Writes recordings of ROS topics: ROS 1 bags, ROS 2 databases, MCAP."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2

from starling.sim.captures.exchange import ros_types
from tests.unit.sim.recordings import scene

IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
COMPRESSED = "sensor_msgs/msg/CompressedImage"


class Topics:
    """Messages by topic, at 30 Hz."""

    def __init__(self, *, is_ros1: bool = False, distortion: tuple[float, ...] = (0,) * 5) -> None:
        self.is_ros1, self.distortion = is_ros1, distortion
        self.store = ros_types.typestore(is_ros1=is_ros1)
        self.rows: list[tuple[str, str, float, Any]] = []
        self.model = "plumb_bob"
        self.baseline_m = scene.BASELINE_M

    def header(self, time_s: float, frame: str = "camera_infra1_optical_frame") -> Any:
        stamp = self.store.types["builtin_interfaces/msg/Time"](
            int(time_s), round(time_s % 1 * 1e9)
        )
        more = {"seq": 0} if self.is_ros1 else {}
        return self.store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **more)

    def image(
        self, topic: str, time_s: float, pixels: np.ndarray, encoding: str, *, pad: int = 0
    ) -> None:
        """Add an image; `pad` bytes follow each row."""
        rows = pixels.reshape(len(pixels), -1)
        data = np.pad(rows.view(np.uint8), ((0, 0), (0, pad)))
        message = self.store.types[IMAGE](
            header=self.header(time_s),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=int(pixels.dtype.byteorder == ">"),
            step=data.shape[1],
            data=data.ravel(),
        )
        self.rows.append((topic, IMAGE, time_s, message))

    def compressed(self, topic: str, time_s: float, data: bytes, form: str) -> None:
        """Add a compressed image."""
        message = self.store.types[COMPRESSED](
            header=self.header(time_s), format=form, data=np.frombuffer(data, np.uint8)
        )
        self.rows.append((topic, COMPRESSED, time_s, message))

    def info(self, topic: str, time_s: float, *, baseline_m: float = 0.0) -> None:
        """Add intrinsics."""
        p = np.array(scene.K)
        p = np.column_stack([p, [-scene.FX * baseline_m, 0, 0]]).ravel()
        roi = self.store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        letters = {"d": np.array(self.distortion, float), "k": np.array(scene.K).ravel()}
        letters |= {"r": np.eye(3).ravel(), "p": p}
        if self.is_ros1:
            letters = {name.upper(): value for name, value in letters.items()}
        message = self.store.types[INFO](
            header=self.header(time_s),
            height=scene.HEIGHT,
            width=scene.WIDTH,
            distortion_model=self.model,
            binning_x=0,
            binning_y=0,
            roi=roi,
            **letters,
        )
        self.rows.append((topic, INFO, time_s, message))

    def pair(
        self, left: str, right: str, *, count: int = 3, depth: str = "", rows_px: int = 0
    ) -> Topics:
        """Add images and intrinsics of a pair, and depth in millimetres."""
        for number in range(count):
            time_s = 100 + number / 30
            first, second = scene.pair(number, rows_px=rows_px)
            self.image(left, time_s, first, "mono8")
            self.image(right, time_s, second, "mono8")
            self.info(left.rsplit("/", 1)[0] + "/camera_info", time_s)
            info = right.rsplit("/", 1)[0] + "/camera_info"
            self.info(info, time_s, baseline_m=self.baseline_m)
            if depth:
                self.image(depth, time_s, scene.depth_code(), "16UC1")
        return self

    def write(self, path: Path, storage: str = "SQLITE3") -> Path:
        """Write a folder of ROS 2, or a ROS 1 bag."""
        if self.is_ros1:
            bag, serialize = rosbag1.Writer(path), self.store.serialize_ros1
        else:
            plugin = rosbag2.StoragePlugin[storage]
            bag = rosbag2.Writer(path, version=8, storage_plugin=plugin)
            serialize = self.store.serialize_cdr
        connections: dict[str, Any] = {}
        with bag:
            for topic, kind, time_s, message in self.rows:
                if topic not in connections:
                    connections[topic] = bag.add_connection(topic, kind, typestore=self.store)
                bag.write(connections[topic], round(time_s * 1e9), serialize(message, kind))
        return path
