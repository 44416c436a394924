"""Jobs for Cycles and re-rendered light folders, with a script in place of Blender."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from starling.diagnosis.validation.adapters import __main__ as adapters
from starling.diagnosis.validation.adapters import cameras, cycles_light
from starling.diagnosis.validation.adapters.light_sets import OTHER_M
from starling.diagnosis.validation.camera import light
from starling.diagnosis.validation.camera import nominal as nominal_file
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.patterns.errors import InputError
from starling.sim.captures import info as capture_info
from starling.sim.captures import writer
from starling.sim.effects import setting
from starling.sim.geometry import frames
from starling.sim.scene import scene_file
from starling.sim.scene.builtin import scenes
from starling.sim.scene.captured import known_geometry
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

# Replaces Blender: renders a wall at 1 m, and fails at the second scene if `stop` exists.
STAND_IN = """
import json, pathlib, sys
import numpy as np
if "-c" in sys.argv:
    sys.exit(print("stand-in", file=sys.stderr))
job, out = (pathlib.Path(word) for word in sys.argv[3:5])
table = json.loads((job / "job.json").read_text())
done = pathlib.Path(__file__).with_name("done")
if pathlib.Path(__file__).with_name("stop").exists() and done.exists():
    sys.exit("the lamp went out")
done.write_text(str(table["seed"]))
out.mkdir()
names = [*table["projectors"], "ambient", "geometry"]
for side in table["cameras"]:
    for name in names:
        np.save(out / f"{side}_{name}.npy",
                np.ones((table["height"], table["width"], 3), np.float32))
(out / "rendered.json").write_text("{}")
"""


def sensor() -> Sensor:
    ideal, _ = setting.ideal(presets.load("d435"), scenes.wall(1.0))
    size = [("width", 32), ("height", 32), ("fx_px", 16.0), ("fy_px", 16.0)]
    return with_values(ideal, [*size, ("cx_px", 15.5), ("cy_px", 15.0)])


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Return a light folder of two scenes as `light_sets.write` makes it, without real light."""
    folder, nominal_sensor = tmp_path / "light", sensor()
    info = writer.info_of(nominal_sensor, source="check", licence="none", notes="")
    camera = {**cameras.nominal(nominal_sensor), "ambient_w_m2": 0.1, "ambient_gradient": 0.5}
    for name in ("wall-1", "wall-2"):
        (folder / name).mkdir(parents=True)
        specifier = name.replace("-", ":")
        description = known_geometry.describe(
            specifier, frames.pose((0.1, 0.0, 0.0)), folder / name
        )
        assert description is not None
        (folder / name / "scene.toml").write_text(scene_file.dumps(description))
        (folder / name / "room").write_text(name + "\n")
        (folder / name / "light.npz").write_bytes(b"another's")
    (folder / "capture.toml").write_text(capture_info.dumps(info))
    (folder / "nominal.json").write_text(json.dumps(camera))
    return folder


@pytest.fixture
def blender(tmp_path: Path) -> Path:
    script = tmp_path / "blender" / "stand_in.py"
    script.parent.mkdir()
    script.write_text(STAND_IN)
    program = script.with_name("python")
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{script}" "$@"\n')
    program.chmod(0o755)
    return program


def test_job_matches_the_scene_file(source: Path) -> None:
    camera = nominal_file.read(source / "nominal.json")
    job = cycles_light.build_job(source / "wall-1", camera)
    left, right = job.cameras["left"], job.cameras["right"]
    np.testing.assert_allclose(left[:3, 3], (0.1, 0, 0))
    np.testing.assert_allclose(right[:3, 3], (0.1 + camera.baseline_m, 0, 0))
    assert [body.name for body in job.bodies] == ["wall"]
    assert job.bodies[0].reflectance == 0.65
    own_lamp, other_lamp = job.projectors["own-0"], job.projectors["other-0"]
    np.testing.assert_allclose(own_lamp.world_from_projector[:3, 3], (0.129, 0, 0))
    np.testing.assert_allclose(other_lamp.world_from_projector[:3, 3], (0.1 + OTHER_M, 0, 0))
    assert own_lamp.intensity_w_sr.shape[2] == 2 and other_lamp.intensity_w_sr.shape[2] == 1
    assert own_lamp.half_tangents[0] == pytest.approx(1.0)  # The field is 90 degrees wide.
    assert job.sky.gradient == 0.5
    assert job.centre_px == (15.5, 15.0)


def test_dots_and_even_light_have_equal_power(source: Path) -> None:
    camera = nominal_file.read(source / "nominal.json")
    lamp = cycles_light.build_job(source / "wall-1", camera).projectors["own-0"]
    height, width, _ = lamp.intensity_w_sr.shape
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * lamp.half_tangents[0]
    y = ((np.arange(height) + 0.5) / height * 2 - 1) * lamp.half_tangents[1]
    pixel = 4 * lamp.half_tangents[0] * lamp.half_tangents[1] / (width * height)
    solid = pixel / (1 + x[None, :] ** 2 + y[:, None] ** 2) ** 1.5
    for channel in range(2):
        power = float((lamp.intensity_w_sr[..., channel] * solid).sum())
        assert power == pytest.approx(1.0, rel=1e-4)


