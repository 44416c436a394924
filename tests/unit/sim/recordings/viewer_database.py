"""Writes databases as the RealSense Viewer does with librealsense 2.59.1."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags import rosbag2

from starling.sim.captures.exchange import ros_types
from tests.unit.sim.recordings import scene
from tests.unit.sim.recordings.viewer import SENSOR

TYPES = ros_types.typestore(is_ros1=False)
TEXT, COMPRESSED = "std_msgs/msg/String", "sensor_msgs/msg/CompressedImage"
INFO = (
    f"width={scene.WIDTH};height={scene.HEIGHT};fx={scene.FX};ppx={scene.CX};fy={scene.FX};"
    f"ppy={scene.CY};model=Brown Conrady;coeffs=0,0,0,0,0"
)
TURN = "rotation=1.0,0.0,0.0,0.0,1.0,0.0,0.0,0.0,1.0"


def write(path: Path, *, unit_m: float = 1e-3, info: str = INFO, pose: str = TURN) -> Path:
    """Write three frames; `path` is the database."""
    folder = path.with_suffix("")
    bag = rosbag2.Writer(folder, version=8)
    topics: dict[str, Any] = {}

    def publish(topic: str, kind: str, message: Any, time_ns: int) -> None:
        if topic not in topics:
            topics[topic] = bag.add_connection(topic, kind, typestore=TYPES)
        bag.write(topics[topic], time_ns, TYPES.serialize_cdr(message, kind))

    def say(topic: str, text: str, time_ns: int = 0) -> None:
        publish(topic, TEXT, TYPES.types[TEXT](data=text), time_ns)

    with bag:
        say("/device_0/info", "Name=Intel RealSense D405;Serial Number=1234")
        say(f"{SENSOR}/option/Emitter_Enabled/value", "1.000000")
        say(f"{SENSOR}/option/Stereo_Baseline/value", "none")
        for stream, shift in (("Depth_0", 0.0), ("Infrared_1", 0.0), ("Infrared_2", -0.05)):
            say(f"{SENSOR}/{stream}/camera_info", info)
            say(f"{SENSOR}/{stream}/tf/ref_1", f"{pose};translation={shift},0.0,0.0")
        for number in range(3):
            time_ns = 10**6 + 33_333_333 * number
            left, right = scene.pair(number)
            images = {"Infrared_1": left, "Infrared_2": right, "Depth_0": scene.depth_code(unit_m)}
            for place, (stream, image) in enumerate(images.items()):
                data = cv2.imencode(".png", image)[1].tobytes()
                topic, form = "compressed", "mono8; png compressed mono8"
                if stream == "Depth_0":
                    data = struct.pack("<iff", 0, 0, 0) + data
                    topic, form = "compressedDepth", "16UC1; compressedDepth png"
                stamp = TYPES.types["builtin_interfaces/msg/Time"](0, time_ns + place)
                header = TYPES.types["std_msgs/msg/Header"](stamp=stamp, frame_id=stream)
                message = TYPES.types[COMPRESSED](
                    header=header, format=form, data=np.frombuffer(data, np.uint8)
                )
                base = f"{SENSOR}/{stream}/image"
                publish(f"{base}/data/{topic}", COMPRESSED, message, time_ns + place)
                facts = f"timestamp={100000 + number * 33.333};depth_units={unit_m:.6f};"
                facts += "Actual Exposure=8500;Gain Level=16;"
                say(f"{base}/metadata", facts, time_ns + place)
    (folder / f"{folder.name}.db3").rename(path)
    return path
