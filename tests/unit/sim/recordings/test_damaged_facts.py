"""Damaged or impossible facts in recordings of ROS topics: they are counted or left out."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.captures.exchange import ros_types
from starling.sim.captures.recordings.import_recording import import_recording
from starling.sim.captures.recordings.statement import GivenFacts
from tests.unit.sim.recordings.ros import INFO, Topics

LEFT, RIGHT = "/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw"
EXTRINSICS = "/camera/extrinsics/depth_to_infra2"


def imported(path: Path) -> dict[str, Any]:
    """Import a recording into the folder that holds it."""
    flags = GivenFacts(emitter="on", sensor="d435")
    return import_recording(path, path.parent / "set", flags=flags, force=True)


def _cut(path: Path, topic: str, *, most: int) -> None:
    """Cut the first messages of a topic."""
    with closing(sqlite3.connect(path / "bag.db3")) as base, base:
        base.execute(
            "UPDATE messages SET data = x'00010000' WHERE id IN (SELECT id FROM messages WHERE "
            "topic_id = (SELECT id FROM topics WHERE name = ?) ORDER BY timestamp LIMIT ?)",
            (topic, most),
        )


def test_images_whose_header_is_cut_are_counted(tmp_path: Path):
    path = Topics().pair(LEFT, RIGHT, count=3).write(tmp_path / "bag")
    _cut(path, LEFT, most=1)
    with pytest.warns(UserWarning, match="1 images are damaged"):
        result = imported(path)
    assert result["frames"] == 2 and result["left_out"]["damaged"] == 1


def _with_extrinsics(path: Path) -> Path:
    """Write a pair whose right intrinsics have no baseline, but whose extrinsics do."""
    topics = Topics()
    topics.baseline_m = 0.0
    topics.pair(LEFT, RIGHT, count=1)
    kind = "realsense2_camera_msgs/msg/Extrinsics"
    message = topics.store.types[kind](
        topics.header(100), np.eye(3).ravel(), np.array([-0.06, 0, 0])
    )
    topics.rows += [(EXTRINSICS, kind, time_s, message) for time_s in (100, 101)]
    return topics.write(path)


def test_cut_extrinsics_are_no_baseline(tmp_path: Path):
    path = _with_extrinsics(tmp_path / "bag")
    _cut(path, EXTRINSICS, most=1)
    assert imported(path)["baseline_m"] == 0.06
    _cut(path, EXTRINSICS, most=2)
    with pytest.raises(InputError, match="baseline must be given"):
        imported(path)


def test_impossible_facts_are_left_out(tmp_path: Path):
    topics = Topics().pair(LEFT, RIGHT, count=1)
    facts = {"actual_exposure": -5, "gain_level": 1e300, "frame_laser_power": float("nan")}
    message = topics.store.types[ros_types.METADATA](topics.header(100), json.dumps(facts))
    topics.rows.append(("/camera/infra1/metadata", ros_types.METADATA, 100, message))
    imported(topics.write(tmp_path / "bag"))
    frame = capture.open_set(tmp_path / "set").scenes[0].frame(0)
    assert not {"exposure_s", "gain", "laser_power"} & set(frame.record)


def test_the_distortion_of_the_right_imager_is_named(tmp_path: Path):
    topics = Topics().pair(LEFT, RIGHT, count=1)
    infos = [message for topic, kind, _, message in topics.rows if kind == INFO]
    infos[1].d = np.array([0.1, 0, 0, 0, 0])
    with pytest.raises(InputError, match=r"images must be rectified; got distortion 0\.1, 0"):
        imported(topics.write(tmp_path / "bag"))
