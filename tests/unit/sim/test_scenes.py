"""Scenes by word: builtin names, meshes, Mitsuba XML; and every refusal on the way."""

import numpy as np
import pytest
import trimesh

from patterns import InputError
from sim import frames, render, scenes, sensors, stage
from sim.scene import Ambient, Body, Material, Mesh, Scene
from sim.scenes import builtin, mesh_file, solids

SENSOR = sensors.load("d435")
GREY = Material(name="grey")

XML = """<scene version="3.0.0">
  <sensor type="perspective"><transform name="to_world">
    <lookat origin="0, 0, -2" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
  <shape type="sphere"><float name="radius" value="0.5"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf></shape>
</scene>"""


@pytest.mark.parametrize("word", ["wall", "wall:0.7", "staircase", "tabletop:3", "clutter:1"])
def test_builtin_scenes_are_what_their_word_says(word):
    scene = scenes.load(word, SENSOR)
    assert scene.bodies
    again = scenes.load(word, SENSOR)
    for one, other in zip(scene.bodies, again.bodies, strict=True):
        assert np.array_equal(one.mesh.vertices, other.mesh.vertices)


def test_seeds_make_different_scenes():
    first, second = (builtin.clutter(seed) for seed in (0, 1))
    assert not np.array_equal(first.bodies[3].mesh.vertices, second.bodies[3].mesh.vertices)


def test_clutter_holds_every_kind_of_surface():
    bodies = builtin.clutter().bodies
    assert {body.material.kind for body in bodies} == {"diffuse", "glossy", "metal"}
    assert min(body.material.reflectance for body in bodies) < 0.05
    assert any(body.name.startswith("stems") for body in bodies)


