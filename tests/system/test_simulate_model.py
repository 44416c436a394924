"""`simulate` of MuJoCo models: cameras, states, and geometry that a set describes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import starling
from starling import command_line
from starling.patterns import InputError
from starling.sim.captures import capture
from starling.sim.scene import scene_file
from starling.sim.scene.captured import known_geometry
from tests.unit.sim.mujoco.small_model import write

pytest.importorskip("mujoco", reason="the package mujoco is not installed")

SIZE = ("width=96", "height=72", "fx_px=60", "fy_px=60", "cx_px=47.5", "cy_px=35.5")


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return write(tmp_path)


def simulate(scene: Path, out: Path, *flags: object) -> int:
    edits = [flag for edit in SIZE for flag in ("--set", edit)]
    words = ["simulate", scene, "--sensor", "d435", "--out", out, *flags, *edits]
    return command_line.main(list(map(str, words)))


def truth_m(out: Path) -> np.ndarray:
    (scene,) = capture.open_set(out).scenes
    truth = scene.truth_m()
    assert truth is not None
    return truth


def test_a_model_is_seen_by_its_camera_in_its_state(model: Path, tmp_path: Path):
    assert simulate(model, tmp_path / "home", "--camera", "top") == 0
    assert simulate(model, tmp_path / "up", "--camera", "top", "--keyframe", "lifted") == 0
    np.save(tmp_path / "q.npy", np.array([-0.35, 0.3, 0.4, 1, 0, 0, 0]))
    assert simulate(model, tmp_path / "q", "--camera", "top", "--qpos", tmp_path / "q.npy") == 0
    home, up, placed = (truth_m(tmp_path / name) for name in ("home", "up", "q"))
    assert (home != up).any()
    np.testing.assert_array_equal(up, placed)


@pytest.mark.slow
def test_a_set_describes_the_model_and_its_state(model: Path, tmp_path: Path):
    """So that captures of it can be calibrated and diagnosed."""
    np.save(tmp_path / "q.npy", np.array([-0.35, 0.3, 0.4, 1, 0, 0, 0]))
    states = {"a": ("--keyframe", "lifted"), "b": ("--qpos", tmp_path / "q.npy")}
    for name, state in states.items():
        assert simulate(model, tmp_path / name, "--camera", "top", *state) == 0
        known = scene_file.read(tmp_path / name / "bench" / "scene.toml")
        assert known.scene.endswith("bench.xml") and known.camera is None
        (captured,) = capture.open_set(tmp_path / name).scenes
        loaded = known_geometry.load(captured, starling.load_sensor("d435"))
        assert loaded is not None
        (ball,) = (body for body in loaded.bodies if body.name.startswith("ball"))
        np.testing.assert_allclose(ball.world_from_body[:3, 3], [-0.35, 0.3, 0.4])
        np.testing.assert_allclose(loaded.world_from_left[:3, 3], [0.1, -0.6, 1.2], atol=1e-9)


@pytest.mark.slow
def test_a_toml_gives_camera_and_state(model: Path, tmp_path: Path):
    text = 'scene = "bench.xml"\ncamera = "top"\nkeyframe = "lifted"\n'
    (tmp_path / "lifted.toml").write_text(text)
    assert simulate(tmp_path / "lifted.toml", tmp_path / "out") == 0
    assert simulate(model, tmp_path / "up", "--camera", "top", "--keyframe", "lifted") == 0
    np.testing.assert_array_equal(truth_m(tmp_path / "out"), truth_m(tmp_path / "up"))
    (tmp_path / "bare.toml").write_text('scene = "bench.xml"\n')
    look = ("--look-at", 0.1, -0.6, 1.2, 0, 0, 0)
    assert simulate(tmp_path / "bare.toml", tmp_path / "seen", *look) == 0


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ((), "camera must be given; got nothing. Cameras of"),
        (("--camera", "tip"), "camera must be a known name; got 'tip'"),
        (("--camera", "top", "--keyframe", "home"), "keyframe must be a known name; got 'home'"),
        (("--camera", "top", "--up", "z"), "up must be given with a mesh file"),
    ],
)
def test_odd_flags_are_refused(
    model: Path, tmp_path: Path, capsys: Any, flags: tuple[str, ...], message: str
):
    assert simulate(model, tmp_path / "out", *flags) == 1
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_flags_of_models_are_refused_with_other_scenes(tmp_path: Path, capsys: Any):
    assert simulate(Path("wall"), tmp_path / "out", "--camera", "top") == 1
    assert "camera must be given with a model of MuJoCo or a URDF" in capsys.readouterr().err


def test_models_load_from_python(model: Path):
    scene = starling.load_scene(model, starling.load_sensor("d435"), camera="top")
    assert scene.name == "mujoco top"
    with pytest.raises(InputError, match="camera must be given"):
        starling.load_scene(model, starling.load_sensor("d435"))
