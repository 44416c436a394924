"""Looks of GLB, OBJ, PLY, STL and DAE files as materials, textures and vertex normals."""

import json
import struct
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from starling.patterns import InputError
from starling.sim.scene import colours, sources
from starling.sim.scene.meshes import appearance
from starling.sim.scene.scene import Body, Scene
from starling.sim.sensor import presets

SENSOR = presets.load("d435")
CORNERS = np.array([(-0.1, -0.1, 0.0), (0.1, -0.1, 0), (0.1, 0.1, 0), (-0.1, 0.1, 0)])
FACES = [(0, 1, 2), (0, 2, 3)]
UV = np.array([(0.0, 0.0), (1, 0), (1, 1), (0, 1)])  # v upwards.
# Top row red and green, bottom row blue and white.
PICTURE = np.array([[(255, 0, 0), (0, 255, 0)], [(0, 0, 255), (255, 255, 255)]], np.uint8)

Edit = Callable[[dict[str, Any]], object]


def load(path: Path) -> Scene:
    return sources.load(str(path), SENSOR)


def only(path: Path) -> Body:
    (body,) = load(path).bodies
    return body


def glb(path: Path, edit: Edit = lambda _: None, *, image: bool = True, **pbr: Any) -> Path:
    """Write a square with a material whose header is edited."""
    square = trimesh.Trimesh(CORNERS, FACES, process=False)
    texture = Image.fromarray(PICTURE) if image else None
    material = PBRMaterial(name="paint", baseColorTexture=texture, **{"metallicFactor": 0.0, **pbr})
    square.visual = TextureVisuals(uv=UV, material=material)
    return edited(square.export(file_type="glb"), path, edit)


def edited(data: Any, path: Path, edit: Edit) -> Path:
    (length,) = struct.unpack_from("<I", data, 12)
    header = json.loads(data[20 : 20 + length])
    edit(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunk = struct.pack("<I4s", len(text), b"JSON") + text + data[20 + length :]
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunk)) + chunk)
    return path


def material_of(header: dict[str, Any]) -> dict[str, Any]:
    return header["materials"][0]


