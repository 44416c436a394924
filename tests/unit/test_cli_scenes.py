"""`starling simulate` with several scenes: one set, a room for each."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from starling.sim.captures import capture
from tests.unit.command_line import refused, run

Capture = pytest.CaptureFixture[str]
SMALL = (
    "--sensor", "d435", "--set", "width=64", "--set", "height=48", "--set", "cx_px=31.5", "--set",
    "cy_px=23.5",
)  # fmt: skip


def test_several_scenes_make_one_set_with_a_room_each(capsys: Capture, tmp_path: Path) -> None:
    """A scene of several is equal to the scene alone, noise included."""
    both, alone = tmp_path / "both", tmp_path / "alone"
    assert run("simulate", "wall:1", "wall:2", *SMALL, "--out", both, capsys=capsys)[0] == 0
    assert run("simulate", "wall:2", *SMALL, "--out", alone, capsys=capsys)[0] == 0
    scenes = capture.open_set(both).scenes
    assert [(scene.name, scene.room) for scene in scenes] == [
        ("wall-1", "wall-1"),
        ("wall-2", "wall-2"),
    ]
    for name in ("ir_left.png", "depth.png", "frame.json"):
        place = Path("wall-2", "0", name)
        assert (both / place).read_bytes() == (alone / place).read_bytes()
    records = [json.loads((folder / "starling.json").read_text()) for folder in (both, alone)]
    assert [each["arguments"]["scene"] for each in records] == [["wall:1", "wall:2"], "wall:2"]


def test_several_scenes_are_no_captures_and_have_names_of_their_own(
    capsys: Capture, tmp_path: Path, small_set: Path
) -> None:
    out = ("--out", tmp_path / "out")
    message = refused("simulate", "wall", "wall", *SMALL, *out, capsys=capsys)
    assert "scenes must differ in name; got wall, wall" in message
    for scenes in (("wall", small_set), (small_set, "wall")):
        message = refused("simulate", *scenes, "--sensor", "d435", *out, capsys=capsys)
        assert "a capture set must not be one of several scenes" in message


def test_several_depth_images_belong_into_one_folder(capsys: Capture, tmp_path: Path) -> None:
    path = tmp_path / "d.npy"
    np.save(path, np.ones((48, 64), np.float32))
    camera = ("--sensor", "d435", "--camera-matrix", 60, 60, 31.5, 23.5)
    message = refused("simulate", path, path, *camera, "--out", tmp_path / "out", capsys=capsys)
    assert "scene must be one file or folder of depth images; got 2" in message
