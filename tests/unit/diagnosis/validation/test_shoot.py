"""Captures of a case: complete, readable, and without a trace of the effects."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.shoot import postprocess, shoot
from starling.sim.captures import capture

NULL = Case(number=3, kind="null", seed=11)


def _case(**settings: float) -> Case:
    return Case(number=3, kind="single", settings=settings, seed=11)


def _files(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_a_capture_set_is_written(light_set: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert shoot(light_set, NULL, out, frames=2) == ("a", "b")
    captures = capture.open_set(out)
    assert [scene.name for scene in captures.scenes] == ["a", "b"]
    assert captures.scenes[0].room == "kitchen"
    frame = captures.scenes[0].frame(1)
    assert frame.ir_left is not None and frame.ir_left.dtype == np.uint8
    first = captures.scenes[0].frame(0).ir_left
    assert first is not None and not np.array_equal(frame.ir_left, first)


def test_the_same_case_gives_the_same_bytes(light_set: Path, tmp_path: Path) -> None:
    case = _case(dropped_dots=0.3)
    shoot(light_set, case, tmp_path / "one")
    shoot(light_set, case, tmp_path / "two")
    assert _files(tmp_path / "one") == _files(tmp_path / "two")


def test_files_do_not_reveal_the_case(light_set: Path, tmp_path: Path) -> None:
    """Expected behaviour: two cases differ only in the pixels of their images."""
    shoot(light_set, NULL, tmp_path / "null")
    shoot(light_set, _case(vertical_offset=1.2), tmp_path / "case")
    null_files, case_files = _files(tmp_path / "null"), _files(tmp_path / "case")
    assert set(null_files) == set(case_files)
    assert {Path(name).name for name in null_files} == {
        "capture.toml",
        "room",
        "ir_left.png",
        "ir_right.png",
    }
    for name, content in case_files.items():
        if not name.endswith(".png"):
            assert content == null_files[name]
            continue
        chunks = _chunks(content)
        assert set(chunks) <= {"IHDR", "IDAT", "IEND"}
        assert b"vertical" not in content


def _chunks(png: bytes) -> list[str]:
    offset, names = 8, []
    while offset < len(png):
        names.append(png[offset + 4 : offset + 8].decode())
        offset += 12 + int.from_bytes(png[offset : offset + 4], "big")
    return names


def test_more_than_8_bits_are_stored_in_16(light_set: Path, tmp_path: Path) -> None:
    shoot(light_set, _case(quantisation=10), tmp_path / "out")
    image = cv2.imread(str(tmp_path / "out/a/0/ir_left.png"), cv2.IMREAD_UNCHANGED)
    assert image is not None and image.dtype == np.uint16
    assert 255 < image.max() <= 1023


def test_invalid_inputs_are_refused(light_set: Path, tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").write_text("")
    with pytest.raises(WithheldError, match="out must be empty"):
        shoot(light_set, NULL, tmp_path / "full")
    for scene in "ab":
        os.remove(light_set / scene / "light.npz")
    with pytest.raises(WithheldError, match="light folder must hold"):
        shoot(light_set, NULL, tmp_path / "out")


@pytest.fixture
def matched(light_set: Path, tmp_path: Path) -> Path:
    """A capture set with two frames per scene and random depth."""
    out = tmp_path / "matched"
    shoot(light_set, NULL, out, frames=2)
    rng = np.random.default_rng(0)
    for scene in "ab":
        for frame in "01":
            code = (1000 + rng.integers(-5, 6, (64, 96))).astype(np.uint16)
            code[10:20, 30:40] = 0
            cv2.imwrite(str(out / scene / frame / "depth.png"), code)
    return out


def test_depth_effects_change_the_codes(matched: Path, camera: Nominal) -> None:
    before = _files(matched)
    postprocess(matched, NULL, camera)
    assert _files(matched) == before
    postprocess(matched, _case(range=1.0), camera)
    after = _files(matched)
    changed = {name for name in before if after[name] != before[name]}
    assert changed == {f"{scene}/{frame}/depth.png" for scene in "ab" for frame in "01"}
    code = cv2.imread(str(matched / "a/0/depth.png"), cv2.IMREAD_UNCHANGED)
    png = np.frombuffer(before["a/0/depth.png"], np.uint8)
    old_code = cv2.imdecode(png, cv2.IMREAD_UNCHANGED)
    assert code is not None and old_code is not None and code.dtype == np.uint16
    np.testing.assert_array_equal(code, np.where(old_code < 1000, 0, old_code))


def test_frames_without_depth_are_skipped(matched: Path, camera: Nominal) -> None:
    for frame in "01":
        os.remove(matched / "b" / frame / "depth.png")
    postprocess(matched, _case(hole_filling=1), camera)
    assert not (matched / "b/0/depth.png").exists()
    code = cv2.imread(str(matched / "a/0/depth.png"), cv2.IMREAD_UNCHANGED)
    assert code is not None and (code > 0).all()


def test_noise_depends_on_the_case_and_the_scene(light_set: Path, tmp_path: Path) -> None:
    shoot(light_set, NULL, tmp_path / "one")
    shoot(light_set, dataclasses.replace(NULL, seed=12), tmp_path / "two")
    first, second = _files(tmp_path / "one"), _files(tmp_path / "two")
    assert first["a/0/ir_left.png"] != first["b/0/ir_left.png"]  # Both scenes have equal light.
    assert first["a/0/ir_left.png"] != second["a/0/ir_left.png"]


@pytest.mark.parametrize(("name", "value"), [("dropped_dots", 0.3), ("shifted_dots", 6.0)])
def test_effects_on_dots_change_the_images(
    name: str, value: float, light_set: Path, tmp_path: Path
) -> None:
    shoot(light_set, NULL, tmp_path / "one")
    shoot(light_set, _case(**{name: value}), tmp_path / "two")
    first, second = _files(tmp_path / "one"), _files(tmp_path / "two")
    assert first["a/0/ir_left.png"] != second["a/0/ir_left.png"]
