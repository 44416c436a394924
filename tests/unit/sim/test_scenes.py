"""Scenes by specifier: builtin names, meshes, Mitsuba XML, and all refusals."""

import dataclasses
import os
import warnings

import numpy as np
import pytest
import trimesh

from starling.patterns import InputError
from starling.sim import simulate
from starling.sim.geometry import frames
from starling.sim.render import direct, mitsuba_scene
from starling.sim.scene import sources
from starling.sim.scene import sources as mesh_file
from starling.sim.scene.builtin import scenes as builtin
from starling.sim.scene.scene import Ambient, Body, Material, Mesh, Scene
from starling.sim.sensor import presets

SENSOR = presets.load("d435")
GREY = Material(name="grey")

XML = """<scene version="3.0.0">
  <sensor type="perspective"><transform name="to_world">
    <lookat origin="0, 0, -2" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
  <shape type="sphere"><float name="radius" value="0.5"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf></shape>
</scene>"""


@pytest.mark.parametrize("word", ["wall", "wall:0.7", "staircase", "tabletop:3", "clutter:1"])
def test_builtin_scenes_match_their_specifier(word):
    scene = sources.load(word, SENSOR)
    assert scene.bodies
    again = sources.load(word, SENSOR)
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


def test_staircase_is_at_its_depths():
    truth = direct.layers(mitsuba_scene.MitsubaScene(builtin.staircase(0.8)), SENSOR).truth
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
        (
            "nowhere/thing.step",
            "scene must be a builtin name, a mesh, a Mitsuba XML, a TOML",
        ),
    ],
)
def test_unknown_specifiers(word, message):
    with pytest.raises(InputError, match=message):
        sources.load(word, SENSOR)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb"])
def test_a_mesh_is_seen_whole_and_centred(tmp_path, suffix):
    path = tmp_path / f"ball{suffix}"
    trimesh.creation.icosphere(3, 0.2).apply_translation([1.0, 2.0, 3.0]).export(path)
    scene = sources.load(str(path), SENSOR)
    truth = direct.layers(mitsuba_scene.MitsubaScene(scene), SENSOR).truth
    rows, columns = np.nonzero(truth.material)
    assert rows.min() > 0 and rows.max() < SENSOR.height - 1
    assert columns.min() > 0 and columns.max() < SENSOR.width - 1
    assert columns.mean() == pytest.approx(SENSOR.cx_px, abs=2)
    assert np.isfinite(truth.depth_m[rows, columns]).all()


def test_meshes_stand_upright(tmp_path):
    """y is up in the file, so the end with the ball is at the top of the image."""
    stick = trimesh.creation.box((0.02, 1.0, 0.02))
    ball = trimesh.creation.icosphere(3, 0.2).apply_translation([0.0, 0.5, 0.0])
    trimesh.util.concatenate([stick, ball]).export(tmp_path / "pin.ply")
    scene = sources.load(str(tmp_path / "pin.ply"), SENSOR)
    seen = direct.layers(mitsuba_scene.MitsubaScene(scene), SENSOR).truth.material > 0
    rows = np.nonzero(seen)[0]
    middle = (rows.min() + rows.max()) // 2
    assert seen[:middle].sum() > 3 * seen[middle:].sum()


def test_refused_meshes(tmp_path):
    (tmp_path / "empty.ply").write_bytes(b"")
    (tmp_path / "text.glb").write_text("no mesh at all")
    trimesh.PointCloud([[0, 0, 0], [1, 0, 0]]).export(tmp_path / "points.ply")
    box = trimesh.creation.box().export(file_type="ply", encoding="ascii")
    (tmp_path / "missing.ply").write_bytes(box.replace(b"3 1 3 0", b"3 1 9 0"))
    for name, message in {
        "missing.ply": "scene must be a mesh; .* a triangle has a vertex that is missing",
        "empty.ply": "scene must be a mesh",
        "text.glb": "scene must be a mesh",
        "points.ply": "scene must hold triangles",
    }.items():
        with pytest.raises(InputError, match=message) as caught:
            sources.load(str(tmp_path / name), SENSOR)
        assert "\n" not in str(caught.value)


def test_scenes_not_in_metres_are_refused(tmp_path):
    trimesh.creation.box((300.0, 200.0, 100.0)).export(tmp_path / "millimetres.ply")
    trimesh.Trimesh([[1.0, 1, 1]] * 3, [[0, 1, 2]], process=False).export(tmp_path / "point.obj")
    with pytest.raises(InputError, match=r"mesh must be at most 100 m wide; got 300 m .* 0\.001"):
        sources.load(str(tmp_path / "millimetres.ply"), SENSOR)
    with pytest.warns(UserWarning, match=r"point\.obj is 0 m wide: meshes are read in metres"):
        point = sources.load(str(tmp_path / "point.obj"), SENSOR)
    with pytest.raises(InputError, match="scene extent must be > 0"):
        mitsuba_scene.MitsubaScene(point)


