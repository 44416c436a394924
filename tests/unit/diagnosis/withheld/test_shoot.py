"""Captures of a case: complete, readable as captures, and silent about the case."""

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
from starling.diagnosis.validation.protocol.shoot import post, shoot
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


def test_a_set_is_written(light_set: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert shoot(light_set, NULL, out, frames=2) == ("a", "b")
    captures = capture.open_set(out)
    assert [scene.name for scene in captures.scenes] == ["a", "b"]
    assert captures.scenes[0].room == "kitchen"
    frame = captures.scenes[0].frame(1)
    assert frame.ir_left is not None and frame.ir_left.dtype == np.uint8
    before = captures.scenes[0].frame(0).ir_left
    assert before is not None and not np.array_equal(frame.ir_left, before)


def test_the_same_case_gives_the_same_bytes(light_set: Path, tmp_path: Path) -> None:
    case = _case(dropped_dots=0.3)
    shoot(light_set, case, tmp_path / "one")
    shoot(light_set, case, tmp_path / "two")
    assert _files(tmp_path / "one") == _files(tmp_path / "two")


def test_nothing_tells_the_case(light_set: Path, tmp_path: Path) -> None:
    """Expected behaviour: two cases differ in their images alone, and in nothing but pixels."""
    shoot(light_set, NULL, tmp_path / "null")
    shoot(light_set, _case(vertical_offset=1.2), tmp_path / "case")
    one, other = _files(tmp_path / "null"), _files(tmp_path / "case")
    assert set(one) == set(other)
    assert {Path(name).name for name in one} == {
        "capture.toml",
        "room",
        "ir_left.png",
        "ir_right.png",
    }
    for name, content in other.items():
        if not name.endswith(".png"):
            assert content == one[name]
            continue
        chunks = _chunks(content)
        assert set(chunks) <= {"IHDR", "IDAT", "IEND"}
        assert b"vertical" not in content


def _chunks(png: bytes) -> list[str]:
    at, names = 8, []
    while at < len(png):
        names.append(png[at + 4 : at + 8].decode())
        at += 12 + int.from_bytes(png[at : at + 4], "big")
    return names


def test_more_bits_are_kept_in_sixteen(light_set: Path, tmp_path: Path) -> None:
    shoot(light_set, _case(quantisation=10), tmp_path / "out")
    image = cv2.imread(str(tmp_path / "out/a/0/ir_left.png"), cv2.IMREAD_UNCHANGED)
    assert image is not None and image.dtype == np.uint16
    assert 255 < image.max() <= 1023


def test_refused_shots(light_set: Path, tmp_path: Path) -> None:
    with pytest.raises(WithheldError, match="frames must be >= 1; got 0"):
        shoot(light_set, NULL, tmp_path / "out", frames=0)
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
    """A capture set of two frames a scene, matched by somebody."""
    out = tmp_path / "matched"
    shoot(light_set, NULL, out, frames=2)
    rng = np.random.default_rng(0)
    for scene in "ab":
        for frame in "01":
            code = (1000 + rng.integers(-5, 6, (64, 96))).astype(np.uint16)
            code[10:20, 30:40] = 0
            cv2.imwrite(str(out / scene / frame / "depth.png"), code)
    return out


def test_effects_on_depth_read_and_write_codes(matched: Path, camera: Nominal) -> None:
    before = _files(matched)
    post(matched, NULL, camera)
    assert _files(matched) == before
    post(matched, _case(range=1.0), camera)
    after = _files(matched)
    changed = {name for name in before if after[name] != before[name]}
    assert changed == {f"{scene}/{frame}/depth.png" for scene in "ab" for frame in "01"}
    code = cv2.imread(str(matched / "a/0/depth.png"), cv2.IMREAD_UNCHANGED)
    was = cv2.imdecode(np.frombuffer(before["a/0/depth.png"], np.uint8), cv2.IMREAD_UNCHANGED)
    assert code is not None and was is not None and code.dtype == np.uint16
    np.testing.assert_array_equal(code, np.where(was < 1000, 0, was))


def test_frames_without_depth_are_left_alone(matched: Path, camera: Nominal) -> None:
    for frame in "01":
        os.remove(matched / "b" / frame / "depth.png")
    post(matched, _case(hole_filling=1), camera)
    assert not (matched / "b/0/depth.png").exists()
    code = cv2.imread(str(matched / "a/0/depth.png"), cv2.IMREAD_UNCHANGED)
    assert code is not None and (code > 0).all()


def test_noise_is_of_the_case_and_of_the_scene(light_set: Path, tmp_path: Path) -> None:
    shoot(light_set, NULL, tmp_path / "one")
    shoot(light_set, dataclasses.replace(NULL, seed=12), tmp_path / "two")
    one, other = _files(tmp_path / "one"), _files(tmp_path / "two")
    assert one["a/0/ir_left.png"] != one["b/0/ir_left.png"]  # Of the same light.
    assert one["a/0/ir_left.png"] != other["a/0/ir_left.png"]


@pytest.mark.parametrize(("name", "value"), [("dropped_dots", 0.3), ("shifted_dots", 6.0)])
def test_dots_are_there_for_what_acts_on_them(
    name: str, value: float, light_set: Path, tmp_path: Path
) -> None:
    shoot(light_set, NULL, tmp_path / "one")
    shoot(light_set, _case(**{name: value}), tmp_path / "two")
    one, other = _files(tmp_path / "one"), _files(tmp_path / "two")
    assert one["a/0/ir_left.png"] != other["a/0/ir_left.png"]
