"""Damaged messages in whole files: they are counted, and the other frames are imported."""

from __future__ import annotations

import contextlib
import random
import sqlite3
import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from rosbags import rosbag1

from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.captures.recordings import findings, statement
from starling.sim.captures.recordings.import_recording import import_recording
from starling.sim.captures.recordings.logs import sqlite_log
from starling.sim.captures.recordings.logs.message_log import ChunkCache, LostMessageError
from starling.sim.captures.recordings.statement import GivenFacts
from starling.sim.captures.recordings.timing import clock
from tests.unit.sim.recordings import scene, viewer, viewer_database
from tests.unit.sim.recordings.ros import Topics

LEFT, RIGHT = "/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw"
GIVEN = GivenFacts(emitter="on", sensor="d435", baseline_m=0.05)


def report(path: Path, **more: Any) -> dict[str, Any]:
    """Import a recording into the folder that holds it."""
    return import_recording(path, path.parent / "set", force=True, **{"flags": GIVEN, **more})


def test_cut_images_are_left_out_and_counted(tmp_path: Path):
    topics = Topics().pair(LEFT, RIGHT, count=4)
    images = [message for topic, _, _, message in topics.rows if topic == LEFT]
    images[1].step = 10
    images[2].data = images[2].data[:100]
    result = report(topics.write(tmp_path / "bag"))
    assert result["frames"] == 2 and result["left_out"]["damaged"] == 2
    frame = capture.open_set(tmp_path / "set").scenes[0].frame(1)
    np.testing.assert_array_equal(frame.ir_left, scene.pair(3)[0])


def test_a_recording_without_a_whole_frame_is_refused(tmp_path: Path):
    topics = Topics()
    topics.compressed(f"{LEFT}/compressed", 100, b"none", "mono8; png compressed")
    topics.info("/camera/infra1/camera_info", 100)
    with pytest.raises(InputError, match="source must have a whole frame; got none in"):
        report(topics.write(tmp_path / "bag"))
    topics.compressed(f"{RIGHT}/compressed", 100, b"none", "mono8; png compressed")
    topics.rows[0] = (LEFT, *_image(topics))
    with pytest.raises(InputError, match="source must have a whole frame; got 1 damaged"):
        report(topics.write(tmp_path / "bag2"))


def _image(topics: Topics) -> tuple[Any, ...]:
    """Return the row of one left image."""
    other = Topics()
    other.image(LEFT, 100, scene.pair(0)[0], "mono8")
    return other.rows[0][1:]


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        (LEFT, f"{LEFT} must have whole images; got damaged ones"),
        (RIGHT, "source must have frames with all streams; got none"),
    ],
)
def test_a_topic_without_whole_images_is_refused(topic: str, message: str, tmp_path: Path):
    path = Topics().pair(LEFT, RIGHT, count=1).write(tmp_path / "bag")
    with sqlite3.connect(path / "bag.db3") as base:
        base.execute(
            "UPDATE messages SET data = x'00010000' WHERE topic_id = "
            "(SELECT id FROM topics WHERE name = ?)",
            (topic,),
        )
    base.close()
    with pytest.raises(InputError, match=message):
        report(path)


def test_a_row_that_the_database_lost_is_no_message(tmp_path: Path):
    path = Topics().pair(LEFT, RIGHT, count=1).write(tmp_path / "bag") / "bag.db3"
    entry = sqlite_log.open_log(path).entries[0]
    with sqlite3.connect(path) as base:
        base.execute("DELETE FROM messages")
    base.close()
    with pytest.raises(LostMessageError):
        entry.read()


def test_messages_that_zstandard_compressed_are_read(tmp_path: Path):
    from backports import zstd

    path = Topics().pair(LEFT, RIGHT, count=2).write(tmp_path / "bag")
    with sqlite3.connect(path / "bag.db3") as base:
        for number, data in base.execute("SELECT id, data FROM messages").fetchall():
            packed = zstd.compress(data)
            base.execute("UPDATE messages SET data = ? WHERE id = ?", (packed, number))
    base.close()
    assert report(path)["frames"] == 2