def obj(folder: Path, mtl: str, *, picture: bool = True) -> Path:
    text = "mtllib m.mtl\nusemtl paint\n"
    text += "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS)
    text += "".join(f"vt {u} {v}\n" for u, v in UV)
    (folder / "m.obj").write_text(text + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
    (folder / "m.mtl").write_text(f"newmtl paint\n{mtl}\n")
    if picture:
        Image.fromarray(PICTURE).save(folder / "p.png")
    return folder / "m.obj"


def uv_of_corner(body: Body, corner: np.ndarray) -> list[float]:
    assert body.mesh.uv is not None
    number = np.abs(body.mesh.vertices - corner).sum(axis=1).argmin()
    return body.mesh.uv[number].tolist()


@pytest.mark.parametrize("kind", ["glb", "obj"])
def test_the_top_row_of_a_picture_lies_at_v_0(tmp_path: Path, kind: str) -> None:
    body = only(glb(tmp_path / "m.glb") if kind == "glb" else obj(tmp_path, "map_Kd p.png"))
    assert body.colour is not None and body.texture is not None and body.repeats
    np.testing.assert_array_equal(body.colour, PICTURE / 255)
    np.testing.assert_array_equal(body.texture, colours.near_infrared(body.colour))
    assert uv_of_corner(body, CORNERS[3]) == [0, 0]  # Upper left.
    assert uv_of_corner(body, CORNERS[1]) == [1, 1]


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb", ".stl"])
def test_files_without_colour_keep_their_reflectance(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"box{suffix}"
    trimesh.creation.box((0.2, 0.2, 0.2)).export(path)
    body = only(path)
    assert (body.material.reflectance, body.material.rgb, body.colour) == (0.5, None, None)
    assert body.mesh.normals is None


def test_the_base_colour_and_the_factor_of_a_picture_are_linear(tmp_path: Path) -> None:
    factor = {"baseColorFactor": [0.5, 0.25, 1.0, 1.0]}

    def edit(header: dict[str, Any]) -> None:
        material_of(header)["pbrMetallicRoughness"].update(factor)

    painted = only(glb(tmp_path / "m.glb", edit))
    assert painted.colour is not None
    np.testing.assert_allclose(painted.colour[1, 1], [0.5, 0.25, 1.0])
    plain = only(glb(tmp_path / "p.glb", edit, image=False, baseColorFactor=[1.0] * 4))
    assert plain.material.rgb == (0.5, 0.25, 1.0)
    assert plain.material.reflectance == pytest.approx(0.85)


@pytest.mark.parametrize(
    ("metallic", "roughness", "kind", "alpha"),
    [
        (0.0, 1.0, "diffuse", 1.0),
        (0.0, 0.51, "diffuse", 0.51**2),
        (0.0, 0.5, "glossy", 0.25),
        (0.5, 0.0, "glossy", 0.01),
        (0.51, 0.6, "metal", 0.36),
        (None, None, "metal", 1.0),
    ],
)
def test_metal_and_gloss_follow_their_limits(
    tmp_path: Path, metallic: float | None, roughness: float | None, kind: str, alpha: float
) -> None:
    """Without numbers a GLB's material is rough metal, as the format says."""
    path = glb(tmp_path / "m.glb", metallicFactor=metallic, roughnessFactor=roughness)
    material = only(path).material
    assert material.kind == kind
    assert material.roughness == pytest.approx(alpha)
    assert material.name == "paint"


def test_a_map_of_metal_and_roughness_gives_its_mean(tmp_path: Path) -> None:
    levels = np.zeros((4, 4, 3), np.uint8)
    levels[..., 1], levels[..., 2] = 102, 255  # Roughness 0.4, metal 1.
    path = glb(
        tmp_path / "m.glb",
        metallicFactor=1.0,
        roughnessFactor=0.5,
        metallicRoughnessTexture=Image.fromarray(levels),
    )
    with pytest.warns(UserWarning, match=r"m\.glb: not used: maps of metal and roughness"):
        material = only(path).material
    assert (material.kind, material.roughness) == ("metal", pytest.approx(0.04))


@pytest.mark.parametrize(
    ("wraps", "repeats", "shape"),
    [
        ((10497, 10497), True, (2, 2)),
        ((33071, 33071), False, (2, 2)),
        ((33648, 10497), True, (2, 4)),
        ((33648, 33648), True, (4, 4)),
    ],
)
def test_the_wrap_mode_is_that_of_the_sampler(
    tmp_path: Path, wraps: tuple[int, int], repeats: bool, shape: tuple[int, int]
) -> None:
    def edit(header: dict[str, Any]) -> None:
        header["samplers"] = [{"wrapS": wraps[0], "wrapT": wraps[1]}]
        header["textures"][0]["sampler"] = 0

    body = only(glb(tmp_path / "m.glb", edit))
    assert body.colour is not None and body.repeats == repeats
    assert body.colour.shape[:2] == shape
    height, width = shape
    assert uv_of_corner(body, CORNERS[1]) == [2 / width, 2 / height]
    np.testing.assert_array_equal(body.colour[:2, :2], PICTURE / 255)
    if shape == (4, 4):
        np.testing.assert_array_equal(body.colour[-2:, -2:], np.rot90(PICTURE / 255, 2))


def _transform(**values: Any) -> Edit:
    def edit(header: dict[str, Any]) -> None:
        texture = material_of(header)["pbrMetallicRoughness"]["baseColorTexture"]
        texture["extensions"] = {"KHR_texture_transform": values}

    return edit


def test_the_offset_and_scale_of_a_texture_apply(tmp_path: Path) -> None:
    body = only(glb(tmp_path / "m.glb", _transform(scale=[2, 3], offset=[0.5, 0.25])))
    assert uv_of_corner(body, CORNERS[3]) == [0.5, 0.25]
    assert uv_of_corner(body, CORNERS[1]) == [2.5, 3.25]


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda h: material_of(h).update(normalTexture={"index": 0}), "normal maps"),
        (lambda h: material_of(h).update(occlusionTexture={"index": 0}), "occlusion maps"),
        (lambda h: material_of(h).update(emissiveFactor=[1, 0, 0]), "emission"),
        (lambda h: material_of(h).update(alphaMode="BLEND"), "transparency"),
        (
            lambda h: material_of(h).update(extensions={"KHR_materials_clearcoat": {}}),
            "KHR_materials_clearcoat",
        ),
        (lambda h: h.update(extensions={"KHR_lights_punctual": {}}), "lights"),
        (lambda h: h.update(cameras=[{"type": "orthographic"}]), "cameras"),
        (lambda h: h.update(animations=[{}]), "animations"),
        (_transform(rotation=1.0), "second texture coordinates and turned textures"),
        (lambda h: h["meshes"][0]["primitives"][0]["attributes"].pop("TEXCOORD_0"), "textures wi"),
        (lambda h: h["images"].clear(), "textures that cannot be read"),
        (
            lambda h: (
                h.update(samplers=[{"wrapS": 33071}]),
                h["textures"][0].update(sampler=0),
            ),
            "clamping of textures along one axis",
        ),
    ],
)
def test_what_a_glb_holds_in_vain_is_one_warning(tmp_path: Path, edit: Edit, words: str) -> None:
    path = glb(tmp_path / "m.glb", edit)
    with pytest.warns(UserWarning, match=rf"m\.glb: not used: {words}") as caught:
        load(path)
    assert len(caught) == 1


