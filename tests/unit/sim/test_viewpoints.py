"""Where the camera stands and how a mesh lies: pose files, look-at, up axes, units, TOML."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import starling
from starling.patterns import InputError
from starling.sim.commands import simulate_captures
from starling.sim.geometry import frames
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import pose_file, scene_file, sources
from starling.sim.scene.captured import known_geometry
from starling.sim.scene.placing import Placing, Viewpoint, looking_at
from starling.sim.sensor import presets
from starling.sim.sensor.edits import apply

SENSOR = presets.load("d435")
SMALL = ("width=96", "height=64", "fx_px=90", "fy_px=90", "cx_px=47.5", "cy_px=31.5")
POSE = frames.look_at((0.3, 0.4, 1.2), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
TUM = "# time\n1.5 0.3 0.4 1.2 1 0 0 0\n2.5 0.1 0.2 1.3 0.7071 0.7071 0 0\n"


@pytest.fixture
def box(tmp_path: Path) -> Path:
    """A box of 0.4 x 0.2 x 0.1, away from the origin."""
    mesh = trimesh.creation.box((0.4, 0.2, 0.1)).apply_translation((0.1, 0.0, 0.0))
    mesh.export(tmp_path / "box.ply")
    return tmp_path / "box.ply"


def rows(*poses: np.ndarray) -> str:
    return "\n".join(" ".join(map(str, row)) for pose in poses for row in pose)


def save(folder: Path, name: str, content: Any) -> Path:
    path = folder / name
    if isinstance(content, str):
        path.write_text(content)
    else:
        np.save(path, content)
    return path


@pytest.mark.parametrize(
    ("name", "content", "count"),
    [
        ("p.txt", rows(POSE), 1),
        ("p.txt", rows(POSE, POSE).replace(" ", ", "), 2),
        ("p.npy", POSE, 1),
        ("p.npy", np.stack([POSE, POSE, POSE]), 3),
        ("p.toml", f"world_from_camera = {POSE.tolist()}", 1),
        ("p.toml", f"world_from_camera = {[POSE.tolist()] * 2}", 2),
    ],
)
def test_matrices_are_read(tmp_path: Path, name: str, content: Any, count: int) -> None:
    views = pose_file.read(save(tmp_path, name, content))
    assert len(views) == count
    for view in views:
        assert view.pose is not None and view.timestamp is None
        np.testing.assert_allclose(view.pose, POSE, atol=1e-12)


def test_a_trajectory_is_read(tmp_path: Path) -> None:
    """A quaternion of four digits is made a rotation again."""
    first, second = pose_file.read(save(tmp_path, "p.txt", TUM))
    assert (first.timestamp, second.timestamp) == (1.5, 2.5)
    assert first.pose is not None and second.pose is not None
    assert first.pose[:3, 3].tolist() == [0.3, 0.4, 1.2]
    np.testing.assert_allclose(first.pose[:3, :3], np.diag([1.0, -1.0, -1.0]), atol=1e-12)
    frames.refuse_not_rigid("pose", second.pose, rounding=1e-9)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("p.txt", "", r"p\.txt: rows of poses must have 4 or 8 numbers; got nothing"),
        ("p.txt", "1 2 3", r"rows of poses must have 4 or 8 numbers; got \[3\]"),
        ("p.txt", "1 2 3 4", r"pose must be matrices of 4 x 4 numbers; got \(1, 4\)"),
        ("p.txt", "a b c d", "pose must be a file of poses; got .*could not convert"),
        ("p.txt", rows(2 * POSE), r"p\.txt: pose 0 must be rigid"),
        ("p.txt", "1 0 0 0 1 1 0 0", "quaternion of pose 0 must have length 1; got 1.41421"),
        ("p.txt", "-1 0 0 0 1 0 0 0", r"time of pose 0 must be in \[0, 1e\+10\]"),
        (
            "p.npy",
            np.zeros((3, 3)),
            r"p\.npy: pose must be matrices of 4 x 4 numbers; got \(3, 3\)",
        ),
        ("p.npy", np.zeros((4, 4), bool), "matrices of 4 x 4 numbers; got .* bool"),
        ("p.npy", "no array", "pose must be a file of poses"),
        ("p.toml", "pose = 1", r"p\.toml: key must be a known name; got 'pose'"),
        ("p.toml", "", "world_from_camera must be given"),
        ("p.toml", "world_from_camera = [[1, 2]]", "matrices of 4 x 4 numbers"),
    ],
)
def test_wrong_pose_files_are_refused(
    tmp_path: Path, name: str, content: Any, message: str
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        pose_file.read(save(tmp_path, name, content))
    assert "\n" not in str(caught.value)


def test_a_missing_pose_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"pose must be a file that exists; got .*none\.txt"):
        pose_file.read(tmp_path / "none.txt")


def test_a_scene_is_seen_from_a_pose_or_towards_a_point(box: Path) -> None:
    scene = sources.load(str(box), SENSOR, view=Viewpoint(pose=POSE))
    np.testing.assert_array_equal(scene.world_from_left, POSE)
    target = (0.3, 0.4, 1.2, 0.0, 0.0, 0.0)
    towards = sources.load(str(box), SENSOR, view=Viewpoint(look_at=target))
    np.testing.assert_allclose(towards.world_from_left, POSE)


@pytest.mark.parametrize(
    ("up", "down", "top"),
    [
        ("y", (0, 2, 0, 0, 0, 0), (0, 0, -1)),
        ("z", (0, 0, 2, 0, 0, 0), (0, 1, 0)),
        ("x", (2, 0, 0, 0, 0, 0), (0, 0, -1)),
    ],
)
def test_a_camera_may_look_straight_down(box: Path, up: str, down: Any, top: Any) -> None:
    scene = sources.load(str(box), SENSOR, Placing(up=up))
    pose = looking_at(scene, tuple(map(float, down)))  # type: ignore[arg-type]
    np.testing.assert_allclose(-pose[:3, 1], top, atol=1e-9)


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_the_up_axis_turns_the_default_view_and_the_sky(box: Path, up: str) -> None:
    scene = sources.load(str(box), SENSOR, Placing(up=up))
    axis = "xyz".index(up)
    assert scene.ambient.up[axis] == 1 and scene.sun.towards[axis] == 0.9
    assert scene.world_from_left[axis, 3] > 0  # From above,
    assert scene.world_from_left[axis, 1] < 0  # with up in the picture up in the world.
    np.testing.assert_allclose(np.ptp(scene.bodies[0].mesh.vertices, axis=0), [0.4, 0.2, 0.1])


@pytest.mark.parametrize(("unit", "scale"), [("m", 1), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254)])
def test_the_unit_scales_a_mesh(tmp_path: Path, unit: str, scale: float) -> None:
    trimesh.creation.box((80.0, 40.0, 20.0)).export(tmp_path / "box.stl")
    if unit == "m":
        with pytest.warns(UserWarning, match=r"80 m wide.*Give --unit"):
            scene = sources.load(str(tmp_path / "box.stl"), SENSOR, Placing(unit=unit))
    else:
        scene = sources.load(str(tmp_path / "box.stl"), SENSOR, Placing(unit=unit))
    expected = np.array([80.0, 40.0, 20.0]) * scale
    np.testing.assert_allclose(np.ptp(scene.bodies[0].mesh.vertices, axis=0), expected, rtol=1e-6)


def test_millimetres_are_refused_with_the_flag(tmp_path: Path) -> None:
    trimesh.creation.box((300.0, 200.0, 100.0)).export(tmp_path / "box.stl")
    with pytest.raises(InputError, match=r"at most 100 m wide; got 300 m .*give --unit mm"):
        sources.load(str(tmp_path / "box.stl"), SENSOR)


def test_wrong_places_are_refused(box: Path) -> None:
    with pytest.raises(InputError, match="up must be a known name; got 'up'"):
        Placing(up="up")
    with pytest.raises(InputError, match="unit must be a known name; got 'km'"):
        Placing(unit="km")
    with pytest.raises(InputError, match="up must be given with a mesh file"):
        sources.load("wall", SENSOR, Placing(up="z"))
    with pytest.raises(InputError, match="pose, look-at must not both be given"):
        Viewpoint(pose=POSE, look_at=(0, 0, 1, 0, 0, 0))
    with pytest.raises(InputError, match="pose, look-at must not both be given"):
        pose_file.views(box, (0, 0, 1, 0, 0, 0))
    with pytest.raises(InputError, match="eye must differ from target"):
        sources.load(str(box), SENSOR, view=Viewpoint(look_at=(1, 1, 1, 1, 1, 1)))
    with pytest.raises(InputError, match="look-at eye x must be in"):
        sources.load(str(box), SENSOR, view=Viewpoint(look_at=(np.nan, 1, 1, 0, 1, 1)))


def test_the_interface_takes_poses(box: Path, tmp_path: Path) -> None:
    by_array = starling.load_scene(box, SENSOR, pose=POSE)
    by_file = starling.load_scene(box, SENSOR, pose=save(tmp_path, "p.npy", POSE))
    np.testing.assert_allclose(by_array.world_from_left, by_file.world_from_left)
    looking = starling.load_scene(box, SENSOR, look_at=[0.3, 0.4, 1.2, 0, 0, 0], unit="in")
    np.testing.assert_allclose(looking.world_from_left, by_file.world_from_left)
    for arguments, message in (
        ({"pose": np.stack([POSE, POSE])}, "pose must be one pose; got 2 poses"),
        ({"pose": np.eye(3)}, "pose must be matrices of 4 x 4 numbers"),
        ({"pose": POSE, "look_at": [0] * 6}, "pose, look_at must not both be given"),
        ({"look_at": [0] * 5}, "look_at must be six numbers; got 5"),
    ):
        with pytest.raises(InputError, match=message):
            starling.load_scene(box, SENSOR, **arguments)


def test_a_toml_describes_a_scene(box: Path, tmp_path: Path) -> None:
    text = 'scene = "box.ply"\nunit = "in"\nup = "z"\nlook_at = [0, -1, 0.5, 0, 0, 0]\n'
    text += 'ambient_w_m2 = 3.0\n[[materials]]\nbody = "*"\nkind = "metal"\nroughness = 0.3\n'
    path = save(tmp_path, "room.toml", text + "rgb = [0.1, 0.2, 0.3]\n")
    scene = sources.load(str(path), SENSOR)
    (body,) = scene.bodies
    assert (body.material.kind, body.material.roughness) == ("metal", 0.3)
    assert body.material.rgb == (0.1, 0.2, 0.3) and body.material.reflectance == 0.5
    assert scene.ambient.irradiance_w_m2 == 3.0 and scene.ambient.up == (0.0, 0.0, 1.0)
    assert scene.world_from_left[:3, 3].tolist() == [0, -1, 0.5]
    assert np.ptp(body.mesh.vertices, axis=0)[0] == pytest.approx(0.4 * 0.0254)
    assert sources.load(str(path), SENSOR, Placing(unit="m")).bodies[0].mesh.vertices.max() > 0.1


def test_materials_are_chosen_by_body_and_by_material(tmp_path: Path) -> None:
    text = 'scene = "tabletop"\n[[materials]]\nbody = "*"\nmaterial = "{}"\nreflectance = 0.11\n'
    path = save(tmp_path, "room.toml", text.format("w*"))
    scene = sources.load(str(path), SENSOR)
    changed = {body.material.name for body in scene.bodies if body.material.reflectance == 0.11}
    assert changed and all(name.startswith("w") for name in changed)
    path = save(tmp_path, "room.toml", text.format("gold"))
    with pytest.raises(InputError, match=r"must name a material of the bodies; got 'gold'. There"):
        sources.load(str(path), SENSOR)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('up = "w"', "up must be a known name; got 'w'"),
        ('unit = "km"', "unit must be a known name; got 'km'"),
        ("look_at = [1, 2, 3]", "look_at must be a list of 6"),
        (
            f"look_at = [0, 0, 1, 0, 0, 0]\nleft_from_world = {np.eye(4).tolist()}",
            "look_at must not be given with left_from_world",
        ),
        ('[[materials]]\nbody = "*"\nkind = "velvet"', r"kind of \* must be a known name"),
        ('[[materials]]\nbody = "*"\nroughness = 2.0', r"roughness of \* must be in"),
        ('[[materials]]\nbody = "*"\nrgb = [1, 2, 0]', r"rgb of \* must be in"),
        ('[[materials]]\nbody = "*"', r"materials of \* must give reflectance, kind, roughness or"),
    ],
)
def test_wrong_toml_is_refused(tmp_path: Path, line: str, message: str) -> None:
    path = save(tmp_path, "room.toml", f'scene = "wall"\n{line}\n')
    with pytest.raises(InputError, match=message):
        sources.load(str(path), SENSOR)


def test_a_file_without_a_pose_is_none_of_a_capture() -> None:
    with pytest.raises(InputError, match="left_from_world must be given"):
        _ = scene_file.SceneFile(scene="wall").world_from_left


def test_the_written_geometry_loads_equal(box: Path, tmp_path: Path) -> None:
    text = 'scene = "box.ply"\nunit = "in"\nup = "z"\nlook_at = [0, -1, 0.5, 0, 0, 0]\n'
    path = save(tmp_path, "room.toml", text + '[[materials]]\nbody = "*"\nreflectance = 0.2\n')
    scene = sources.load(str(path), SENSOR, Placing(unit="m"))
    folder = tmp_path / "set" / "room"
    known = known_geometry.describe(str(path), scene.file_from_left, folder, Placing(unit="m"))
    assert known is not None and (known.scene, known.unit) == ("../../box.ply", "m")
    folder.mkdir(parents=True)
    (folder / "scene.toml").write_text(scene_file.dumps(known))
    again = sources.load(str(folder / "scene.toml"), SENSOR)
    np.testing.assert_allclose(again.world_from_left, scene.world_from_left, atol=1e-12)
    np.testing.assert_array_equal(again.bodies[0].mesh.vertices, scene.bodies[0].mesh.vertices)
    assert again.bodies[0].material == scene.bodies[0].material
    assert again.ambient == scene.ambient


def test_each_pose_becomes_a_scene(box: Path, tmp_path: Path) -> None:
    camera = apply(SENSOR, SMALL)
    written = starling.simulate_captures(
        box,
        camera,
        tmp_path / "set",
        pose=save(tmp_path, "p.txt", TUM.replace("0.7071 0.7071", "1 0")),
    )
    assert list(written["scenes"]) == ["box-0", "box-1"]
    first, second = starling.open_captures(tmp_path / "set").scenes
    assert first.room == second.room == "box"
    assert [scene.record(0)["timestamp"] for scene in (first, second)] == [1.5, 2.5]
    known = second.known()
    assert known is not None
    np.testing.assert_allclose(known.world_from_left[:3, 3], (0.1, 0.2, 1.3))
    truths = [scene.truth_m() for scene in (first, second)]
    alone = starling.simulate_captures(
        box, camera, tmp_path / "alone", look_at=(0.1, 0.2, 1.3, 0.1, 0.2, 0.0)
    )
    assert list(alone["scenes"]) == ["box"]
    np.testing.assert_array_equal(
        truths[1], starling.open_captures(tmp_path / "alone").scenes[0].truth_m()
    )
    with pytest.raises(InputError, match="pose, look-at, up, unit must not be given with captures"):
        starling.simulate_captures(tmp_path / "set", camera, tmp_path / "x", pose=POSE)


def test_a_later_pose_inside_a_body_is_refused(box: Path, tmp_path: Path) -> None:
    poses = np.stack([POSE, frames.pose((0.1, 0.0, 0.0))])
    with pytest.raises(InputError, match="camera must stand outside every body"):
        simulate_captures.simulate_captures(
            str(box), apply(SENSOR, SMALL), tmp_path / "set", views=pose_file.of_matrices(poses)
        )
    assert not (tmp_path / "set").exists()


def test_a_pose_is_in_the_frame_of_a_distant_mesh(tmp_path: Path) -> None:
    far = (5e5, 100.0, 0.0)
    trimesh.creation.box((0.3, 0.2, 0.1)).apply_translation(far).export(tmp_path / "far.obj")
    view = Viewpoint(look_at=(5e5, 100.0, 1.0, 5e5, 100.0, 0.0))
    scene = sources.load(str(tmp_path / "far.obj"), SENSOR, view=view)
    assert scene.file_from_left[:3, 3].tolist() == [5e5, 100.0, 1.0]
    assert MitsubaScene(scene).shapes
