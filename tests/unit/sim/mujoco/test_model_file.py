"""MJCF and URDF files: recognised by their first element, and loaded in one state."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from starling.patterns import InputError
from starling.sim.mujoco import model_file
from tests.unit.sim.mujoco.small_model import write

URDF = """<?xml version="1.0"?><!-- one link --><robot name="arm"><link name="base"><visual>
<geometry><box size=".1 .2 .3"/></geometry></visual><collision><geometry><box size=".1 .2 .3"/>
</geometry></collision></link></robot>"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write(tmp_path)


def test_files_are_recognised_by_their_first_element(tmp_path: Path):
    texts = {
        "mujoco.xml": "<!-- a --> <mujoco model='a'>",
        "robot.urdf": URDF,
        "empty.mjcf": "<mujoco/>",
        "mitsuba.xml": "<scene version='3.0.0'/>",
        "blank.xml": "  ",
        "cut.xml": "<!-- <mujoco>",
        "bare.xml": "<",
        "nameless.xml": "< >",
        "closed.xml": "</>",
        "declared.xml": "<!DOCTYPE mujoco><?mujoco ?><!-- <mujoco> --><mujoco\n>",
        "mujoco.txt": "<mujoco/>",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    known = {name for name in texts if model_file.is_model(tmp_path / name)}
    assert known == {"mujoco.xml", "robot.urdf", "empty.mjcf", "declared.xml"}
    assert not model_file.is_model(tmp_path / "missing.xml")


def test_a_keyframe_or_positions_set_the_state(path: Path, tmp_path: Path):
    def height(**state: object) -> float:
        scene = model_file.load(path, camera="top", **state)
        (ball,) = (body for body in scene.bodies if body.name.startswith("ball"))
        return float(ball.world_from_body[2, 3])

    assert height() == pytest.approx(0.2)
    assert height(keyframe="lifted") == pytest.approx(0.4)
    positions = np.array([0, 0, 0.7, 1, 0, 0, 0])
    np.save(tmp_path / "q.npy", positions)
    np.savetxt(tmp_path / "q.txt", positions)
    assert height(qpos=tmp_path / "q.npy") == height(qpos=tmp_path / "q.txt")
    assert height(qpos=tmp_path / "q.npy") == pytest.approx(0.7)


def test_states_that_do_not_fit_are_refused(path: Path, tmp_path: Path):
    np.save(tmp_path / "short.npy", np.zeros(3))
    np.save(tmp_path / "nan.npy", np.full(7, np.nan))
    (tmp_path / "words.txt").write_text("a b c")
    (tmp_path / "empty.npy").touch()
    for state, message in (
        ({"keyframe": "home"}, "keyframe must be a known name; got 'home'. Known: lifted"),
        ({"qpos": tmp_path / "short.npy"}, r"qpos must be \(7,\) finite numbers"),
        ({"qpos": tmp_path / "nan.npy"}, r"qpos must be \(7,\) finite numbers"),
        ({"qpos": tmp_path / "words.txt"}, "qpos must be .npy or text"),
        ({"qpos": tmp_path / "empty.npy"}, "qpos must be .npy or text"),
        ({"qpos": tmp_path / "missing.npy"}, "qpos must be .npy or text"),
        ({"qpos": tmp_path / "short.npy", "keyframe": "lifted"}, "must not be given with keyframe"),
    ):
        with pytest.raises(InputError, match=message):
            model_file.load(path, **state)


def test_a_robot_of_ros_loads(tmp_path: Path):
    (tmp_path / "arm.urdf").write_text(URDF)
    scene = model_file.load(tmp_path / "arm.urdf")
    low, high = (bound(scene.bodies[0].mesh.vertices, axis=0) for bound in (np.min, np.max))
    np.testing.assert_allclose(high - low, [0.1, 0.2, 0.3], rtol=1e-6)
    with pytest.raises(InputError, match=r"keyframe must be in the model; got home. It has none"):
        model_file.load(tmp_path / "arm.urdf", keyframe="home")


def test_missing_files_are_named(path: Path, tmp_path: Path):
    (tmp_path / "sheet.obj").unlink()
    with pytest.raises(InputError, match=r"scene must load in MuJoCo; .*sheet.obj"):
        model_file.load(path)
    with pytest.raises(InputError, match="must be a file that exists"):
        model_file.load(tmp_path / "arm.xml")


def test_a_model_without_geoms_is_refused(tmp_path: Path):
    (tmp_path / "bare.xml").write_text("<mujoco/>")
    with pytest.raises(InputError, match=r"model must have geoms; got none\. Are its meshes there"):
        model_file.load(tmp_path / "bare.xml")
