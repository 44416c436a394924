"""Real pairs as a source of captures; the pairs here are synthetic."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.protocol import files, programs, seal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.real_pairs import RealPairs, draw_scenes
from starling.sim.captures import capture
from starling.sim.sensor import presets
from tests.unit.diagnosis.validation.conftest import CAPTURE, HEIGHT, TABLE, WIDTH

ROOMS = ("a", "a", "a", "b", "b", "c", "d")


@pytest.fixture
def captures(tmp_path: Path) -> Path:
    folder, rng = tmp_path / "real", np.random.default_rng(3)
    for number, room in enumerate(ROOMS):
        frame = folder / f"s{number}" / "0"
        for name in ("ir_left.png", "ir_right.png"):
            image = rng.integers(20, 90, (HEIGHT, WIDTH)).astype(np.uint8)
            files.write_image(frame / name, image)
        files.write_image(frame / "depth.png", np.full((HEIGHT, WIDTH), 900, np.uint16))
        files.write_image(frame.parent / "truth.png", np.full((HEIGHT, WIDTH), 900, np.uint16))
        (frame.parent / "room").write_text(room)
    (folder / "capture.toml").write_text(CAPTURE)
    return folder


@pytest.fixture
def pairs(captures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RealPairs:
    def camera(_: str, out: Path, **__: object) -> None:
        out.mkdir(parents=True)
        existing = ["vignetting", "read_noise", "gamma"]
        (out / "nominal.json").write_text(json.dumps({**TABLE, "has": existing}))

    monkeypatch.setattr(programs, "run", camera)
    folder = tmp_path / "set-0"
    return RealPairs(folder=folder, number=0, scenes=4, captures=captures, believed="any")


def test_no_room_repeats_before_all_rooms_are_drawn(captures: Path) -> None:
    scenes = capture.open_set(captures).scenes
    drawn = [draw_scenes(scenes, 4, number) for number in range(6)]
    names = [[scene.name for scene in selection] for selection in drawn]
    assert all({scene.room for scene in selection} == {*"abcd"} for selection in drawn)
    assert len({tuple(selection) for selection in names}) > 2
    assert [scene.name for scene in draw_scenes(scenes, 4, 2)] == names[2]
    assert sorted(scene.room for scene in draw_scenes(scenes, 6, 0)) == [*"aabbcd"]
    with pytest.raises(WithheldError, match="captures must hold 8 scenes; got 7"):
        draw_scenes(scenes, 8, 0)


def test_the_mode_of_the_camera_reaches_its_sensor_file(captures: Path, tmp_path: Path) -> None:
    """Its image size is that of the captures; another one is refused."""
    size, base = f"{WIDTH}x{HEIGHT}", "d415"
    text = f'base = "{base}"\n[modes."{size}"]\nscale = 0.1\nleft.gain = 2.0\n'
    (tmp_path / "mine.toml").write_text(text)
    pairs = RealPairs(
        folder=tmp_path / "set-0",
        number=0,
        scenes=4,
        captures=captures,
        believed=str(tmp_path / "mine.toml"),
        mode=size,
    )
    pairs.prepare()
    assert presets.load(str(pairs.sensor)).left.gain == 2.0
    assert json.loads((pairs.folder / seal.INPUTS).read_text())["mode"] == size
    other = dataclasses.replace(pairs, folder=tmp_path / "set-1", mode="640x480")
    with pytest.raises(WithheldError):
        other.prepare()


def test_missing_captures_are_refused(pairs: RealPairs, tmp_path: Path) -> None:
    pairs.prepare()
    missing = dataclasses.replace(pairs, captures=tmp_path / "gone")
    with pytest.raises(WithheldError, match="gone"):
        missing.write_captures([Case(number=0, kind="null", seed=0)], tmp_path / "cases")


def test_cases_hold_infrared_only_and_do_not_reveal_the_effect(
    pairs: RealPairs, tmp_path: Path
) -> None:
    pairs.prepare()
    pairs.write_captures(
        [Case(number=7, kind="single", settings={"black_level": 14.0}, seed=5)], tmp_path
    )
    case, reference = (capture.open_set(path) for path in (tmp_path / "007", pairs.against))
    assert [scene.name for scene in case.scenes] == [scene.name for scene in reference.scenes]
    for scene, reference_scene in zip(case.scenes, reference.scenes, strict=True):
        names = sorted(path.name for path in scene.path.rglob("*"))
        assert names == ["0", "ir_left.png", "ir_right.png", "room", "truth.png"]
        lifted, plain = scene.frame(0).ir_left, reference_scene.frame(0).ir_left
        assert lifted is not None and plain is not None
        assert lifted.mean() - plain.mean() == pytest.approx(10, abs=0.3)


def test_a_null_case_differs_by_noise(pairs: RealPairs, tmp_path: Path) -> None:
    pairs.prepare()
    pairs.write_captures([Case(number=1, kind="null", seed=5)], tmp_path)
    image, reference = (
        capture.open_set(path).scenes[0].frame(0).ir_right
        for path in (tmp_path / "001", pairs.against)
    )
    assert image is not None and reference is not None
    difference = image.astype(float) - reference
    assert abs(difference.mean()) < 0.1 and 1 < difference.std() < 3


def test_existing_effects_are_drawn_only_if_their_strength_is_known(pairs: RealPairs) -> None:
    pairs.prepare()
    assert {"read_noise", "veil"} <= pairs.effects
    assert not {"vignetting", "gamma", "ambient", "body_offset"} & pairs.effects
    assert pairs.upwards == {"lens_blur", "read_noise", "smoothing"}
    assert {"gain", "black_level"} <= pairs.effects
    path = pairs.folder / "camera" / "nominal.json"
    table = json.loads(path.read_text())
    path.write_text(json.dumps({**table, "has": [*table["has"], "auto_exposure"]}))
    assert not {"gain", "black_level"} & pairs.effects  # Automatic exposure compensates them.


def test_scenes_without_a_pair_are_refused(pairs: RealPairs, captures: Path) -> None:
    for path in captures.glob("*/0/ir_right.png"):
        path.unlink()
    with pytest.raises(WithheldError, match="must hold an infrared pair"):
        pairs.prepare()
    for path in captures.glob("*/0/ir_left.png"):
        path.write_bytes(b"no picture")
    with pytest.raises(WithheldError, match="ir_left"):
        pairs.prepare()
    assert not pairs.against.exists()
