"""ROS 1 and 2 recordings with the topics of realsense-ros, or topics that are named.

    NAMESPACE/infra1/image_rect_raw, infra2/..., depth/image_rect_raw, color/image_raw
    NAMESPACE/infra1/camera_info, infra2/camera_info        P[0, 3] = -fx b of the right image
    NAMESPACE/infra1/metadata                               exposure, gain, laser as JSON text
    NAMESPACE/extrinsics/depth_to_infra2                    baseline where P has none

Sources: realsense-ros 4.x: README (topics), `ros_utils`, `base_realsense_node` (metadata);
sensor_msgs/CameraInfo; REP 118 (depth images).
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import re
from collections import defaultdict
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from starling.patterns import errors
from starling.sim import quantities
from starling.sim.captures.exchange.ros_types import METADATA
from starling.sim.captures.recordings import messages, timing, transforms
from starling.sim.captures.recordings.logs.message_log import (
    LoggedMessage,
    LostMessageError,
    MessageLog,
)
from starling.sim.captures.recordings.messages import ImageMessage
from starling.sim.captures.recordings.recording import ImagerCalibration, RecordedFrame, Recording
from starling.sim.captures.recordings.transforms import FrameTree
from starling.sim.geometry.pinhole import Pinhole

_IMAGES = (messages.IMAGE, messages.COMPRESSED)
# Usual ends of topics, the best first. `aligned_depth_to_color` is not in the left view.
_ENDS = {
    "left": ("/infra1/image_rect_raw", "/infra1/image_raw", "/left/image_rect", "/left/image_raw"),
    "right": (
        *("/infra2/image_rect_raw", "/infra2/image_raw"),
        *("/right/image_rect", "/right/image_raw"),
    ),
    "depth": ("/depth/image_rect_raw", "/depth/image_raw", "/stereo/depth"),
    "colour": ("/color/image_raw", "/color/image_rect_raw", "/color/image_rect", "/rgb/image_raw"),
}
_TRANSPORT = r"/(compressed|compressedDepth)"
_MILLIMETRE = 1e-3  # Unit of 16-bit depth by REP 118 [m].
_FLOAT = "32FC1"


def read(log: MessageLog, path: Path, chosen: Mapping[str, str]) -> Recording:
    """Read a recording of ROS topics.

    Args:
        log: recorded messages.
        path: file or folder, for messages.
        chosen: topics by stream, where they are named.

    Raises:
        InputError: if a topic is missing or several fit, or the intrinsics or times are missing.
    """
    by_topic: dict[str, list[LoggedMessage]] = defaultdict(list)
    for entry in log.entries:
        by_topic[entry.topic].append(entry)
    topics = {**_usual(log, path, chosen), **_named(log, path, chosen)}
    if "left" not in topics:
        images = [topic for topic, kind in log.topics.items() if kind in _IMAGES]
        rule, got = "must have a left infrared topic", ", ".join(images) or "no image topic"
        raise errors.refuse(path.name, rule, got, "Name it: --left TOPIC.")
    heads, lost = _heads(log, topics)
    if not heads["left"]:
        advice = "Record it again."
        raise errors.refuse(topics["left"], "must have whole images", "damaged ones", advice)
    times = {
        name: [message.time_s or entry.time_ns / 1e9 for entry, message in stream]
        for name, stream in heads.items()
    }
    rows = timing.partners({name: times[name] for name in topics if name != "colour"})
    infos = {name: _lens(by_topic[_info_topic(topic)], log) for name, topic in topics.items()}
    tree = transforms.read(by_topic["/tf_static"], by_topic["/tf"], is_ros1=log.is_ros1)
    stated = _metadata(by_topic, topics, log)
    frame_names = {name: stream[0][1].frame for name, stream in heads.items() if stream}
    coloured = timing.nearest_numbers(times.get("colour", []), times["left"])
    imported = []
    for place, numbers in enumerate(rows):
        if numbers is None:
            continue
        if coloured[place] is not None:
            numbers = {**numbers, "colour": coloured[place]}
        reads = {
            name: partial(_pixels, heads[name][number][0], topics[name], is_ros1=log.is_ros1)
            for name, number in numbers.items()
        }
        facts = stated.get(round(times["left"][place] * 1e6), {})
        pose = _left_from_world(tree, frame_names["left"], times["left"][place])
        imported.append(
            RecordedFrame(
                time_s=times["left"][place],
                images=reads,
                facts={**_facts(facts), **pose},
                is_lit=_lit(facts),
            )
        )
    left, right = infos.get("left"), infos.get("right")
    pair = (left, right) if left is not None and right is not None else None
    distorted = pair is not None and any(lens.is_distorted for lens in pair)
    unit_m, step_m = _depth_unit_m(heads.get("depth", []), stated)
    return Recording(
        path=path,
        kind=f"ROS {1 if log.is_ros1 else 2} topics",
        frames=tuple(imported),
        device=_first_stated(stated, "device", str),
        black_level_dn=_first_stated(stated, "black_level_dn", (int, float)),
        camera=_pinhole(left),
        baseline_m=_baseline_m(right, tree, frame_names, topics, by_topic, log),
        depth_unit_m=unit_m,
        depth_step_m=step_m,
        colour=_pinhole(infos.get("colour")),
        colour_from_left=tree.between(frame_names["left"], frame_names["colour"])
        if "colour" in frame_names
        else None,
        lenses=pair if distorted else None,
        right_from_left=tree.between(frame_names["left"], frame_names["right"])
        if "right" in frame_names
        else None,
        unpaired=len(rows) - len(imported),
        lost=lost,
        damage=log.damage,
        notes=(*_notes(heads), *([f"{lost} images are damaged"] if lost else [])),
    )


def _named(log: MessageLog, path: Path, chosen: Mapping[str, str]) -> dict[str, str]:
    """Return the topics that are named by flags."""
    for name, topic in chosen.items():
        kind = log.topics.get(topic)
        if kind not in _IMAGES:
            images = ", ".join(sorted(t for t, k in log.topics.items() if k in _IMAGES)) or "none"
            got = f"{topic} of {kind}" if kind else topic
            rule = "must name a topic of images"
            raise errors.refuse(f"--{name.replace('_', '-')}", rule, got, f"Those are: {images}.")
    return dict(chosen)


def _usual(log: MessageLog, path: Path, chosen: Mapping[str, str]) -> dict[str, str]:
    """Return the topics with usual names; all are of one camera."""
    topics: dict[str, str] = {}
    images = [topic for topic, kind in sorted(log.topics.items()) if kind in _IMAGES]
    for name, ends in _ENDS.items():
        if "left" in chosen or name in chosen:  # Then the others are named too.
            continue
        for end in ends:
            fits = [topic for topic in images if re.fullmatch(f".*{end}({_TRANSPORT})?", topic)]
            plain = [topic for topic in fits if not re.search(f"{_TRANSPORT}$", topic)] or fits
            if len(plain) > 1:
                rule, got = f"must have one {name} topic", ", ".join(plain)
                raise errors.refuse(path.name, rule, got, f"Name it: --{name} TOPIC.")
            if plain:
                topics[name] = plain[0]
                break
    return topics


def _heads(
    log: MessageLog, topics: Mapping[str, str]
) -> tuple[dict[str, list[tuple[LoggedMessage, ImageMessage]]], int]:
    """Return the whole images of each stream without their pixels, and the number of others."""
    lost = 0
    names = {topic: name for name, topic in topics.items()}
    heads: dict[str, list[tuple[LoggedMessage, ImageMessage]]] = {name: [] for name in topics}
    for entry in log.entries:
        if entry.topic in names:
            try:
                message = messages.image(entry, is_ros1=log.is_ros1)
            except LostMessageError:
                lost += 1
                continue
            heads[names[entry.topic]].append((entry, dataclasses.replace(message, data=b"")))
    return heads, lost


def _pixels(entry: LoggedMessage, topic: str, *, is_ros1: bool) -> Any:
    return messages.pixels(messages.image(entry, is_ros1=is_ros1), topic)


def _info_topic(topic: str) -> str:
    """Return the topic of an image's intrinsics, in the same namespace."""
    plain = re.sub(f"{_TRANSPORT}$", "", topic)
    return plain.rsplit("/", 1)[0] + "/camera_info"


