"""Captures of known geometry: a simulated set's geometry is stored, loaded and rendered again."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import trimesh

from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene
from starling.sim.commands import match_captures, simulate_captures
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.render import direct, mitsuba_scene
from starling.sim.scene import scene_file, sources
from starling.sim.scene.builtin import scenes
from starling.sim.scene.captured import known_geometry
from starling.sim.sensor import edits, presets
from starling.sim.sensor.sensor import Sensor

SMALL = edits.apply(
    presets.load("d435"),
    ["width=160", "height=120", "cx_px=79.3", "cy_px=60.2", "fx_px=81", "fy_px=82"],
)
XML = """<scene version="3.0.0">
  <sensor type="perspective"><transform name="to_world">
    {}<lookat origin="0.3, 0.2, -1.2" target="0, 0.1, 0" up="0.1, 1, 0"/></transform></sensor>
  <shape type="sphere"><float name="radius" value="0.5"/></shape>
</scene>"""


def _simulated(
    word: Path | str, out: Path, effects: Mapping[str, float] | None = None
) -> CapturedScene:
    simulate_captures.simulate_captures(str(word), SMALL, out, effects=effects)
    (scene,) = capture.open_set(out).scenes
    return scene


def _depth_m(scene: CapturedScene, left_from_true: Pose | None = None) -> np.ndarray:
    """Depth of the known geometry for the set's sensor, optionally from another pose."""
    sensor = presets.load(str(scene.path.parent / "sensor.toml"))
    loaded = known_geometry.load(scene, sensor)
    assert loaded is not None
    pose = loaded.world_from_left @ (np.eye(4) if left_from_true is None else left_from_true)
    moved = dataclasses.replace(loaded, world_from_left=pose)
    return direct.layers(mitsuba_scene.MitsubaScene(moved), sensor).truth.depth_m


def _assert_seen_again(scene: CapturedScene, left_from_true: Pose | None = None) -> None:
    """Equal up to one code step: half for rounding, the remainder for the pose's digits."""
    truth_m = scene.truth_m()
    assert truth_m is not None and np.isfinite(truth_m).mean() > 0.1
    again_m = _depth_m(scene, left_from_true)
    again_m[again_m > 65535 * scene.info.depth_unit_m] = np.nan  # Depth beyond the largest code.
    np.testing.assert_array_equal(np.isfinite(again_m), np.isfinite(truth_m))
    assert np.nanmax(np.abs(again_m - truth_m)) <= scene.info.depth_unit_m


