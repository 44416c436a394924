"""A recording of the Rerun viewer, read back by its own reader."""

from __future__ import annotations

import json
import sys
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from starling import command_line
from starling.patterns.errors import InputError
from starling.sim.captures import capture, png
from starling.sim.commands import rerun_recording
from starling.sim.reason import Reason

pyarrow: Any = pytest.importorskip("pyarrow", reason="the extra rerun is not installed")
rerun: Any = pytest.importorskip("rerun", reason="the extra rerun is not installed")

CONTEXT = "AnnotationContext:context"
VIEW = "ViewBlueprint:display_name"


def read(path: Path) -> dict[str, list[dict[str, Any]]]:
    """Rows of each entity, in order of the frames; fixed ones have no frame."""
    from rerun.chunk import RrdReader

    rows: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for chunk in RrdReader(path).stream():
        table = pyarrow.table(chunk.to_record_batch())
        if "time" in table.column_names:
            place = table.column_names.index("time")
            table = table.set_column(place, "time_ns", table["time"].cast(pyarrow.int64()))
        assert "log_time" not in table.column_names
        if chunk.entity_path != "/__properties":
            rows[chunk.entity_path] += table.to_pylist()
    for table in rows.values():
        table.sort(key=lambda row: row.get("frame", -1))
    return rows


def recorded(folder: Path) -> dict[str, list[dict[str, Any]]]:
    out = folder.parent / "set.rrd"
    rerun_recording.write(str(folder), out)
    return read(out)


def values(row: dict[str, Any], name: str) -> Any:
    """Return the only value of a component."""
    (value,) = row[name]
    return value


def test_every_image_is_in_the_recording(small_set: Path):
    rows = recorded(small_set)
    scenes = capture.open_set(small_set).scenes
    for side in ("left", "right"):
        images = rows[f"/kitchen/camera/{side}/infrared"]
        assert [row["frame"] for row in images] == [0, 1]
        for row, scene in zip(images, scenes, strict=True):
            data = np.array(values(row, "EncodedImage:blob"), np.uint8)
            stored = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
            np.testing.assert_array_equal(stored, getattr(scene.frame(0), f"ir_{side}"))
    for row, scene in zip(rows["/kitchen/camera/left/depth"], scenes, strict=True):
        code = cv2.imread(str(scene.path / "0" / "depth.png"), cv2.IMREAD_UNCHANGED)
        stored = np.array(values(row, "DepthImage:buffer"), np.uint8).view(np.uint16)
        np.testing.assert_array_equal(stored, code.ravel())
        assert values(row, "DepthImage:meter") == 1000
    reasons = [row for row in rows["/kitchen/camera/left/reason"] if "frame" in row]
    for row, scene in zip(reasons, scenes, strict=True):
        stored = np.array(values(row, "SegmentationImage:buffer"), np.uint8)
        missing = np.isnan(np.asarray(scene.frame(0).depth_m)).ravel()
        np.testing.assert_array_equal(stored, np.where(missing, Reason.UNKNOWN, Reason.VALID))


def test_cameras_are_pinholes_at_their_places(small_set: Path):
    rows = recorded(small_set)
    (left,) = rows["/kitchen/camera/left"]
    matrix = np.reshape(values(left, "Pinhole:image_from_camera"), (3, 3)).T  # By columns.
    np.testing.assert_allclose(matrix, [[90, 0, 79.5], [0, 90, 23.5], [0, 0, 1]])
    assert values(left, "Pinhole:resolution") == [160, 48]
    (moved,) = [row for row in rows["/kitchen/camera/right"] if "Transform3D:translation" in row]
    assert values(moved, "Transform3D:translation") == pytest.approx([0.05, 0, 0])
    assert "/kitchen/camera/colour" not in rows
    assert "ViewCoordinates:xyz" in rows["/kitchen"][0]  # Without a pose y points down.
    (context,) = [row for row in rows["/kitchen/camera/left/reason"] if CONTEXT in row]
    labels = [entry["class_description"]["info"]["label"] for entry in values(context, CONTEXT)]
    assert labels[0] == "valid" and len(labels) == len(Reason)


def test_points_are_those_of_the_depth(small_set: Path):
    first = recorded(small_set)["/kitchen/camera/points"][0]
    depth_m = np.asarray(capture.open_set(small_set).scenes[0].frame(0).depth_m)
    points = np.array(first["Points3D:positions"])
    np.testing.assert_allclose(points[:, 2], depth_m[np.isfinite(depth_m)])
    assert len(first["Points3D:colors"]) == len(points)


