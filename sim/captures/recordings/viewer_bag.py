"""Recordings of the RealSense Viewer: ROS 1 bags with the topics of librealsense.

    /device_0/info                                          name, serial number, firmware
    /device_0/sensor_0/option/Depth_Units/value             and other options
    /device_0/sensor_0/Infrared_1/image/data, metadata      also Depth_0, Infrared_2, Color_0
    /device_0/sensor_0/Infrared_1/info/camera_info          K and D of the image
    /device_0/sensor_0/Infrared_1/tf/0                      stream from the group's first stream

Times of messages count from the start of the recording; image headers have the device's clock.

Source: librealsense at v2.57, `src/media/ros`: `ros_file_format.h` (topics), `ros_writer.cpp`
(messages); `to-string.cpp` (names of options and metadata).
"""

from __future__ import annotations

import re
import struct
from collections import defaultdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from starling.patterns import errors
from starling.sim.captures.recordings import messages, timing
from starling.sim.captures.recordings.logs.message_log import (
    LoggedMessage,
    LostMessageError,
    MessageLog,
)
from starling.sim.captures.recordings.recording import ImagerCalibration, RecordedFrame, Recording
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole

_DATA = re.compile(r"(/device_\d+/sensor_\d+)/(Depth|Infrared|Color)_(\d+)/image/data")
_STREAMS = {
    ("Infrared", 1): "left",
    ("Infrared", 2): "right",
    ("Depth", 0): "depth",
    ("Color", 0): "colour",
}
_ON, _OFF = {"1", "2", "3"}, {"0"}  # Values of the emitter's mode: laser, automatic, LED.


def is_viewer(log: MessageLog) -> bool:
    """Whether a log has the topics of librealsense."""
    return any(_DATA.fullmatch(topic) for topic in log.topics)


def read(log: MessageLog, path: Path) -> Recording:
    """Read a recording of the viewer.

    Raises:
        InputError: if it lacks the left infrared stream or its intrinsics, or clocks differ.
    """
    by_topic: dict[str, list[LoggedMessage]] = defaultdict(list)
    for entry in log.entries:
        by_topic[entry.topic].append(entry)
    topics = _topics(log, path)
    options = _options(by_topic, topics["left"].rsplit("/", 3)[0])
    images = {name: by_topic[topic] for name, topic in topics.items()}
    # In the order of the file, as neighbours share a compressed chunk.
    names = {topic: name for name, topic in topics.items()}
    heads: dict[str, list[tuple[float, float | None]]] = {name: [] for name in topics}
    for entry in log.entries:
        if entry.topic in names:
            heads[names[entry.topic]].append(_head(entry))
    times = {name: [head[0] for head in stream] for name, stream in heads.items()}
    lenses = {name: _lens(by_topic, topic) for name, topic in topics.items()}
    left = lenses["left"]
    if left is None:
        rule = "must have /info/camera_info"
        raise errors.refuse(topics["left"], rule, path, "Give --calibration FILE.")
    rows = timing.partners({name: times[name] for name in topics if name != "colour"})
    coloured = timing.nearest_numbers(times.get("colour", []), times["left"])
    imported = []
    metadata = _metadata(by_topic, topics["left"]), _metadata(by_topic, topics.get("depth", ""))
    for place, numbers in enumerate(rows):
        if numbers is None:
            continue
        entry = images["left"][place]
        stated = {**options, **metadata[1].get(entry.time_ns, {})}
        if "depth" in numbers:
            stated |= metadata[1].get(images["depth"][numbers["depth"]].time_ns, {})
        stated |= metadata[0].get(entry.time_ns, {})
        reads = {
            name: partial(_pixels, images[name][number], topics[name])
            for name, number in numbers.items()
        }
        number = coloured[place]
        if number is not None:
            reads["colour"] = partial(_pixels, images["colour"][number], topics["colour"])
        imported.append(
            RecordedFrame(
                time_s=times["left"][place],
                images=reads,
                facts=_facts(stated),
                is_lit=_lit(stated),
            )
        )
    places = {name: _pose(by_topic, topic) for name, topic in topics.items()}
    pair = (left, lenses.get("right") or left)
    return Recording(
        path=path,
        kind="RealSense Viewer bag",
        frames=tuple(imported),
        device=_device(by_topic, topics["left"]),
        camera=_pinhole(left),
        baseline_m=_baseline_m(places, options),
        depth_unit_m=_depth_unit_m(heads, options),
        colour=_pinhole(lenses.get("colour")),
        colour_from_left=_between(places.get("left"), places.get("colour")),
        lenses=pair if any(lens.is_distorted for lens in pair) else None,
        right_from_left=_between(places.get("left"), places.get("right")),
        unpaired=len(rows) - len(imported),
        damage=log.damage,
    )


def _topics(log: MessageLog, path: Path) -> dict[str, str]:
    """Return the topics of the first device's images by the names of streams."""
    matches = sorted(filter(None, map(_DATA.fullmatch, log.topics)), key=lambda match: match[0])
    device = matches[0][1].split("/")[1]
    topics: dict[str, str] = {}
    for match in matches:
        name = _STREAMS.get((match[2], int(match[3])))
        if match[2] == "Infrared" and match[3] == "0":
            name = "left"
        if name and match[1].split("/")[1] == device:
            topics.setdefault(name, match[0])
    if "left" not in topics:
        rule, got = "must have infrared images, Infrared_1", ", ".join(topics.values())
        advice = "Record with the infrared streams switched on."
        raise errors.refuse(path.name, rule, got, advice)
    return topics


