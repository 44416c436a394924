"""URDF files: visual geometry, files named by packages, and cameras at links."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.exchange.dae import export_collada
from trimesh.visual import ColorVisuals, TextureVisuals

import starling.mujoco
from starling.patterns import InputError
from starling.sim.mujoco import model_file

URDF = """<robot name="arm"><link name="base"><visual><geometry><box size="1 1 .02"/></geometry>
</visual><collision><geometry><box size="2 2 .1"/></geometry></collision></link>
<link name="post"><visual><geometry><mesh filename="{mesh}"/></geometry></visual></link>
<link name="guard"><collision><geometry><sphere radius=".05"/></geometry></collision></link>
<link name="eye"/><link name="eye_optical_frame"/>
<joint name="pan" type="revolute"><parent link="base"/><child link="post"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="a" type="fixed"><parent link="base"/><child link="guard"/></joint>
<joint name="b" type="fixed"><parent link="base"/><child link="eye"/>
<origin xyz="-.5 0 .5"/></joint>
<joint name="c" type="fixed"><parent link="eye"/><child link="eye_optical_frame"/>
<origin rpy="-1.5707963 0 -1.5707963"/></joint>{more}</robot>"""


def written(package: Path, mesh: str, *, more: str = "", stored: str = "meshes/post.stl") -> Path:
    """Write a robot in the folder `urdf` of a package, and its mesh."""
    file = package / stored
    file.parent.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box((0.1, 0.1, 0.6)).export(file)
    path = package / "urdf" / "arm.urdf"
    path.parent.mkdir(exist_ok=True)
    path.write_text(URDF.format(mesh=mesh, more=more))
    return path


def test_links_without_visual_geometry_show_their_collision_geometry(tmp_path: Path):
    path = written(tmp_path / "arm", "package://arm/meshes/post.stl")
    scene = model_file.load(path, camera="eye")
    names = sorted(body.name.split("/")[0] for body in scene.bodies)
    assert names == ["base", "guard", "post"]
    (base,) = (body for body in scene.bodies if body.name.startswith("base"))
    assert np.ptp(base.mesh.vertices[:, 0]) == pytest.approx(1)


def test_a_link_is_a_camera_in_the_axes_of_ros(tmp_path: Path):
    path = written(tmp_path / "arm", "package://arm/meshes/post.stl")
    link, optical = (model_file.load(path, camera=name) for name in ("eye", "eye_optical_frame"))
    expected = np.array([[0, 0, 1, -0.5], [-1, 0, 0, 0], [0, -1, 0, 0.5], [0, 0, 0, 1]])
    np.testing.assert_allclose(link.world_from_left, expected, atol=1e-6)
    np.testing.assert_allclose(optical.world_from_left, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("mesh", "more", "stored"),
    [
        ("package://arm/meshes/post.stl", "", "meshes/post.stl"),
        ("package://parts/post.stl", "", "parts/post.stl"),
        ("../meshes/post.stl", "", "meshes/post.stl"),
        ("package://elsewhere/post.stl", "", "urdf/post.stl"),
        ("post.stl", '<mujoco><compiler meshdir="../cad"/></mujoco>', "cad/post.stl"),
        ("post.stl", "<mujoco/>", "urdf/post.stl"),
    ],
)
def test_meshes_are_found(tmp_path: Path, mesh: str, more: str, stored: str):
    model = starling.mujoco.model_of(str(written(tmp_path / "arm", mesh, more=more, stored=stored)))
    assert model.nmesh == 1
    path = written(tmp_path / "url", (tmp_path / "arm" / stored).as_uri())
    assert starling.mujoco.model_of(path).nmesh == 1


def _coloured(rgba: list[int] | None, shift: float) -> trimesh.Trimesh:
    mesh = trimesh.creation.box((100, 100, 100))
    mesh.apply_translation((shift, 0, 0))
    if rgba is not None:
        mesh.visual = ColorVisuals(mesh, vertex_colors=[rgba] * len(mesh.vertices))
    return mesh


def _seen(tmp_path: Path, mesh: str) -> list[tuple[float, ...]]:
    """Colours of the geoms of the link `post`."""
    model = starling.mujoco.model_of(written(tmp_path / "arm", mesh))
    bodies = [model.body(int(body)).name for body in model.geom_bodyid]
    return [
        tuple(model.geom_rgba[number][:3].tolist())
        for number, body in enumerate(bodies)
        if body == "post"
    ]


def test_surfaces_of_other_meshes_keep_their_colours(tmp_path: Path):
    folder = tmp_path / "arm" / "meshes"
    folder.mkdir(parents=True)
    scene = trimesh.Scene([_coloured([200, 30, 20, 255], 0), _coloured([20, 30, 200, 255], 300)])
    scene.export(folder / "two.glb")
    # Vertex colours of glTF are linear.
    two = _seen(tmp_path, "package://arm/meshes/two.glb")
    np.testing.assert_allclose(sorted(two), [[0.31, 0.38, 0.9], [0.9, 0.38, 0.31]], atol=0.01)
    _coloured(None, 0).export(folder / "plain.ply")
    assert _seen(tmp_path, "package://arm/meshes/plain.ply") == [(0.5, 0.5, 0.5)]
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    image = Image.new("RGB", (4, 4), (128, 128, 128))
    flat.visual = TextureVisuals(uv=flat.vertices[:, :2], image=image)
    flat.export(folder / "flat.glb")
    (grey,) = _seen(tmp_path, "package://arm/meshes/flat.glb")
    assert len(set(grey)) == 1


def test_collada_is_in_its_own_unit(tmp_path: Path):
    pytest.importorskip("collada", reason="the package pycollada is not installed")
    folder = tmp_path / "arm" / "meshes"
    folder.mkdir(parents=True)
    content = export_collada(_coloured([200, 30, 20, 255], 0))
    content = content.replace(b"<asset>", b'<asset><unit name="mm" meter="0.001"/>')
    (folder / "box.dae").write_bytes(content)
    scene = model_file.load(written(tmp_path / "arm", "package://arm/meshes/box.dae"), camera="eye")
    (post,) = (body for body in scene.bodies if body.name.startswith("post"))
    assert np.ptp(post.mesh.vertices[:, 0]) == pytest.approx(0.1, rel=1e-4)


def test_damaged_robots_are_refused(tmp_path: Path):
    path = written(tmp_path / "arm", "package://arm/meshes/missing.stl")
    with pytest.raises(InputError, match=r"scene must load in MuJoCo; got .*missing.stl"):
        model_file.load(path)
    path.write_text("<robot name='arm'><link></robot>")
    with pytest.raises(InputError, match=r"scene must be a URDF; got .*mismatched tag"):
        model_file.load(path)