def test_a_split_bag_is_one_recording(tmp_path: Path):
    path = Topics().pair(LEFT, RIGHT, count=2).write(tmp_path / "bag")
    more = Topics().pair(LEFT, RIGHT, count=3).write(tmp_path / "more")
    (more / "more.db3").rename(path / "bag_1.db3")
    result = report(path)
    assert result["frames"] == 5 and result["clock"]["jumps"] == 1


def test_colour_must_have_the_size_of_its_camera(tmp_path: Path):
    topics = Topics().pair(LEFT, RIGHT, count=1)
    topics.image("/camera/color/image_raw", 100, np.zeros((10, 20, 3), np.uint8), "rgb8")
    topics.info("/camera/color/camera_info", 100)
    with pytest.raises(InputError, match=r"colour of bag/0 must be 320x240 as its .*; got 20x10"):
        report(topics.write(tmp_path / "bag"))


def test_damaged_messages_of_the_viewer_are_left_out(tmp_path: Path):
    """A message may be whole in the bag, and cut in itself."""
    whole = viewer.image(scene.pair(0)[0], "8UC1", 100.0, None)
    images = [whole[:2000], whole[:9], whole]
    path = tmp_path / "desk.bag"
    with rosbag1.Writer(path) as bag:
        publish = viewer._publisher(bag)
        info, stream = viewer.camera_info(), f"{viewer.SENSOR}/Infrared_1"
        publish(f"{stream}/info/camera_info", "sensor_msgs/msg/CameraInfo", info, 1)
        for number, data in enumerate(images):
            time_ns = (100 + number) * 10**9
            publish(f"{stream}/image/data", viewer.IMAGE, data, time_ns)
            kind = "diagnostic_msgs/msg/KeyValue"
            publish(f"{stream}/image/metadata", kind, struct.pack("<I", 99), time_ns)
    result = report(path)
    assert result["frames"] == 1 and result["left_out"]["damaged"] == 2


def test_a_chunk_is_decompressed_once_while_it_is_kept():
    loaded: list[int] = []

    def load(number: int) -> bytes:
        loaded.append(number)
        return bytes([number])

    cache = ChunkCache(load)
    for number in (0, 1, 0, 2, 3, 4, 0):
        assert cache(number) == bytes([number])
    assert loaded == [0, 1, 2, 3, 4, 0]


def test_clock_figures():
    assert clock([1.0]).rate_hz is None
    assert clock([0.0, 0.0, 0.0]).rate_hz == pytest.approx(30)
    figures = clock([0, 0.1, 0.2, 0.5, 0.6, 100.0, 99.0])
    assert (figures.rate_hz, figures.dropped, figures.jumps) == (10, 2, 2)


@pytest.mark.parametrize("kind", ["viewer.bag", "ros.bag", "ros.db3", "ros.mcap", "viewer.db3"])
def test_damaged_bytes_are_imported_or_refused(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """No damage of a file ends in another error than a refusal."""
    seen = findings.findings([], statement.Geometry(camera=scene.CAMERA, baseline_m=0.05), 1, 1)
    monkeypatch.setattr(findings, "findings", lambda *_: seen)
    source = {
        "viewer.bag": lambda: viewer.ViewerBag().write(tmp_path / "a.bag"),
        "ros.bag": lambda: Topics(is_ros1=True).pair(LEFT, RIGHT).write(tmp_path / "a.bag"),
        "ros.db3": lambda: Topics().pair(LEFT, RIGHT).write(tmp_path / "a") / "a.db3",
        "ros.mcap": lambda: Topics().pair(LEFT, RIGHT).write(tmp_path / "a", "MCAP") / "a.mcap",
        "viewer.db3": lambda: viewer_database.write(tmp_path / "a.db3"),
    }[kind]()
    whole, rng = source.read_bytes(), random.Random(kind)
    path = tmp_path / f"damaged{source.suffix}"
    for number in range(12):
        data = bytearray(whole)
        if number % 3 == 0:
            data = data[: rng.randrange(1, len(data))]
        for _ in range((0, 3, 300)[number % 3]):
            data[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(data)
        with warnings.catch_warnings(), contextlib.suppress(InputError):
            warnings.simplefilter("ignore")
            report(path)
