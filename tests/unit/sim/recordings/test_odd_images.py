"""Folders with images of wrong types and odd names, and flags that do not fit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.captures import capture, png
from starling.sim.captures.recordings.import_recording import import_recording
from starling.sim.captures.recordings.statement import GivenFacts
from tests.unit.sim.recordings import scene

STREAMS = {"left": "ir1_*", "right": "ir2_*"}
DEPTH = round(1e3 * scene.DEPTH_M)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of two pairs, and its calibration."""
    path = tmp_path / "shots"
    path.mkdir()
    scene.write_frames(path, 2)
    (tmp_path / "cal.txt").write_text(scene.LISTING)
    return path


def imported(folder: Path, streams: dict[str, str], camera: str = "", **facts: Any) -> Any:
    """Import the folder."""
    known = {"depth_unit": "mm", "emitter": "on", "sensor": "d435", **facts}
    flags = GivenFacts(calibration=(folder.parent / "cal.txt",), **known)
    out = folder.parent / "set"
    return import_recording(folder, out, streams=streams, flags=flags, camera=camera, force=True)


def _save(folder: Path, name: str, images: list[np.ndarray]) -> dict[str, str]:
    for number, image in enumerate(images):
        np.save(folder / f"{name}_{number}.npy", image)
    return {**STREAMS, name: f"{name}_*"}


def test_depth_beyond_16_bits_is_refused_in_any_frame(folder: Path):
    images = [np.full(scene.pair()[0].shape, DEPTH + wide, np.int32) for wide in (0, 2**16)]
    with pytest.raises(
        InputError, match=f"depth must be at most 65535, 16 bits; got {DEPTH + 2**16}"
    ):
        imported(folder, _save(folder, "depth", images))


def test_depth_of_two_channels_is_refused(folder: Path):
    images = [np.zeros((*scene.pair()[0].shape, 2), np.uint16)] * 2
    with pytest.raises(InputError, match="depth of frame 0 must be grey"):
        imported(folder, _save(folder, "depth", images))


@pytest.mark.parametrize("kind", [np.float32, np.int32])
def test_colours_that_are_no_codes_are_refused(folder: Path, kind: type):
    images = [np.ones((*scene.pair()[0].shape, 3), kind)] * 2
    with pytest.raises(InputError, match=r"colour of frame 0 must be of 8 or 16 bits; got"):
        imported(folder, _save(folder, "colour", images))


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"baseline_m": 0.0}, "--baseline must be > 0; got 0"),
        ({"depth_unit": "cm"}, "--depth-unit must be m, mm or a step in metres; got 'cm'"),
        ({"camera": "240 240 159 119 320 240"}, "--camera must be given with a TUM sequence"),
    ],
)
def test_facts_that_do_not_fit_are_refused(folder: Path, facts: dict[str, Any], message: str):
    depth = _save(folder, "depth", [np.full(scene.pair()[0].shape, DEPTH, np.uint16)] * 2)
    with pytest.raises(InputError, match=message):
        imported(folder, depth, **facts)


def test_a_pattern_that_is_too_long_is_refused(folder: Path):
    with pytest.raises(
        InputError, match=r"--left must be a pattern of file names; got aaa.*too long"
    ):
        imported(folder, {"left": "a" * 300})


@pytest.mark.parametrize("number", ["", "_0"])
def test_images_without_dots_are_no_frames_of_usual_names(folder: Path, number: str):
    for file in folder.iterdir():
        file.unlink()
    for side, image in zip(("left", "right"), scene.pair(), strict=True):
        (folder / f"ir_{side}{number}.png").write_bytes(png.encode(image))
        (folder / f"ir_{side}_off{number}.png").write_bytes(png.encode(image // 3))
    assert imported(folder, {})["frames"] == 1
    frame = capture.open_set(folder.parent / "set").scenes[0].frame(0)
    np.testing.assert_array_equal(frame.ir_left, scene.pair()[0])