def _lens(entries: list[LoggedMessage], log: MessageLog) -> ImagerCalibration | None:
    """Return the calibration in the first whole message."""
    for entry in entries:
        try:
            info = messages.parse(entry, is_ros1=log.is_ros1)
        except LostMessageError:
            continue
        d, k, r, p = (getattr(info, c.upper() if log.is_ros1 else c) for c in "dkrp")
        return ImagerCalibration(
            width=info.width,
            height=info.height,
            matrix=np.array(k, np.float64).reshape(3, 3),
            distortion=np.array(d, np.float64),
            model=info.distortion_model,
            rotation=np.array(r, np.float64).reshape(3, 3),
            projection=np.array(p, np.float64).reshape(3, 4),
        )
    return None


def _pinhole(lens: ImagerCalibration | None) -> Pinhole | None:
    """Return the rectified camera: P, or K where P is empty."""
    if lens is None:
        return None
    p = lens.matrix if lens.projection is None or not lens.projection.any() else lens.projection
    return Pinhole.from_matrix(p, (lens.width, lens.height))


def _baseline_m(
    right: ImagerCalibration | None,
    tree: FrameTree,
    frame_names: Mapping[str, str],
    topics: Mapping[str, str],
    by_topic: Mapping[str, list[LoggedMessage]],
    log: MessageLog,
) -> float | None:
    """Return the baseline by P of the right image, by the frames, or by the extrinsics topic."""
    if right is not None and right.projection is not None and right.projection[0, 3]:
        return float(f"{-right.projection[0, 3] / right.projection[0, 0]:.12g}")
    if "right" not in frame_names:  # No whole image.
        return None
    between = tree.between(frame_names["left"], frame_names["right"])
    if between is None or not between[0, 3]:
        between = tree.between("camera_infra1_optical_frame", "camera_infra2_optical_frame")
    if between is not None and between[0, 3]:
        return float(f"{-between[0, 3]:.12g}")
    space = topics["left"].split("/infra1/")[0]
    entries = by_topic.get(f"{space}/extrinsics/depth_to_infra2", [])
    for entry in [] if log.is_ros1 else entries:
        try:
            message = messages.parse(entry, is_ros1=False)
        except LostMessageError:
            continue
        return float(f"{-message.translation[0]:.9g}")
    return None