def test_several_unused_parts_are_one_line(tmp_path: Path) -> None:
    def edit(header: dict[str, Any]) -> None:
        material_of(header).update(normalTexture={"index": 0}, emissiveFactor=[1, 1, 1])

    with pytest.warns(UserWarning, match=r"not used: emission, normal maps\.$"):
        load(glb(tmp_path / "m.glb", edit))


def test_a_texture_that_is_turned_gives_its_mean_colour(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="turned textures"):
        body = only(glb(tmp_path / "m.glb", _transform(rotation=1.0)))
    assert body.colour is not None and body.colour.shape == (1, 1, 3)


def test_glossiness_materials_are_read(tmp_path: Path) -> None:
    def edit(header: dict[str, Any]) -> None:
        values = {"diffuseFactor": [0.2, 0.4, 0.6, 1.0], "glossinessFactor": 0.9}
        values["specularFactor"] = [0.04, 0.04, 0.04]
        material = material_of(header)
        material["extensions"] = {"KHR_materials_pbrSpecularGlossiness": values}

    body = only(glb(tmp_path / "m.glb", edit, image=False))
    assert body.material.rgb is not None and body.material.kind != "metal"


def test_an_empty_material_has_no_colour(tmp_path: Path) -> None:
    def edit(header: dict[str, Any]) -> None:
        header["materials"] = [{"name": "none"}]

    body = only(glb(tmp_path / "m.glb", edit, image=False))
    assert (body.material.reflectance, body.material.rgb) == (0.5, None)


def test_a_damaged_picture_is_refused(tmp_path: Path) -> None:
    path = glb(tmp_path / "m.glb")
    data = path.read_bytes()
    start = data.index(b"IDAT") + 4
    path.write_bytes(data[:start] + bytes(8) + data[start + 8 :])
    with pytest.raises(InputError, match="It cannot be read: a texture cannot be read"):
        load(path)