@pytest.mark.parametrize(
    ("vertex", "message"),
    [
        ((np.nan, 0, 0), "mesh must have finite vertices; got NaN or infinite ones in .*m.obj"),
        ((np.inf, 0, 0), "mesh must have finite vertices"),
        ((1e9, 0, 0), "mesh must lie within 1e.07 m of its origin; got a coordinate of 1e.09 m"),
    ],
)
def test_vertices_that_cannot_be_are_refused(tmp_path, vertex, message):
    corners = np.array([(0.0, 0, 0), (1.0, 0, 0), (0.0, 1, 0)])
    corners = corners + vertex if np.isfinite(vertex).all() else np.vstack([corners[:2], vertex])
    trimesh.Trimesh(corners, [[0, 1, 2]], process=False).export(tmp_path / "m.obj")
    with pytest.raises(InputError, match=message):
        sources.load(str(tmp_path / "m.obj"), SENSOR)


@pytest.mark.parametrize(
    ("transform", "message"),
    [
        ('<scale x="-1"/>', "to_world of the sensor in .*m.xml must turn, not mirror"),
        ('<translate x="1e9"/>', "shift of to_world of the sensor in .*m.xml must be in"),
    ],
)
def test_poses_of_mitsuba_files_are_rigid(tmp_path, transform, message):
    pose = f'<transform name="to_world">{transform}</transform>'
    content = f'<sensor type="perspective">{pose}</sensor><shape type="sphere"/>'
    (tmp_path / "m.xml").write_text(f'<scene version="3.0.0">{content}</scene>')
    with pytest.raises(InputError, match=message):
        sources.load(str(tmp_path / "m.xml"), SENSOR)


def test_the_camera_must_be_outside_bodies(tmp_path):
    path = tmp_path / "box.ply"
    inside = frames.pose((0.1, 0.2, 0.0))
    trimesh.creation.box((1.0, 1.0, 1.0)).export(path)
    with pytest.raises(InputError, match="camera must stand outside every body"):
        mitsuba_scene.MitsubaScene(mesh_file.load_mesh(path, SENSOR, inside))
    room = trimesh.creation.box((3.0, 3.0, 3.0))
    room.invert()
    room.export(path)
    assert mitsuba_scene.MitsubaScene(mesh_file.load_mesh(path, SENSOR, inside)).shapes


def test_small_meshes_are_viewed_from_a_measurable_distance(tmp_path):
    path = tmp_path / "small.ply"
    trimesh.creation.box((0.03, 0.03, 0.03)).export(path)
    truth = direct.layers(mitsuba_scene.MitsubaScene(sources.load(str(path), SENSOR)), SENSOR).truth
    assert np.nanmin(truth.depth_m) > SENSOR.post.near_m
    assert np.nanmin(truth.depth_m) > SENSOR.focal_baseline_px_m / SENSOR.matcher.search_px


def test_light_comes_from_above_in_files(tmp_path):
    """Files have y up: the top face of a box is brighter than its front."""
    path = tmp_path / "box.ply"
    trimesh.creation.box((0.4, 0.4, 0.4)).export(path)
    layers = direct.layers(mitsuba_scene.MitsubaScene(sources.load(str(path), SENSOR)), SENSOR)
    top = np.nan_to_num(layers.truth.normal[..., 1]) < -0.8
    front = np.nan_to_num(layers.truth.normal[..., 2]) < -0.8
    assert layers.left.ambient[top].mean() > layers.left.ambient[front].mean()


def test_a_mitsuba_xml_is_seen_by_its_own_sensor(tmp_path):
    (tmp_path / "ball.xml").write_text(XML)
    scene = sources.load(str(tmp_path / "ball.xml"), SENSOR)
    layers = direct.layers(mitsuba_scene.MitsubaScene(scene), SENSOR)
    row, column = round(SENSOR.cy_px), round(SENSOR.cx_px)
    assert layers.truth.depth_m[row, column] == pytest.approx(1.5, abs=1e-3)
    assert layers.left.ambient[row, column] > 0


def test_an_xml_without_a_sensor_is_seen_as_mitsuba_would(tmp_path):
    """Mitsuba's camera at the origin has +x left and +y up."""
    text = '<scene version="3.0.0"><shape type="sphere"><float name="radius" value="0.1"/>'
    text += '<point name="center" x="0.2" y="0.3" z="2"/></shape></scene>'
    (tmp_path / "ball.xml").write_text(text)
    scene = sources.load(str(tmp_path / "ball.xml"), SENSOR)
    rows, columns = np.nonzero(
        direct.layers(mitsuba_scene.MitsubaScene(scene), SENSOR).truth.material
    )
    assert columns.mean() < SENSOR.cx_px and rows.mean() < SENSOR.cy_px


def test_lamps_of_an_xml_are_ignored(tmp_path):
    lamp = '<shape type="sphere"><point name="center" x="1" y="1" z="0"/>'
    lamp += '<float name="radius" value="0.2"/>{}</shape></scene>'
    light = '<emitter type="area"><rgb name="radiance" value="50"/></emitter>'
    seen = []
    for name, inner in (("on", light), ("off", "")):
        (tmp_path / f"{name}.xml").write_text(XML.replace("</scene>", lamp.format(inner)))
        scene = sources.load(str(tmp_path / f"{name}.xml"), SENSOR)
        seen.append(
            simulate.simulate(
                dataclasses.replace(scene, interreflection=1.0), SENSOR, samples=2
            ).layers.left
        )
    assert seen[0].ambient.any()
    for layer in ("projector_direct", "projector_indirect", "ambient", "other"):
        assert np.array_equal(getattr(seen[0], layer), getattr(seen[1], layer))