def _metadata(
    by_topic: Mapping[str, list[LoggedMessage]], topics: Mapping[str, str], log: MessageLog
) -> dict[int, dict[str, Any]]:
    """Return the metadata by time [us]; those of the infrared image win."""
    result: dict[int, dict[str, Any]] = defaultdict(dict)
    for name in ("depth", "left"):
        topic = _info_topic(topics.get(name, "")).removesuffix("camera_info") + "metadata"
        for entry in by_topic.get(topic, []):
            if entry.kind != METADATA or log.is_ros1:
                continue
            try:
                message = messages.parse(entry, is_ros1=False)
                table = json.loads(message.json_data)
            except (LostMessageError, ValueError):
                continue
            stamp = message.header.stamp
            if isinstance(table, dict):
                result[round((stamp.sec + stamp.nanosec / 1e9) * 1e6)].update(table)
    return result


def _facts(stated: Mapping[str, Any]) -> dict[str, Any]:
    """Return the plausible keys of `frame.json`; exposure comes in microseconds."""
    facts: dict[str, Any] = {}
    names = {"exposure_s": "actual_exposure", "gain": "gain_level"}
    for key, name in {**names, "laser_power": "frame_laser_power"}.items():
        value = stated.get(name)
        if errors.is_number(value):
            facts[key] = float(f"{value * 1e-6:.12g}") if key == "exposure_s" else value
    return {key: value for key, value in facts.items() if quantities.is_plausible(value, key)}


def _lit(stated: Mapping[str, Any]) -> bool | None:
    for key in ("frame_laser_power_mode", "frame_emitter_mode"):
        if errors.is_number(stated.get(key)):
            return bool(stated[key])
    return None


def _left_from_world(tree: FrameTree, name: str, time_s: float) -> dict[str, Any]:
    """Return `left_from_world` where a frame above the camera moves."""
    root = tree.root_from(name, time_s)
    if root is None or not root[2]:
        return {}
    return {"left_from_world": np.linalg.inv(root[1]).tolist()}


def _depth_unit_m(
    heads: list[tuple[LoggedMessage, ImageMessage]], stated: Mapping[int, Mapping[str, Any]]
) -> tuple[float | None, float | None]:
    """Return the unit of depth values and, for floating-point ones, the step they had."""
    if not heads:
        return None, None
    if heads[0][1].encoding != _FLOAT:
        return _MILLIMETRE, None
    return 1.0, _first_stated(stated, "depth_units", float)


def _first_stated(stated: Mapping[int, Mapping[str, Any]], key: str, kind: Any) -> Any:
    """Return the first value of a key that has the right type; None without any."""
    values = (row.get(key) for row in stated.values())
    return next((value for value in values if isinstance(value, kind)), None)


def _notes(heads: Mapping[str, list[tuple[LoggedMessage, ImageMessage]]]) -> tuple[str, ...]:
    """Return notes on lossy images."""
    return tuple(
        f"{name} images are compressed by jpeg: their noise is not the camera's"
        for name, stream in heads.items()
        if any("jp" in message.codec for _, message in itertools.islice(stream, 1))
    )