@pytest.mark.parametrize(
    ("mtl", "kind", "alpha", "rgb"),
    [
        ("Kd 0.2 0.4 0.6", "diffuse", 1.0, (0.2, 0.4, 0.6)),
        ("Kd 0.5 0.5 0.5\nKs 0.5 0.5 0.5\nNs 198", "glossy", 0.1, (0.5, 0.5, 0.5)),
        ("Kd 0.5 0.5 0.5\nKs 0 0 0\nNs 198", "diffuse", 1.0, (0.5, 0.5, 0.5)),
        ("Kd 0.5 0.5 0.5\nPr 0.3\nPm 1.0", "metal", 0.09, (0.5, 0.5, 0.5)),
        ("Kd 2 0.5 1", "diffuse", 1.0, (1.0, 0.5, 1.0)),
        ("Kd x 0.5 1\nPr 0.8", "diffuse", 0.64, (1.0, 1.0, 1.0)),
    ],
)
def test_materials_of_an_mtl(
    tmp_path: Path, mtl: str, kind: str, alpha: float, rgb: tuple[float, ...]
) -> None:
    material = only(obj(tmp_path, mtl)).material
    assert (material.kind, material.name) == (kind, "paint")
    assert material.roughness == pytest.approx(alpha)
    assert material.rgb == pytest.approx(rgb)


@pytest.mark.parametrize(
    ("mtl", "words"),
    [
        ("map_Kd p.png\nmap_Bump p.png", "normal maps"),
        ("map_Kd p.png\ndisp p.png", "displacement maps"),
        ("Kd 1 1 1\nKe 1 0 0", "emission"),
        ("Kd 1 1 1\nd 0.5", "transparency"),
        ("Kd 1 1 1\nTr 0.5", "transparency"),
        ("Kd 1 1 1\nmap_Ks p.png", "maps of gloss"),
        ("Kd 0.3", r"materials that cannot be read \(paint\)"),
        ("map_Kd other.png", r"files that are missing \(other\.png\)"),
    ],
)
def test_what_an_mtl_holds_in_vain_is_one_warning(tmp_path: Path, mtl: str, words: str) -> None:
    path = obj(tmp_path, mtl)
    with pytest.warns(UserWarning, match=rf"m\.obj: not used: {words}\.$"):
        load(path)


def test_an_obj_without_its_mtl_has_no_colour(tmp_path: Path) -> None:
    path = obj(tmp_path, "map_Kd p.png")
    (tmp_path / "m.mtl").unlink()
    with pytest.warns(UserWarning, match=r"files that are missing \(m\.mtl\)"):
        body = only(path)
    assert (body.material.reflectance, body.material.rgb, body.colour) == (0.5, None, None)


def test_16_bit_pictures_are_divided(tmp_path: Path) -> None:
    grey = np.array([[0, 65535], [32768, 256]], np.uint16)
    path = obj(tmp_path, "map_Kd p.png", picture=False)
    Image.fromarray(grey).save(tmp_path / "p.png")
    body = only(path)
    assert body.colour is not None
    np.testing.assert_allclose(body.colour[..., 0], colours.linear((grey >> 8).astype(np.uint8)))


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
def test_vertex_colours_are_linear_over_triangles(tmp_path: Path, suffix: str) -> None:
    """Bilinear interpolation at the centre of a triangle gives the mean of its corners."""
    square = trimesh.Trimesh(CORNERS, FACES, process=False)
    levels = np.array(
        [(150, 200, 130), (190, 150, 140), (170, 180, 190), (160, 140, 160)], np.uint8
    )
    square.visual.vertex_colors = levels  # type: ignore[union-attr]
    square.export(tmp_path / f"m{suffix}")
    body = only(tmp_path / f"m{suffix}")
    assert body.colour is not None and body.mesh.uv is not None and not body.repeats
    height, width = body.colour.shape[:2]
    linear = colours.linear(levels)
    by_place = {
        tuple(np.round(corner, 4)): rgb for corner, rgb in zip(CORNERS, linear, strict=True)
    }
    for face in body.mesh.faces:
        expected = np.mean(
            [by_place[tuple(np.round(v.astype(float), 4))] for v in body.mesh.vertices[face]],
            axis=0,
        )
        x, y = body.mesh.uv[face].mean(axis=0) * (width, height) - 0.5
        left, top = int(x), int(y)
        a, b = x - left, y - top
        square_px = body.colour[top : top + 2, left : left + 2]
        rows = square_px[0] * (1 - b) + square_px[1] * b
        centre = rows[0] * (1 - a) + rows[1] * a
        np.testing.assert_allclose(centre, expected, atol=1e-4)