def test_stopped_rendering_continues(source: Path, blender: Path, tmp_path: Path):
    out = tmp_path / "out"
    (blender.parent / "stop").touch()
    with pytest.raises(InputError, match="rendering of wall-2 must succeed; got the lamp went"):
        cycles_light.cycles_light(source, out, blender=blender, seed=4)
    assert sorted(path.name for path in out.iterdir() if path.is_dir()) == ["wall-1"]
    assert not list(tmp_path.glob(".out*"))
    before = (out / "wall-1" / "light.npz").stat().st_mtime_ns
    (blender.parent / "stop").unlink()
    cycles_light.cycles_light(source, out, blender=blender, seed=4)
    assert (out / "wall-1" / "light.npz").stat().st_mtime_ns == before
    assert (blender.parent / "done").read_text() == "5"  # Each scene has its own seed.
    camera = nominal_file.read(out / "nominal.json")
    for scene in ("wall-1", "wall-2"):
        written = light.read(out / scene / "light.npz", camera.shape)
        assert (written.left.depth_m == 1).all() and written.right.laser_e.min() > 0
        for name in ("room", "scene.toml"):
            assert (out / scene / name).read_text() == (source / scene / name).read_text()
    assert (out / "capture.toml").read_text() == (source / "capture.toml").read_text()


def test_folder_with_other_settings_is_refused(source: Path, blender: Path, tmp_path: Path):
    out = tmp_path / "out"
    cycles_light.cycles_light(source, out, blender=blender)
    with pytest.raises(InputError, match=r"cycles\.json must be as in the stopped run"):
        cycles_light.cycles_light(source, out, blender=blender, samples=8)
    (out / "nominal.json").write_text("{}")
    with pytest.raises(InputError, match=r"nominal\.json must be as in the stopped run"):
        cycles_light.cycles_light(source, out, blender=blender)
    (out / "nominal.json").unlink()
    with pytest.raises(InputError, match=r"nominal\.json must be readable"):
        cycles_light.cycles_light(source, out, blender=blender)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").touch()
    with pytest.raises(InputError, match="out must be new, empty or of a stopped run"):
        cycles_light.cycles_light(source, tmp_path / "full", blender=blender)


def test_rendering_without_a_record_is_refused(source: Path, blender: Path, tmp_path: Path):
    script = blender.with_name("stand_in.py")
    script.write_text(STAND_IN.replace('(out / "rendered.json")', "pathlib.Path('/dev/null')"))
    with pytest.raises(InputError, match="rendering of wall-1 must finish; got no record"):
        cycles_light.cycles_light(source, tmp_path / "out", blender=blender)


def test_missing_blender_is_reported_in_one_line(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    words = [str(source), str(tmp_path / "out"), "--blender"]
    assert adapters.main(["cycles_light", *words, str(tmp_path / "none")]) == 1
    message = capsys.readouterr().err
    assert message.startswith("blender must be a Python that runs; got ")
    assert "tools/blender.sh" in message and message.count("\n") == 1
    assert adapters.main(["cycles_light", *words, sys.executable]) == 1  # This Python has no bpy.
    assert "No module named 'bpy'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_command_line_makes_a_folder(source: Path, blender: Path, tmp_path: Path):
    out = tmp_path / "out"
    words = [str(source), str(out), "--blender", str(blender), "--samples", "2", "--threads", "1"]
    assert adapters.main(["cycles_light", *words]) == 0
    assert json.loads((out / "cycles.json").read_text()) == {
        "blender": "stand-in",
        "samples": 2,
        "seed": 0,
    }


def test_light_without_scenes_is_refused(source: Path, blender: Path, tmp_path: Path):
    for path in source.glob("*/light.npz"):
        path.unlink()
    with pytest.raises(InputError, match=r"light must hold SCENE/light\.npz"):
        cycles_light.cycles_light(source, tmp_path / "out", blender=blender)


def test_unsupported_scenes_are_refused(source: Path, tmp_path: Path):
    camera = nominal_file.read(source / "nominal.json")
    (source / "wall-1" / "scene.toml").unlink()
    with pytest.raises(InputError, match=r"scene must have a scene\.toml"):
        cycles_light.build_job(source / "wall-1", camera)
    xml = tmp_path / "ball.xml"
    xml.write_text('<scene version="3.0.0"><shape type="sphere"/></scene>')
    seen = known_geometry.describe(str(xml), np.eye(4), source / "wall-2")
    assert seen is not None
    (source / "wall-2" / "scene.toml").write_text(scene_file.dumps(seen))
    with pytest.raises(InputError, match="scene must be bodies of one material each; got 1 shapes"):
        cycles_light.build_job(source / "wall-2", camera)


def test_light_of_another_camera_is_refused(source: Path):
    path = source / "nominal.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "projector_x_m": 0.04}))
    with pytest.raises(InputError, match=r"projector_x_m of nominal\.json must be 0\.029"):
        cycles_light.build_job(source / "wall-1", nominal_file.read(path))


def test_damaged_light_folder(source: Path, blender: Path, tmp_path: Path):
    (source / "nominal.json").write_text("{")
    with pytest.raises(WithheldError, match=r"nominal\.json must be a readable"):
        cycles_light.cycles_light(source, tmp_path / "out", blender=blender)