def _box(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    solid = trimesh.creation.box((0.4, 0.3, 0.2))
    solid.apply_transform(frames.pose((1.0, 2.0, 3.0), (10.0, 20.0, 30.0)))
    solid.export(path)
    return path


def test_a_builtin_scene_is_seen_again(tmp_path: Path) -> None:
    scene = _simulated("tabletop:3", tmp_path / "out")
    assert {path.name for path in scene.path.iterdir()} == {"0", "room", "scene.toml", "truth.png"}
    file = scene.known()
    assert file is not None and (file.scene, file.materials) == ("tabletop:3", ())
    np.testing.assert_allclose(
        file.world_from_left, scenes.tabletop(3).world_from_left, rtol=0, atol=1e-15
    )
    _assert_seen_again(scene)


def test_another_pose_gives_another_image(tmp_path: Path) -> None:
    """The comparison above fails for a wrong pose."""
    scene = _simulated("tabletop:3", tmp_path / "out")
    text = (scene.path / "scene.toml").read_text()
    before = _depth_m(scene)
    (scene.path / "scene.toml").write_text(text.replace("tabletop:3", "tabletop:4"))
    assert np.nanmax(np.abs(_depth_m(scene) - before)) > 0.05
    eye = scene_file.dumps(known_geometry.describe("tabletop:3", np.eye(4), scene.path))  # type: ignore[arg-type]
    (scene.path / "scene.toml").write_text(eye)
    assert np.nanmax(np.abs(_depth_m(scene) - before)) > 0.05


def test_mesh_paths_are_relative_within_a_common_folder(tmp_path: Path) -> None:
    mesh = _box(tmp_path / "project" / "meshes" / "box.ply")
    scene = _simulated(mesh, tmp_path / "project" / "sets" / "out")
    file = scene.known()
    assert file is not None and file.scene == "../../../meshes/box.ply"
    _assert_seen_again(scene)
    shutil.move(tmp_path / "project", tmp_path / "elsewhere")
    (moved,) = capture.open_set(tmp_path / "elsewhere" / "sets" / "out").scenes
    _assert_seen_again(moved)


def test_an_xml_is_seen_again(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(XML.format(""))
    scene = _simulated(tmp_path / "ball.xml", tmp_path / "out")
    file = scene.known()
    assert file is not None and file.scene == "../../ball.xml"
    _assert_seen_again(scene)


def test_a_sheared_view_has_no_pose(tmp_path: Path) -> None:
    sheared = np.eye(4)
    sheared[0, 1] = 0.01
    assert known_geometry.describe("wall", sheared, tmp_path) is None


def test_single_precision_poses_become_rigid(tmp_path: Path) -> None:
    pose = frames.pose((0.3, -0.2, 1.5), (20, -30, 40))
    pose[:3, :3] += np.random.default_rng(0).uniform(-3e-6, 3e-6, (3, 3))
    file = known_geometry.describe("wall", pose, tmp_path)
    assert file is not None
    np.testing.assert_allclose(file.world_from_left, pose, atol=6e-6)


def test_effects_are_not_written(tmp_path: Path) -> None:
    """A model error changes only the truth; the file describes the model."""
    effects = {"model_shift.z": 0.01, "nir_reflectance": 0.5, "motion": 0.1}
    moved = _simulated("tabletop:3", tmp_path / "moved", effects=effects)
    model = scenes.tabletop(3).world_from_left
    assert moved.known() == known_geometry.describe("tabletop:3", model, moved.path)
    _assert_seen_again(moved, frames.pose((0.0, 0.0, -0.01)))
    with pytest.raises(AssertionError):
        _assert_seen_again(moved)


def test_captures_are_not_a_known_geometry(small_set: Path, tmp_path: Path) -> None:
    info = capture.open_set(small_set).info
    sensor = info.geometry_into(SMALL)
    simulate_captures.simulate_captures(str(small_set / "a"), sensor, tmp_path / "out")
    (scene,) = capture.open_set(tmp_path / "out").scenes
    assert scene.known() is None and known_geometry.load(scene, sensor) is None


def test_captures_are_simulated_from_their_known_geometry(tmp_path: Path) -> None:
    """The file precedes the reference depth, whose steps and noise would become surfaces."""
    first = _simulated("tabletop:3", tmp_path / "first")
    again = _simulated(first.path, tmp_path / "again")
    np.testing.assert_array_equal(again.truth_m(), first.truth_m())
    assert again.known() == first.known()
    seen = sources.load(str(first.path), SMALL)
    assert {body.name for body in seen.bodies} == {body.name for body in scenes.tabletop(3).bodies}


def test_paths_are_absolute_without_a_common_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = _box(tmp_path / "box.ply")
    file = known_geometry.describe(str(mesh), np.eye(4), Path("/nowhere/set/box"))
    assert file is not None and file.scene == mesh.as_posix()
    monkeypatch.chdir(tmp_path)
    file = known_geometry.describe("box.ply", np.eye(4), tmp_path / "set" / "box")
    assert file is not None and file.scene == "../../box.ply"


def test_links_are_followed_on_the_way_to_a_mesh(tmp_path: Path) -> None:
    """Links in the path are resolved because of `..`; the mesh's name is kept."""
    blob = _box(tmp_path / "store" / "deep" / "1a2b.ply").rename(tmp_path / "store" / "deep" / "1a")
    (tmp_path / "store" / "deep" / "box.ply").symlink_to(blob)
    (tmp_path / "meshes").symlink_to(tmp_path / "store" / "deep")
    folder = tmp_path / "set" / "box"
    folder.mkdir(parents=True)
    file = known_geometry.describe(str(tmp_path / "meshes" / "box.ply"), np.eye(4), folder)
    assert file is not None and file.scene == "../../store/deep/box.ply"
    assert (folder / file.scene).is_file()


def _with_file(small_set: Path, text: str, pose: Pose | None = None) -> CapturedScene:
    rows = np.eye(4) if pose is None else pose
    (small_set / "a" / "scene.toml").write_text(f"left_from_world = {rows.tolist()}\n{text}")
    return capture.open_set(small_set / "a").scenes[0]


def _sensor(scene: CapturedScene) -> Sensor:
    return scene.info.geometry_into(SMALL)


def test_a_users_own_mesh_is_posed(small_set: Path) -> None:
    pose = frames.pose((0.0, 0.1, 0.8), (0.0, 30.0, 0.0))
    _box(small_set / "a" / "box.ply")
    scene = _with_file(small_set, 'scene = "box.ply"', pose)
    loaded = known_geometry.load(scene, _sensor(scene))
    assert loaded is not None and loaded.name == "box"
    np.testing.assert_allclose(loaded.world_from_left @ pose, np.eye(4), atol=1e-12)


def test_matching_copies_the_known_geometry(small_set: Path, tmp_path: Path) -> None:
    """The copy names the same geometry, pose and materials; a scene without a file has none."""
    _box(small_set / "a" / "box.ply")
    pose = frames.pose((0.1, -0.2, -1.0), (3.0, -5.0, 7.0))
    materials = '[[materials]]\nbody = "*"\nreflectance = 0.2\n'
    scene = _with_file(small_set, f'scene = "box.ply"\n{materials}', pose)
    out = tmp_path / "deeper" / "matched"
    out.parent.mkdir()
    match_captures.match_captures(str(small_set), _sensor(scene), out=out)
    carried, without = capture.open_set(out).scenes
    assert without.known() is None
    source, copy = scene.known(), carried.known()
    assert source is not None and copy is not None
    assert copy == dataclasses.replace(source, scene="../../../set/a/box.ply")
    loaded = known_geometry.load(carried, _sensor(carried))
    assert loaded is not None and loaded.bodies[0].material.reflectance == 0.2


def test_matching_copies_a_builtin_name(small_set: Path, tmp_path: Path) -> None:
    scene = _with_file(small_set, 'scene = "tabletop:3"')
    assert known_geometry.for_folder(scene, tmp_path / "x" / "y") == scene.known()


def test_materials_apply_to_matching_bodies(small_set: Path) -> None:
    materials = '[[materials]]\nbody = "*"\nreflectance = 0.2\n'
    materials += '[[materials]]\nbody = "ball *"\nreflectance = 0.7\n'
    scene = _with_file(small_set, f'scene = "tabletop"\n{materials}')
    loaded = known_geometry.load(scene, _sensor(scene))
    assert loaded is not None
    by_name = {body.name: body.material for body in loaded.bodies}
    assert by_name.pop("ball 1").reflectance == 0.7
    assert {material.reflectance for material in by_name.values()} == {0.2}
    assert {material.kind for material in by_name.values()} > {"diffuse", "metal"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('scene = "box.ply"', "scene must be a file that exists; got .*box.ply. Its path starts"),
        (f'scene = "{"x" * 300}.ply"', "scene must be a file that exists"),
        ('scene = "tabletpo"', "scene must be a builtin name, a mesh or a Mitsuba XML; got 'tab"),
        ('scene = "."', "scene must be a builtin name, a mesh or a Mitsuba XML; got '.'"),
        ('scene = "wall:far"', "scene must be wall:NUMBER"),
        (
            'scene = "wall"\n[[materials]]\nbody = "ball"\nreflectance = 0.2',
            "materials.body must name a body; got 'ball'. There are: wall",
        ),
    ],
)
def test_unloadable_geometry_is_refused(small_set: Path, text: str, message: str) -> None:
    scene = _with_file(small_set, text)
    with pytest.raises(InputError, match=message) as caught:
        known_geometry.load(scene, _sensor(scene))
    assert str(small_set / "a" / "scene.toml") in str(caught.value)


def test_shapes_of_an_xml_keep_their_materials(small_set: Path) -> None:
    (small_set / "a" / "ball.xml").write_text(XML.format(""))
    text = 'scene = "ball.xml"\n[[materials]]\nbody = "*"\nreflectance = 0.2'
    scene = _with_file(small_set, text)
    with pytest.raises(InputError, match="There are: none, shapes of an XML keep theirs"):
        known_geometry.load(scene, _sensor(scene))