def test_equal_vertex_colours_are_a_material(tmp_path: Path) -> None:
    square = trimesh.Trimesh(CORNERS, FACES, process=False)
    square.visual.vertex_colors = np.full((4, 3), 188, np.uint8)  # type: ignore[union-attr]
    square.export(tmp_path / "m.ply")
    body = only(tmp_path / "m.ply")
    assert body.colour is None
    assert body.material.rgb == pytest.approx((0.503, 0.503, 0.503), abs=1e-3)


def test_face_colours_of_a_ply(tmp_path: Path) -> None:
    square = trimesh.Trimesh(CORNERS, FACES, process=False)
    square.visual.face_colors = [(255, 0, 0, 255), (0, 0, 255, 255)]  # type: ignore[union-attr]
    square.export(tmp_path / "m.ply")
    body = only(tmp_path / "m.ply")
    assert body.colour is not None
    assert {tuple(pixel) for pixel in body.colour.reshape(-1, 3)} == {(1, 0, 0), (0, 0, 1)}


def test_vertex_colours_of_a_glb_are_linear(tmp_path: Path) -> None:
    square = trimesh.Trimesh(CORNERS, FACES, process=False)
    square.visual.vertex_colors = np.full((4, 3), 51, np.uint8)  # type: ignore[union-attr]
    square.export(tmp_path / "m.glb")
    assert only(tmp_path / "m.glb").material.rgb == pytest.approx((0.2, 0.2, 0.2))


def test_vertex_colours_of_textured_surfaces_are_not_used(tmp_path: Path) -> None:
    def edit(header: dict[str, Any]) -> None:
        attributes = header["meshes"][0]["primitives"][0]["attributes"]
        attributes["COLOR_0"] = attributes["POSITION"]

    with pytest.warns(UserWarning, match="not used: vertex colours of textured surfaces"):
        assert only(glb(tmp_path / "m.glb", edit)).colour is not None


def test_a_ply_names_a_missing_picture(tmp_path: Path) -> None:
    data = trimesh.creation.box((0.1, 0.1, 0.1)).export(file_type="ply", encoding="ascii")
    assert isinstance(data, bytes)
    named = data.replace(b"ascii 1.0\n", b"ascii 1.0\ncomment TextureFile skin.png\n")
    (tmp_path / "m.ply").write_bytes(named)
    with pytest.warns(UserWarning, match=r"files that are missing \(skin\.png\)"):
        load(tmp_path / "m.ply")


@pytest.mark.parametrize("suffix", [".glb", ".ply", ".obj"])
def test_vertex_normals_of_a_file_shade_smoothly(tmp_path: Path, suffix: str) -> None:
    ball = trimesh.creation.icosphere(2, 0.1)
    kind = suffix.removeprefix(".")
    names = {"glb": "include_normals", "ply": "vertex_normal", "obj": "include_normals"}
    ball.export(tmp_path / f"ball{suffix}", file_type=kind, **{names[kind]: True})
    mesh = only(tmp_path / f"ball{suffix}").mesh
    assert mesh.normals is not None
    np.testing.assert_allclose(mesh.normals, mesh.vertices / 0.1, atol=0.02)


def test_normals_without_a_length_are_left_out(tmp_path: Path) -> None:
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS) + "vn 0 0 0\nvn 0 0 1\n"
    (tmp_path / "m.obj").write_text(text + "f 1//1 2//2 3//2\n")
    assert only(tmp_path / "m.obj").mesh.normals is None


