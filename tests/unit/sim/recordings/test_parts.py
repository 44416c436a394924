"""Frames of reference, chunks of MCAP files and matches of windows, each alone."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from lz4 import frame as lz4_frame

from starling.sim.captures.recordings import checks, transforms
from starling.sim.captures.recordings.logs import mcap_log
from starling.sim.captures.recordings.logs.message_log import LoggedMessage
from starling.sim.captures.recordings.transforms import FrameTree
from starling.sim.geometry import frames
from tests.unit.sim.recordings import scene


def shift(x: float) -> np.ndarray:
    return frames.pose((x, 0, 0), (0, 0, 0))


def test_a_moving_frame_is_known_near_its_times():
    tree = FrameTree(fixed={"eye": ("link", shift(1))})
    tree.moving["link"] = ("world", [10.0, 10.1, 10.2], [shift(2), shift(3), shift(4)])
    root, pose, moves = tree.root_from("eye", 10.11) or ("", np.eye(4), False)
    assert (root, pose[0, 3], moves) == ("world", 4.0, True)
    assert tree.root_from("eye", 11.0) is None
    assert tree.root_from("alone", 0.0) == ("alone", pytest.approx(np.eye(4)), False)


def test_frames_without_a_fixed_chain_have_no_pose():
    tree = FrameTree(fixed={"a": ("b", shift(1)), "b": ("a", shift(1)), "c": ("d", shift(2))})
    assert tree.root_from("a", 0.0) is None  # A loop.
    assert tree.between("a", "c") is None
    assert tree.between("c", "e") is None
    assert tree.between("c", "d")[0, 3] == 2.0


def test_damaged_transforms_are_left_out():
    entry = LoggedMessage("/tf", "tf2_msgs/msg/TFMessage", 0, lambda: b"\0\1\0\0none")
    tree = transforms.read([entry], [entry], is_ros1=False)
    assert not tree.fixed and not tree.moving


def test_chunks_of_mcap_may_be_lz4(tmp_path: Path):
    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    def record(code: int, content: bytes) -> bytes:
        return struct.pack("<BQ", code, len(content)) + content

    schema = struct.pack("<H", 1) + text("std_msgs/msg/String") + text("ros2msg") + text("")
    channel = struct.pack("<HH", 3, 1) + text("/say") + text("cdr") + struct.pack("<I", 0)
    message = struct.pack("<HIQQ", 3, 0, 17, 17) + b"data"
    inside = record(3, schema) + record(4, channel) + record(5, message)
    packed = lz4_frame.compress(inside)
    chunk = struct.pack("<QQQI", 17, 17, len(inside), 0) + text("lz4")
    chunk += struct.pack("<Q", len(packed)) + packed
    path = tmp_path / "a.mcap"
    path.write_bytes(mcap_log.MAGIC + record(6, chunk) + record(2, b"") + mcap_log.MAGIC)
    log = mcap_log.open_log(path)
    (entry,) = log.entries
    assert (entry.topic, entry.kind, entry.time_ns) == ("/say", "std_msgs/msg/String", 17)
    assert entry.read() == b"data" and not log.damage and not log.is_ros1


def test_images_without_matches_give_no_figures():
    small = np.zeros((20, 30), np.uint8)
    assert checks.pair_figures(small, small) == checks.PairFigures(windows=0)
    even = np.full((scene.HEIGHT, scene.WIDTH), 9, np.uint8)
    assert checks.pair_figures(even, even).windows == 0
    stripes = np.tile((np.arange(scene.WIDTH) % 8 * 30).astype(np.uint8), (scene.HEIGHT, 1))
    assert checks.pair_figures(stripes, stripes).windows == 0  # All matches are ambiguous.


def test_windows_are_found_to_a_tenth_of_a_pixel():
    left, right = scene.pair(0, rows_px=-2, disparity_px=17)
    figures = checks.pair_figures(left, right)
    assert figures.row_offset_px == pytest.approx(-2, abs=0.1)
    assert figures.row_spread_px == pytest.approx(2, abs=0.1)
    assert figures.disparity_px == pytest.approx(17, abs=0.1)