def test_poses_and_times_move_the_camera(small_set: Path):
    for number, scene in enumerate(("a", "b")):
        pose = np.eye(4)
        pose[0, 3] = -number
        record = {"timestamp": 5.0 + number, "left_from_world": pose.tolist()}
        (small_set / scene / "0" / "frame.json").write_text(json.dumps(record))
    rows = recorded(small_set)
    moves = [values(row, "Transform3D:translation") for row in rows["/kitchen/camera"]]
    assert moves == [[0, 0, 0], [1, 0, 0]]
    assert [row["time_ns"] for row in rows["/kitchen/camera"]] == [5_000_000_000, 6_000_000_000]
    assert "/kitchen" not in rows


def test_colour_has_its_camera(small_set: Path):
    with (small_set / "capture.toml").open("a") as file:
        file.write("colour_from_left = [[1,0,0,-0.02],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n")
        file.write("[colour]\nwidth = 32\nheight = 24\nfx_px = 30\nfy_px = 30\n")
        file.write("cx_px = 15.5\ncy_px = 11.5\n")
    picture = np.random.default_rng(0).integers(0, 255, (24, 32, 3)).astype(np.uint8)
    (small_set / "a" / "0" / "rgb.png").write_bytes(png.encode_colour(picture))
    rows = recorded(small_set)
    (row,) = rows["/kitchen/camera/colour/rgb"]
    stored = np.array(values(row, "EncodedImage:blob"), np.uint8)
    np.testing.assert_array_equal(cv2.imdecode(stored, cv2.IMREAD_COLOR)[..., ::-1], picture)
    (moved,) = [row for row in rows["/kitchen/camera/colour"] if "Transform3D:translation" in row]
    assert values(moved, "Transform3D:translation") == pytest.approx([0.02, 0, 0])


def test_each_room_has_a_tab_with_views_of_its_images(small_set: Path):
    from rerun.chunk import RrdReader

    (small_set / "b" / "room").write_text("hall")
    (small_set / "b" / "0" / "depth.png").unlink()
    recorded(small_set)
    reader = RrdReader(small_set.parent / "set.rrd")
    (blueprint,) = reader.blueprints()
    tables = [chunk.to_record_batch() for chunk in reader.stream(store=blueprint)]
    views = Counter(
        name
        for table in tables
        if VIEW in table.schema.names
        for (name,) in table.column(VIEW).to_pylist()
    )
    assert (views["infrared left"], views["depth"], views["points"]) == (2, 1, 2)
    assert "colour" not in views


def test_frames_without_images_have_no_entities(small_set: Path):
    for scene in ("a", "b"):
        (small_set / scene / "0" / "depth.png").unlink()
        (small_set / scene / "0" / "ir_right.png").unlink()
    rows = recorded(small_set)
    for name in ("right/infrared", "left/depth", "points"):
        assert f"/kitchen/camera/{name}" not in rows


def test_the_verb_writes_a_recording(
    small_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "set.rrd"
    command = ["show", str(small_set), "--rerun", str(out)]
    assert command_line.main([*command, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"out": str(out), "frames": 2}
    assert "/kitchen/camera/points" in read(out)
    assert command_line.main(command) == 1
    assert "out must not exist" in capsys.readouterr().err
    assert command_line.main([*command, "--force"]) == 0


def test_other_files_are_refused(small_set: Path, tmp_path: Path):
    with pytest.raises(InputError, match=r"rerun must be NAME\.rrd; got .*\.png"):
        rerun_recording.write(str(small_set), tmp_path / "set.png")
    with pytest.raises(InputError, match="out must lie outside its input"):
        rerun_recording.write(str(small_set), small_set / "a.rrd")


def test_a_full_disk_is_refused(
    small_set: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise RuntimeError("File-writer thread shut down prematurely")

    monkeypatch.setattr(rerun.RecordingStream, "flush", fail)
    with pytest.raises(InputError, match=r"rerun must be writable; got .*Free some space"):
        rerun_recording.write(str(small_set), tmp_path / "set.rrd")
    assert not list(tmp_path.glob("*rrd*"))


def test_a_file_that_cannot_be_made_is_refused(
    small_set: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise RuntimeError("Failed to create file: No such file or directory")

    monkeypatch.setattr(rerun.RecordingStream, "save", fail)
    with pytest.raises(InputError, match=r"rerun must be writable; got .*Choose another place"):
        rerun_recording.write(str(small_set), tmp_path / "set.rrd")


def test_the_extra_is_named_where_it_is_missing(small_set: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match=r"rerun needs rerun-sdk; got none\..*\[rerun\]"):
        rerun_recording.write(str(small_set), small_set.parent / "set.rrd")