def test_vertices_in_a_plane_are_refused(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n")
    with pytest.raises(InputError, match="It cannot be read: its vertices have 2 coordinates"):
        load(tmp_path / "m.obj")


def test_large_pictures_are_reduced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(appearance, "LARGEST_PX", 8)
    assert appearance.reduced(np.zeros((4, 32, 3), np.uint8)).shape == (1, 8, 3)
    assert appearance.reduced(np.zeros((8, 4, 3), np.uint8)).shape == (8, 4, 3)


DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="{unit}"/><up_axis>{up}</up_axis></asset>
<library_images><image id="i"><init_from>p.png</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="su"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="sa"><sampler2D><source>su</source></sampler2D></newparam>
<technique sid="t"><phong>{emission}<diffuse>{diffuse}</diffuse>
<shininess><float>{shininess}</float></shininess></phong></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="m" name="paint"><instance_effect url="#e"/></material>
</library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">-1 -1 0 1 -1 0 1 1 0 -1 1 0</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="u"><float_array id="ua" count="8">0 0 1 0 1 1 0 1</float_array>
<technique_common><accessor source="#ua" count="4" stride="2"><param name="S" type="float"/>
<param name="T" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles material="s" count="2"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#u" offset="0" set="0"/><p>0 1 2 0 2 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="vs"><node id="n"><instance_geometry url="#g">
<bind_material><technique_common><instance_material symbol="s" target="#m"/></technique_common>
</bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#vs"/></scene></COLLADA>"""
_TEXTURED = '<texture texture="sa" texcoord="u"/>'


def dae(folder: Path, **values: str) -> Path:
    pytest.importorskip("collada")
    Image.fromarray(PICTURE).save(folder / "p.png")
    fields = {"unit": "0.01", "up": "Z_UP", "emission": "", "shininess": "0", "diffuse": _TEXTURED}
    (folder / "m.dae").write_text(DAE.format(**{**fields, **values}))
    return folder / "m.dae"


def test_a_dae_has_unit_axis_and_texture(tmp_path: Path) -> None:
    scene = load(dae(tmp_path))
    (body,) = scene.bodies
    assert scene.ambient.up == (0.0, 0.0, 1.0)
    assert np.ptp(body.mesh.vertices, axis=0).tolist() == pytest.approx([0.02, 0.02, 0.0])
    assert body.colour is not None
    np.testing.assert_array_equal(body.colour, PICTURE / 255)
    assert uv_of_corner(body, np.array([-0.01, 0.01, 0.0])) == [0, 0]


def test_colour_and_gloss_of_a_dae(tmp_path: Path) -> None:
    colour = "<color>0.2 0.4 0.6 1</color>"
    material = only(dae(tmp_path, diffuse=colour, shininess="198")).material
    assert material.kind == "glossy" and material.roughness == pytest.approx(0.1)
    assert material.rgb == pytest.approx((0.2, 0.4, 0.6), abs=2e-3)


def test_what_a_dae_holds_in_vain_is_one_warning(tmp_path: Path) -> None:
    path = dae(tmp_path, emission="<emission><color>1 0 0 1</color></emission>")
    with pytest.warns(UserWarning, match=r"m\.dae: not used: emission\.$"):
        load(path)
    path = dae(tmp_path)
    (tmp_path / "p.png").unlink()
    with pytest.warns(UserWarning, match=r"m\.dae: not used: .*missing \(p\.png\)"):
        load(path)


@pytest.mark.parametrize(("values", "reason"), [({"unit": "0"}, "its unit is 0 m")])
def test_damaged_dae_are_refused(tmp_path: Path, values: dict[str, str], reason: str) -> None:
    with pytest.raises(InputError, match=f"It cannot be read: {reason}"):
        load(dae(tmp_path, **values))
    (tmp_path / "m.dae").write_text("<COLLADA")
    with pytest.raises(InputError, match="It cannot be read: it is no XML"):
        load(tmp_path / "m.dae")


def test_a_dae_needs_its_reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "m.dae").write_text(DAE)
    monkeypatch.setitem(sys.modules, "collada", None)
    with pytest.raises(InputError, match=r"DAE needs pycollada; .*\[scenes\]"):
        load(tmp_path / "m.dae")


def test_a_file_without_surprises_gives_no_warning(tmp_path: Path) -> None:
    path = glb(tmp_path / "m.glb")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(path)