def _head(entry: LoggedMessage) -> tuple[float, float | None]:
    """Return time and depth unit of an image; a damaged one gets the time of its record."""
    try:
        message = messages.image(entry, is_ros1=True)
    except LostMessageError:
        return entry.time_ns / 1e9, None
    return message.time_s, message.depth_unit_m


def _pixels(entry: LoggedMessage, topic: str) -> Any:
    return messages.pixels(messages.image(entry, is_ros1=True), topic)


def _options(by_topic: dict[str, list[LoggedMessage]], sensor: str) -> dict[str, str]:
    """Return the first values of a sensor's options, under the names of the metadata."""
    names = {
        "Exposure": "Actual Exposure",
        "Gain": "Gain Level",
        "Laser_Power": "Frame Laser Power",
        "Emitter_Enabled": "Frame Emitter Mode",
        "Depth_Units": "Depth Units",
        "Stereo_Baseline": "Stereo Baseline",
    }
    options = {}
    for option, name in names.items():
        entries = by_topic.get(f"{sensor}/option/{option}/value", [])
        data = entries[0].read() if entries else b""
        if len(data) == 4:
            options[name] = f"{struct.unpack('<f', data)[0]:.7g}"
    return options


def _metadata(by_topic: dict[str, list[LoggedMessage]], topic: str) -> dict[int, dict[str, str]]:
    """Return keys and values of each frame by the time of their record."""
    result: dict[int, dict[str, str]] = defaultdict(dict)
    for entry in by_topic.get(topic.removesuffix("data") + "metadata", []):
        try:
            key, value = messages.key_value(entry)
        except LostMessageError:
            continue
        result[entry.time_ns][key] = value
    return result


def _facts(stated: dict[str, str]) -> dict[str, Any]:
    """Return the keys of `frame.json`; exposure comes in microseconds."""
    facts: dict[str, Any] = {}
    scales = {"exposure_s": ("Actual Exposure", 1e-6), "gain": ("Gain Level", 1.0)}
    scales["laser_power"] = ("Frame Laser Power", 1.0)
    for key, (name, scale) in scales.items():
        try:
            facts[key] = float(f"{float(stated[name]) * scale:.9g}")
        except (KeyError, ValueError):
            continue
    return facts


def _lit(stated: dict[str, str]) -> bool | None:
    for key in ("Frame Laser Power Mode", "Frame Emitter Mode"):
        value = stated.get(key, "").split(".")[0]
        if value in _ON | _OFF:
            return value in _ON
    return None


def _lens(by_topic: dict[str, list[LoggedMessage]], topic: str) -> ImagerCalibration | None:
    """Return the intrinsics of a stream."""
    entries = by_topic.get(topic.removesuffix("/image/data") + "/info/camera_info", [])
    if not entries:
        return None
    info = messages.parse(entries[0], is_ros1=True)
    return ImagerCalibration(
        width=info.width,
        height=info.height,
        matrix=np.array(info.K, np.float64).reshape(3, 3),
        distortion=np.array(info.D, np.float64),
    )


def _pinhole(lens: ImagerCalibration | None) -> Pinhole | None:
    if lens is None:
        return None
    k = lens.matrix
    focal = {"fx_px": float(k[0, 0]), "fy_px": float(k[1, 1])}
    centre = {"cx_px": float(k[0, 2]), "cy_px": float(k[1, 2])}
    return Pinhole(width=lens.width, height=lens.height, **focal, **centre)


def _pose(by_topic: dict[str, list[LoggedMessage]], topic: str) -> tuple[str, Pose] | None:
    """Return the group of a stream and the stream's pose from the group's first stream."""
    prefix = topic.removesuffix("/image/data") + "/tf/"
    for name, entries in by_topic.items():
        data = entries[0].read() if name.startswith(prefix) else b""
        if len(data) == 56:
            x, y, z, *quaternion = struct.unpack("<7d", data)
            place = np.array([x, y, z])
            return name.removeprefix(prefix), frames.from_quaternion(place, np.array(quaternion))
    return None


def _between(first: tuple[str, Pose] | None, second: tuple[str, Pose] | None) -> Pose | None:
    """Return `second_from_first` of two streams of one group."""
    if first is None or second is None or first[0] != second[0]:
        return None
    return second[1] @ np.linalg.inv(first[1])


def _baseline_m(places: dict[str, Any], options: dict[str, str]) -> float | None:
    """Return the distance of the imagers, by their poses or the option in millimetres."""
    between = _between(places.get("left"), places.get("right"))
    if between is not None and between[0, 3]:
        return float(f"{-between[0, 3]:.7g}")
    stated = options.get("Stereo Baseline")
    return None if stated is None else float(stated) / 1e3


def _depth_unit_m(heads: dict[str, Any], options: dict[str, str]) -> float | None:
    units = [unit for _, unit in heads.get("depth", []) if unit]
    if units:
        return units[0]
    stated = options.get("Depth Units")
    return None if stated is None else float(stated)


def _device(by_topic: dict[str, list[LoggedMessage]], topic: str) -> str | None:
    """Return the name of the camera: `Intel RealSense D435I` is `d435i`."""
    info = "/" + topic.split("/")[1] + "/info"
    for entry in by_topic.get(info, []):
        key, value = messages.key_value(entry)
        if key == "Name" and value.split():
            return value.split()[-1].lower()
    return None