def test_an_xml_finds_the_meshes_in_its_folder(tmp_path):
    trimesh.creation.icosphere(2, 0.4).export(tmp_path / "ball.ply")
    text = XML.replace('type="sphere"', 'type="ply"').replace(
        '<float name="radius" value="0.5"/>', '<string name="filename" value="ball.ply"/>'
    )
    (tmp_path / "scene.xml").write_text(text)
    assert sources.load(str(tmp_path / "scene.xml"), SENSOR).shapes


def test_reading_an_xml_prints_nothing(tmp_path, capfd):
    (tmp_path / "ball.xml").write_text(XML)
    sources.load(str(tmp_path / "ball.xml"), SENSOR)
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            '<scene version="3.0.0"><shape type="instance"/></scene>',
            "scene must not hold instances",
        ),
        ('<scene version="3.0.0"><shape type="nonsense"/></scene>', "scene must be a Mitsuba XML"),
        ("<scene", "scene must be a Mitsuba XML"),
        ('<scene version="3.0.0"></scene>', "scene must hold shapes"),
    ],
)
def test_refused_xml(tmp_path, text, message):
    (tmp_path / "scene.xml").write_text(text)
    with pytest.raises(InputError, match=message):
        sources.load(str(tmp_path / "scene.xml"), SENSOR)


@pytest.mark.parametrize(
    "text",
    [
        '<shape type="ply"><string name="filename" value="pipe"/></shape>',
        '<include filename="pipe"/>',
    ],
)
def test_an_xml_that_names_a_pipe_is_refused(tmp_path, text):
    """Mitsuba would wait for a writer for ever."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{text}</scene>')
    with pytest.raises(InputError, match="scene must name regular files"):
        sources.load(str(tmp_path / "scene.xml"), SENSOR)


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
    with pytest.raises(InputError, match=r"length of ambient\.up must be in"):
        Ambient(up=(0.0, 2.0, 0.0))
    with pytest.raises(InputError, match="irradiance_w_m2 must be in"):
        Ambient(irradiance_w_m2=-1.0)
    with pytest.raises(InputError, match="kind of x must be a known name"):
        Material(name="x", kind="velvet")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="reflectance of x must be in"):
        Material(name="x", reflectance=1.1)


@pytest.mark.parametrize(("wide_m", "unusual"), [(0.0051, 0), (0.0049, 1), (29.9, 0), (30.1, 1)])
def test_a_mesh_of_unusual_size_is_reported_with_its_unit(tmp_path, wide_m, unusual):
    trimesh.creation.box((wide_m, wide_m / 2, wide_m / 2)).export(tmp_path / "box.ply")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        sources.load(str(tmp_path / "box.ply"), SENSOR)
    assert len(caught) == unusual
    assert all("m wide: meshes are read in metres" in str(entry.message) for entry in caught)


def test_a_distant_mesh_is_shifted_before_it_is_rounded(tmp_path):
    """Single precision resolves 6 cm at 5e5 m; the shape must stay exact."""
    box = trimesh.creation.box((0.3, 0.2, 0.1)).subdivide()
    near = sources.load(str(_exported(box, tmp_path / "near.obj")), SENSOR)
    far = (512345.0, -2000.0, 4.5e5)
    away = sources.load(str(_exported(box.apply_translation(far), tmp_path / "far.obj")), SENSOR)
    assert np.abs(np.array(away.origin_m) - far).max() <= 0.5
    shift = np.array(far) - away.origin_m
    spread = away.bodies[0].mesh.vertices - shift - near.bodies[0].mesh.vertices
    assert np.abs(spread).max() < 1e-6
    assert np.allclose(away.file_from_left[:3, 3], near.world_from_left[:3, 3] + far, atol=1e-6)


def test_a_known_pose_in_the_frame_of_a_distant_mesh_is_kept(tmp_path):
    box = trimesh.creation.box((0.3, 0.2, 0.1)).apply_translation((5e5, 0, 0))
    pose = frames.look_at((5e5, 0.0, 2.0), (5e5, 0.0, 0.0), (0.0, 1.0, 0.0))
    scene = sources.load_mesh(_exported(box, tmp_path / "far.obj"), SENSOR, pose)
    assert np.allclose(scene.world_from_left[:3, 3], (0, 0, 2))
    assert np.allclose(scene.file_from_left, pose)


def _exported(mesh, path):
    mesh.export(path, digits=9)
    return path


@pytest.mark.parametrize("name", ["tabletop", "clutter", "room"])
def test_a_seed_must_be_whole(name: str):
    with pytest.raises(InputError, match=rf"{name}'s seed must be whole; got 1\.5\. Give 1\."):
        builtin.named(name, "1.5")
    assert builtin.named(name, "1.0").name == f"{name}:1"