def test_staircase_stands_at_its_depths():
    truth = render.layers(stage.Stage(builtin.staircase(0.8)), SENSOR).truth
    depths = np.unique(np.round(truth.depth_m[SENSOR.height // 2], 4))
    expected = 0.8 * 1.25 ** np.arange(9)
    assert all(np.abs(expected - depth).min() < 1e-3 for depth in depths)
    assert len(depths) >= 8


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("clutte", "scene must be a known name; got 'clutte'. Known: clutter"),
        ("wall:far", "scene must be wall:NUMBER"),
        ("wall:-1", "distance in metres must be in"),
        ("clutter:-1", "seed must be in"),
        ("nowhere/mesh.ply", "scene must be a file that exists"),
        ("nowhere/scene.xml", "scene must be a file that exists"),
        ("nowhere/thing.step", "scene must be a builtin name, a mesh, a Mitsuba XML or a capture"),
    ],
)
def test_unknown_words(word, message):
    with pytest.raises(InputError, match=message):
        scenes.load(word, SENSOR)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb"])
def test_a_mesh_is_seen_whole_and_centred(tmp_path, suffix):
    path = tmp_path / f"ball{suffix}"
    trimesh.creation.icosphere(3, 0.2).apply_translation([1.0, 2.0, 3.0]).export(path)
    scene = scenes.load(str(path), SENSOR)
    truth = render.layers(stage.Stage(scene), SENSOR).truth
    rows, columns = np.nonzero(truth.material)
    assert rows.min() > 0 and rows.max() < SENSOR.height - 1
    assert columns.min() > 0 and columns.max() < SENSOR.width - 1
    assert columns.mean() == pytest.approx(SENSOR.cx_px, abs=2)
    assert np.isfinite(truth.depth_m[rows, columns]).all()


def test_meshes_stand_upright(tmp_path):
    """y is up in the file, so the end with the ball on it is at the top of the image."""
    stick = trimesh.creation.box((0.02, 1.0, 0.02))
    ball = trimesh.creation.icosphere(3, 0.2).apply_translation([0.0, 0.5, 0.0])
    trimesh.util.concatenate([stick, ball]).export(tmp_path / "pin.ply")
    scene = scenes.load(str(tmp_path / "pin.ply"), SENSOR)
    seen = render.layers(stage.Stage(scene), SENSOR).truth.material > 0
    rows = np.nonzero(seen)[0]
    middle = (rows.min() + rows.max()) // 2
    assert seen[:middle].sum() > 3 * seen[middle:].sum()


def test_refused_meshes(tmp_path):
    (tmp_path / "empty.ply").write_bytes(b"")
    (tmp_path / "text.glb").write_text("no mesh at all")
    trimesh.PointCloud([[0, 0, 0], [1, 0, 0]]).export(tmp_path / "points.ply")
    trimesh.creation.box((300.0, 200.0, 100.0)).export(tmp_path / "millimetres.ply")
    trimesh.Trimesh([[1.0, 1, 1]] * 3, [[0, 1, 2]], process=False).export(tmp_path / "point.obj")
    for name, message in {
        "empty.ply": "scene must be a mesh",
        "text.glb": "scene must be a mesh",
        "points.ply": "scene must hold triangles",
        "millimetres.ply": "mesh extent must be at most 100 m; got 300 m .*millimetres",
        "point.obj": "mesh extent must be > 0",
    }.items():
        with pytest.raises(InputError, match=message) as caught:
            scenes.load(str(tmp_path / name), SENSOR)
        assert "\n" not in str(caught.value)


def test_the_camera_may_not_stand_inside_a_body(tmp_path):
    path = tmp_path / "box.ply"
    trimesh.creation.box((1.0, 1.0, 1.0)).export(path)
    with pytest.raises(InputError, match="camera must stand outside every body"):
        mesh_file.load(path, SENSOR, frames.pose((0.1, 0.2, 0.0)))
    room = trimesh.creation.box((3.0, 3.0, 3.0))
    room.invert()
    room.export(path)
    assert mesh_file.load(path, SENSOR, frames.pose((0.1, 0.2, 0.0))).bodies


def test_winding_number():
    ball = solids.body("ball", solids.sphere(1.0), GREY)
    assert mesh_file.winding_number(ball, np.zeros(3)) == pytest.approx(1.0, abs=1e-6)
    assert mesh_file.winding_number(ball, np.array([2.0, 0, 0])) == pytest.approx(0.0, abs=1e-6)


def test_a_mitsuba_xml_is_seen_by_its_own_sensor(tmp_path):
    (tmp_path / "ball.xml").write_text(XML)
    scene = scenes.load(str(tmp_path / "ball.xml"), SENSOR)
    layers = render.layers(stage.Stage(scene), SENSOR)
    row, column = round(SENSOR.cy_px), round(SENSOR.cx_px)
    assert layers.truth.depth_m[row, column] == pytest.approx(1.5, abs=1e-3)
    assert layers.left.ambient[row, column] > 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<scene", "scene must be a Mitsuba XML"),
        ('<scene version="3.0.0"></scene>', "scene must hold shapes"),
    ],
)
def test_refused_xml(tmp_path, text, message):
    (tmp_path / "scene.xml").write_text(text)
    with pytest.raises(InputError, match=message):
        scenes.load(str(tmp_path / "scene.xml"), SENSOR)


def test_refused_meshes_in_memory():
    corners = np.zeros((3, 3), np.float32)
    face = np.array([[0, 1, 2]], np.uint32)
    with pytest.raises(InputError, match="mesh vertices must be"):
        Mesh(vertices=corners[:0], faces=face)
    with pytest.raises(InputError, match="mesh faces must be"):
        Mesh(vertices=corners, faces=face[:, :2])
    with pytest.raises(InputError, match="mesh faces must index"):
        Mesh(vertices=corners, faces=face + 1)
    with pytest.raises(InputError, match="mesh vertices must be finite"):
        Mesh(vertices=corners * np.nan, faces=face)


def test_refused_scenes():
    with pytest.raises(InputError, match="scene must hold at least one body"):
        Scene(name="void")
    body = Body(
        name="b",
        mesh=Mesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], np.uint32)),
        material=GREY,
    )
    with pytest.raises(InputError, match="shadow_tolerance must be in"):
        Scene(name="s", bodies=(body,), shadow_tolerance=0.5)
    with pytest.raises(InputError, match="irradiance_w_m2 must be in"):
        Ambient(irradiance_w_m2=-1.0)
    with pytest.raises(InputError, match="kind of x must be a known name"):
        Material(name="x", kind="velvet")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="reflectance of x must be in"):
        Material(name="x", reflectance=1.1)
