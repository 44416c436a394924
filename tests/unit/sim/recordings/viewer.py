"""Writes bags as the RealSense Viewer does (librealsense, `ros_writer.cpp`)."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, typesys

from tests.unit.sim.recordings import scene

SENSOR = "/device_0/sensor_0"
TYPES = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
IMAGE = "sensor_msgs/msg/Image"


def text(value: str) -> bytes:
    """Return a text as ROS 1 serialises it."""
    return struct.pack("<I", len(value.encode())) + value.encode()


def image(pixels: np.ndarray, encoding: str, time_s: float, unit_m: float | None) -> bytes:
    """Return an image with librealsense's header, of version 1 if the depth unit follows."""
    height, width = pixels.shape[:2]
    head = struct.pack("<III", 7, int(time_s), round((time_s % 1) * 1e9))
    head += text("" if unit_m is None else "1") + struct.pack("<II", height, width)
    data = pixels.tobytes()
    body = text(encoding) + struct.pack("<BII", 0, len(data) // height, len(data)) + data
    return head + body + (b"" if unit_m is None else struct.pack("<f", unit_m))


@dataclass
class ViewerBag:
    """What a bag holds; None leaves a part out."""

    times_s: tuple[float, ...] = (100.0, 100.0333, 100.0667)
    unit_m: float | None = 1e-3  # In the images.
    unit_option_m: float | None = None
    baseline_m: float | None = scene.BASELINE_M  # By the streams' poses.
    baseline_option_mm: float | None = None
    emitter_option: float | None = 1
    laser_modes: tuple[int, ...] | None = None  # Of each frame.
    exposure_us: int | None = 8500
    streams: tuple[str, ...] = ("Infrared_1", "Infrared_2", "Depth_0")
    with_info: bool = True
    name: str | None = "Intel RealSense D435I"
    dots: tuple[float, ...] = ()  # Density of each frame's dots.
    moves: bool = False
    right_shape: tuple[int, int] | None = None
    compression: Any = None
    depth_unit_of_codes_m: float = 1e-3
    times_of: dict[str, tuple[float, ...]] = field(default_factory=dict)

    def write(self, path: Path) -> Path:
        """Write the bag."""
        path.unlink(missing_ok=True)
        bag = rosbag1.Writer(path)
        if self.compression is not None:
            bag.set_compression(self.compression)
        with bag:
            publish = _publisher(bag)
            publish("/file_version", "std_msgs/msg/UInt32", struct.pack("<I", 4), 1)
            if self.name:
                data = text("Name") + text(self.name)
                publish("/device_0/info", "diagnostic_msgs/msg/KeyValue", data, 1)
            options = {
                "Depth_Units": self.unit_option_m,
                "Stereo_Baseline": self.baseline_option_mm,
                "Emitter_Enabled": self.emitter_option,
                "Laser_Power": 150.0,
            }
            for option, value in options.items():
                if value is not None:
                    data = struct.pack("<f", value)
                    publish(f"{SENSOR}/option/{option}/value", "std_msgs/msg/Float32", data, 1)
            for stream in self.streams:
                self._describe(publish, stream)
            for number, time_s in enumerate(self.times_s):
                for stream in self.streams:
                    self._frame(publish, stream, number, time_s)
        return path

    def _describe(self, publish: Any, stream: str) -> None:
        if self.with_info:
            info = camera_info()
            publish(f"{SENSOR}/{stream}/info/camera_info", "sensor_msgs/msg/CameraInfo", info, 1)
        if self.baseline_m is not None:
            shift = -self.baseline_m if stream == "Infrared_2" else 0.0
            if stream == "Color_0":
                shift = 0.015
            pose = struct.pack("<7d", shift, 0, 0, 0, 0, 0, 1)
            publish(f"{SENSOR}/{stream}/tf/0", "geometry_msgs/msg/Transform", pose, 1)

    def _frame(self, publish: Any, stream: str, number: int, time_s: float) -> None:
        times = self.times_of.get(stream, self.times_s)
        if number >= len(times):
            return
        time_s, recorded_ns = times[number], 10**9 + 33_333_333 * number
        dots = self.dots[number] if self.dots else 0.008
        left, right = scene.pair(number, dots=dots, pattern=number * self.moves)
        if self.right_shape:
            right = scene.dotted(height=self.right_shape[0], width=self.right_shape[1])
        unit = self.unit_m
        pixels, encoding = {
            "Infrared_1": (left, "8UC1"),
            "Infrared_2": (right, "8UC1"),
            "Depth_0": (scene.depth_code(self.depth_unit_of_codes_m), "mono16"),
            "Color_0": (np.dstack([left, left // 2, left]), "rgb8"),
        }[stream]
        data = image(pixels, encoding, time_s, unit if stream == "Depth_0" else None)
        publish(f"{SENSOR}/{stream}/image/data", IMAGE, data, recorded_ns)
        rows = {"Frame Counter": number}
        if self.exposure_us is not None:
            rows |= {"Actual Exposure": self.exposure_us, "Gain Level": 16}
        if self.laser_modes is not None:
            rows["Frame Laser Power Mode"] = self.laser_modes[number]
        for key, value in rows.items():
            row = text(key) + text(str(value))
            topic = f"{SENSOR}/{stream}/image/metadata"
            publish(topic, "diagnostic_msgs/msg/KeyValue", row, recorded_ns)


def camera_info() -> bytes:
    """Return the intrinsics: K and D, as librealsense fills them."""
    kind = TYPES.types["sensor_msgs/msg/CameraInfo"]
    header = TYPES.types["std_msgs/msg/Header"](
        seq=0, stamp=TYPES.types["builtin_interfaces/msg/Time"](0, 0), frame_id=""
    )
    roi = TYPES.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    info = kind(
        header=header,
        height=scene.HEIGHT,
        width=scene.WIDTH,
        distortion_model="Brown Conrady",
        D=np.zeros(5),
        K=np.array(scene.K).ravel(),
        R=np.zeros(9),
        P=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )
    return bytes(TYPES.serialize_ros1(info, "sensor_msgs/msg/CameraInfo"))


def _publisher(bag: Any) -> Any:
    topics: dict[str, Any] = {}

    def publish(topic: str, kind: str, data: bytes, time_ns: int) -> None:
        if topic not in topics:
            topics[topic] = bag.add_connection(topic, kind, typestore=TYPES)
        bag.write(topics[topic], time_ns, data)

    return publish
