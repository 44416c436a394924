"""Recordings of the RealSense Viewer: bags with the topics of librealsense.

    /device_0/info                                          name, serial number, firmware
    /device_0/sensor_0/option/Depth_Units/value             and other options
    /device_0/sensor_0/Infrared_1/image/data, metadata      also Depth_0, Infrared_2, Color_0
    /device_0/sensor_0/Infrared_1/info/camera_info          K and D of the image
    /device_0/sensor_0/Infrared_1/tf/0                      stream from the group's first stream

librealsense 2.59.1 writes a ROS 2 database instead, with compressed images below
`image/data`, and texts in place of the other messages. Times of messages count from the start of
the recording; image headers, or their metadata, have the device's clock.

Source: librealsense 2.56.5, `src/media/ros`: `ros_file_format.h` (topics), `ros_writer.cpp`
(messages); `to-string.cpp` (names of options and metadata).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from starling.patterns import errors
from starling.sim import quantities
from starling.sim.captures.recordings import messages, timing
from starling.sim.captures.recordings.logs.message_log import (
    LoggedMessage,
    LostMessageError,
    MessageLog,
)
from starling.sim.captures.recordings.recording import ImagerCalibration, RecordedFrame, Recording
from starling.sim.captures.recordings.viewer_messages import ViewerMessages
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole

_DATA = re.compile(
    r"(/device_\d+/sensor_\d+)/(Depth|Infrared|Color)_(\d+)/image/data(/compressed|/compressedDepth)?"
)
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
        InputError: if it lacks the left infrared stream, or the streams' clocks differ.
    """
    source = ViewerMessages.of_log(log)
    topics = _topics(log, path)
    options = source.options(topics["left"])
    stated = {name: source.metadata(topic) for name, topic in topics.items()}
    images = {name: source.by_topic[topic] for name, topic in topics.items()}
    heads = _heads(log, topics, stated)
    times = {name: [head[0] for head in stream] for name, stream in heads.items()}
    rows = timing.partners({name: times[name] for name in topics if name != "colour"})
    coloured = timing.nearest_numbers(times.get("colour", []), times["left"])
    imported = []
    for place, numbers in enumerate(rows):
        if numbers is None:
            continue
        facts = dict(options)
        for name in ("depth", "left"):  # Those of the infrared image win.
            if name in numbers:
                facts |= stated[name].get(images[name][numbers[name]].time_ns, {})
        number = coloured[place]
        if number is not None:
            numbers = {**numbers, "colour": number}
        reads = {
            name: partial(_pixels, images[name][number], topics[name], is_ros1=log.is_ros1)
            for name, number in numbers.items()
        }
        imported.append(
            RecordedFrame(
                time_s=times["left"][place],
                images=reads,
                facts=_facts(facts),
                is_lit=_lit(facts),
            )
        )
    lenses = {name: source.lens(topic) for name, topic in topics.items()}
    places = {name: source.pose(topic) for name, topic in topics.items()}
    left, right = lenses["left"], lenses.get("right")
    distorted = left is not None and right is not None and (left.is_distorted or right.is_distorted)
    name = source.table("/" + topics["left"].split("/")[1] + "/info").get("Name", "")
    return Recording(
        path=path,
        kind="RealSense Viewer bag",
        frames=tuple(imported),
        device=name.split()[-1].lower() if name.split() else None,
        camera=_pinhole(left),
        baseline_m=_baseline_m(places, options),
        depth_unit_m=_depth_unit_m(heads, options),
        colour=_pinhole(lenses.get("colour")),
        colour_from_left=_between(places.get("left"), places.get("colour")),
        lenses=(left, right) if distorted and left is not None and right is not None else None,
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


def _heads(
    log: MessageLog, topics: Mapping[str, str], stated: Mapping[str, Mapping[int, dict[str, str]]]
) -> dict[str, list[tuple[float, float | None]]]:
    """Return time and depth unit of each image, read in the order of the file.

    Neighbours share a compressed chunk. A damaged image gets the time of its record.
    """
    names = {topic: name for name, topic in topics.items()}
    heads: dict[str, list[tuple[float, float | None]]] = {name: [] for name in topics}
    for entry in log.entries:
        if entry.topic in names:
            name = names[entry.topic]
            table = stated[name].get(entry.time_ns, {})
            heads[name].append(_ros1_head(entry) if log.is_ros1 else _text_head(entry, table))
    return heads


def _ros1_head(entry: LoggedMessage) -> tuple[float, float | None]:
    try:
        message = messages.image(entry, is_ros1=True)
    except LostMessageError:
        return entry.time_ns / 1e9, None
    return message.time_s, message.depth_unit_m


def _text_head(entry: LoggedMessage, table: Mapping[str, str]) -> tuple[float, float | None]:
    """Return time [ms in the metadata] and depth unit."""
    values = [_float(table, key) for key in ("timestamp", "depth_units")]
    return entry.time_ns / 1e9 if values[0] is None else values[0] / 1e3, values[1] or None


def _float(table: Mapping[str, str], key: str) -> float | None:
    try:
        return float(table[key])
    except (KeyError, ValueError):
        return None


def _pixels(entry: LoggedMessage, topic: str, *, is_ros1: bool) -> Any:
    return messages.pixels(messages.image(entry, is_ros1=is_ros1), topic)


def _facts(stated: dict[str, str]) -> dict[str, Any]:
    """Return the plausible keys of `frame.json`; exposure comes in microseconds."""
    scales = {"exposure_s": ("Actual Exposure", 1e-6), "gain": ("Gain Level", 1.0)}
    scales["laser_power"] = ("Frame Laser Power", 1.0)
    values = {key: (_float(stated, name), scale) for key, (name, scale) in scales.items()}
    return {
        key: float(f"{value * scale:.9g}")
        for key, (value, scale) in values.items()
        if value is not None and quantities.is_plausible(value * scale, key)
    }


def _lit(stated: dict[str, str]) -> bool | None:
    for key in ("Frame Laser Power Mode", "Frame Emitter Mode"):
        value = stated.get(key, "").split(".")[0]
        if value in _ON | _OFF:
            return value in _ON
    return None


def _pinhole(lens: ImagerCalibration | None) -> Pinhole | None:
    if lens is None:
        return None
    return Pinhole.from_matrix(lens.matrix, (lens.width, lens.height))


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
    stated = options.get("depth_units")
    return None if stated is None else float(stated)
