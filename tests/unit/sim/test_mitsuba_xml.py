"""Mitsuba XML of other people: included files, damaged meshes and impossible values."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from starling.patterns import InputError
from starling.sim.render import backend
from starling.sim.scene import mitsuba_xml

LAMP = '<emitter type="area"><rgb name="radiance" value="50"/></emitter>'
BALL = '<shape type="sphere">{}</shape>'
DIFFUSE = '<bsdf type="diffuse">{}</bsdf>'
MESH = '<shape type="{0}"><string name="filename" value="ball.{0}"/></shape>'


def _write(path: Path, content: str) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text(f'<scene version="3.0.0">\n{content}\n</scene>')
    return path


def _surface(path: Path, values: str) -> Path:
    return _write(path, BALL.format(DIFFUSE.format(values)))


@pytest.mark.parametrize(
    "lamps",
    [
        BALL.format(LAMP),
        '<emitter type="constant"/>' + BALL.format(""),
        '<emitter type="area" id="lamp"/>' + BALL.format('<ref id="lamp"/>'),
        '<emitter type="envmap"><string name="filename" value="gone.exr"/></emitter>'
        + BALL.format(""),
    ],
)
@pytest.mark.parametrize("depth", [0, 1, 2])
def test_lamps_are_removed_from_included_files_too(tmp_path: Path, lamps: str, depth: int):
    content = lamps
    for number in range(depth):
        _write(tmp_path / "parts" / f"{number}.xml", content)
        content = f'<default name="n{number}" value="parts/{number}"/>'
        content += f'<include filename="$n{number}.xml"/>'
    scene = mitsuba_xml.load(_write(tmp_path / "scene.xml", content))
    (shape,) = scene.shapes
    assert not shape.is_emitter()
    loaded = backend.mitsuba().load_dict({"type": "scene", "shape": shape})
    assert not loaded.emitters()


def test_the_sensor_of_an_included_file_is_used(tmp_path: Path):
    sensor = '<sensor type="perspective"><transform name="to_world">'
    sensor += '<translate x="1" y="2" z="3"/></transform></sensor>'
    _write(tmp_path / "inner.xml", sensor + BALL.format(""))
    scene = mitsuba_xml.load(_write(tmp_path / "scene.xml", '<include filename="inner.xml"/>'))
    assert np.allclose(scene.world_from_left[:3, 3], (1, 2, 3))


@pytest.mark.parametrize(
    ("inner", "message"),
    [
        ('<shape type="instance"/>', "scene must not hold instances"),
        ('<include filename="pipe"/>', r"must name regular files; got .*pipe in .*inner\.xml"),
        (
            '<path value="more"/><shape type="ply"><string name="filename" value="deep"/></shape>',
            r"must name regular files; got .*more/deep in .*inner\.xml",
        ),
        ('<include filename="inner.xml"/>', "scene must be a Mitsuba XML"),
        ('<include filename="gone.xml"/>', r"scene must be a Mitsuba XML; got gone\.xml"),
        ("<shape", r"scene must be a Mitsuba XML; got .*inner\.xml"),
    ],
)
def test_included_files_are_checked(tmp_path: Path, inner: str, message: str):
    (tmp_path / "more").mkdir()
    os.mkfifo(tmp_path / "pipe")
    os.mkfifo(tmp_path / "more" / "deep")
    _write(tmp_path / "inner.xml", inner)
    with pytest.raises(InputError, match=message):
        mitsuba_xml.load(_write(tmp_path / "scene.xml", '<include filename="inner.xml"/>'))


def test_a_mesh_is_not_taken_from_the_folder_of_an_earlier_scene(tmp_path: Path):
    first = _write(tmp_path / "first" / "scene.xml", MESH.format("ply"))
    trimesh.creation.icosphere(1).export(first.parent / "ball.ply")
    assert mitsuba_xml.load(first).shapes
    with pytest.raises(InputError, match=r"in .*second/scene\.xml must be a mesh; got ball\.ply"):
        mitsuba_xml.load(_write(tmp_path / "second" / "scene.xml", MESH.format("ply")))


@pytest.mark.parametrize("corner", [42, -1, 2_000_000_000])
@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_mesh_with_a_missing_vertex_is_refused(tmp_path: Path, corner: int, encoding: str):
    """Mitsuba reads other memory as the vertex, or ends the process."""
    data = trimesh.creation.icosphere(1).export(file_type="ply", encoding=encoding)
    assert isinstance(data, bytes)
    if encoding == "binary":
        data = data[:-4] + np.int32(corner).tobytes()
    else:
        data = re.sub(rb"\d+\s*$", str(corner).encode() + b"\n", data)
    (tmp_path / "ball.ply").write_bytes(data)
    message = r"shape in .*scene\.xml must be a mesh; got .*ball\.ply\. .*a vertex that is missing"
    with pytest.raises(InputError, match=message):
        mitsuba_xml.load(_write(tmp_path / "scene.xml", MESH.format("ply")))


@pytest.mark.parametrize(
    ("values", "name", "got"),
    [
        ('<rgb name="reflectance" value="-1"/>', "reflectance", "-1.0"),
        ('<rgb name="reflectance" value="5"/>', "reflectance", "5.0"),
        ('<rgb name="reflectance" value="nan"/>', "reflectance", "nan"),
        ('<rgb name="reflectance" value="-1, 1, 1"/>', "reflectance", "-1.0"),
        ('<spectrum name="reflectance" value="1.5"/>', "reflectance", "1.5"),
        ('<float name="reflectance" value="inf"/>', "reflectance", "inf"),
        ('<integer name="reflectance" value="2"/>', "reflectance", "2.0"),
        ('<spectrum name="reflectance" value="400:0.1, 900:40"/>', "reflectance", "40.0"),
        (
            '<texture type="checkerboard" name="reflectance"><rgb name="color0" value="3"/>'
            "</texture>",
            "reflectance",
            "3.0",
        ),
    ],
)
def test_a_reflectance_outside_its_range_is_refused(
    tmp_path: Path, values: str, name: str, got: str
):
    message = rf"{name} in .*scene\.xml \(line 2.*\) must be in \[0, 1\]; got {got}\."
    with pytest.raises(InputError, match=message):
        mitsuba_xml.load(_surface(tmp_path / "scene.xml", values))


@pytest.mark.parametrize(
    ("plugin", "name"),
    [
        ("roughplastic", "diffuse_reflectance"),
        ("plastic", "specular_reflectance"),
        ("dielectric", "specular_transmittance"),
        ("principled", "base_color"),
    ],
)
def test_other_shares_of_light_are_checked(tmp_path: Path, plugin: str, name: str):
    inner = f'<bsdf type="{plugin}"><rgb name="{name}" value="1.25"/></bsdf>'
    _write(tmp_path / "inner.xml", f'<bsdf type="twosided" id="a">{inner}</bsdf>')
    text = '<include filename="inner.xml"/>' + BALL.format('<ref id="a"/>')
    if plugin == "dielectric":
        _write(tmp_path / "inner.xml", inner.replace("<bsdf", '<bsdf id="a"', 1))
    with pytest.raises(InputError, match=rf"{name} in .*inner\.xml \(line 2.*got 1\.25"):
        mitsuba_xml.load(_write(tmp_path / "scene.xml", text))


@pytest.mark.parametrize("value", [-1.0, 5.0, np.nan])
def test_a_texture_outside_its_range_is_refused(tmp_path: Path, value: float):
    values = np.full((4, 4, 3), 0.5, np.float32)
    values[1, 2] = value
    backend.mitsuba().Bitmap(values).write(str(tmp_path / "a.pfm"))
    texture = '<texture type="bitmap" name="reflectance">'
    texture += '<string name="filename" value="a.pfm"/></texture>'
    message = rf"reflectance of a texture in .*scene\.xml must be in \[0, 1\]; got {value}"
    with pytest.raises(InputError, match=message):
        mitsuba_xml.load(_surface(tmp_path / "scene.xml", texture))


@pytest.mark.parametrize(("level", "is_refused"), [(0.75, False), (75.0, True)])
def test_colours_of_vertices_are_checked(tmp_path: Path, level: float, is_refused: bool):
    corners = "".join(f"{x} {y} 0 {level} {level} {level}\n" for x, y in ((0, 0), (1, 0), (0, 1)))
    names = "".join(f"property float {name}\n" for name in "xyzrgb")
    header = f"ply\nformat ascii 1.0\nelement vertex 3\n{names}element face 1\n"
    header += "property list uchar int vertex_indices\nend_header\n"
    (tmp_path / "ball.ply").write_text(f"{header}{corners}3 0 1 2\n")
    texture = '<texture type="mesh_attribute" name="reflectance">'
    texture += '<string name="name" value="vertex_color"/></texture>'
    text = MESH.format("ply").replace("</shape>", DIFFUSE.format(texture) + "</shape>")
    path = _write(tmp_path / "scene.xml", text)
    if is_refused:
        with pytest.raises(InputError, match=r"vertex_color of a texture in .* got 75\.0"):
            mitsuba_xml.load(path)
    else:
        assert mitsuba_xml.load(path).shapes


@pytest.mark.parametrize(
    "values",
    [
        '<rgb name="reflectance" value="0, 0.5, 1"/>',
        '<spectrum name="reflectance" value="400:0, 900:1"/>',
        '<spectrum name="reflectance" type="uniform"><float name="value" value="0.3"/></spectrum>',
        '<spectrum name="reflectance" value="400:0, 500:0.5, 900:1"/>',
        '<texture type="checkerboard" name="reflectance"><transform name="to_uv">'
        '<scale value="8"/></transform></texture>',
    ],
)
def test_shares_of_light_inside_their_range_are_read(tmp_path: Path, values: str):
    assert mitsuba_xml.load(_surface(tmp_path / "scene.xml", values)).shapes


@pytest.mark.parametrize(
    ("material", "message"),
    [
        ('<bsdf type="blendbsdf"/>', "blendbsdf in {} must have 2 materials inside; got 0"),
        (
            f'<bsdf type="blendbsdf">{DIFFUSE.format("")}</bsdf>',
            "blendbsdf in {} must have 2 materials inside; got 1",
        ),
        ('<bsdf type="mask"/>', "mask in {} must have 1 material inside; got 0"),
        (
            '<bsdf type="twosided"><bsdf type="bumpmap"/></bsdf>',
            "bumpmap in {} must have 1 material inside; got 0",
        ),
        ('<bsdf type="twosided"/>', "twosided in {} must have 1 or 2 materials inside; got 0"),
        ('<bsdf type="hair"/>', "bsdf in {} must be a known name; got 'hair'"),
        (
            '<bsdf type="bumpmap"><texture type="checkerboard"/><bsdf type="diffuse"/></bsdf>',
            "bumpmap in {} must have a bitmap as texture; got checkerboard",
        ),
        (
            DIFFUSE.format('<texture type="bitmap" name="reflectance"/>'),
            "bitmap in {} must have a filename; got none",
        ),
        (
            DIFFUSE.format('<texture type="volume" name="reflectance"/>'),
            "texture in {} must be a known name; got 'volume'",
        ),
        ('<bsdf type="velvet"/>', "bsdf in {} must be a known name; got 'velvet'"),
    ],
)
def test_materials_that_would_end_the_process_are_refused(
    tmp_path: Path, material: str, message: str
):
    place = r".*scene\.xml \(line .*\)"
    with pytest.raises(InputError, match=message.format(place)):
        mitsuba_xml.load(_write(tmp_path / "scene.xml", BALL.format(material)))


@pytest.mark.parametrize("row", ["0 0 0 2", "0 0 1 1", "0, 0, 0, 0.5"])
def test_a_matrix_that_is_not_affine_is_refused(tmp_path: Path, row: str):
    """Mitsuba ignores the row."""
    matrix = f'<default name="row" value="{row}"/>'
    place = '<transform name="to_world"><matrix value="1 0 0 0 0 1 0 0 0 0 1 0 {}"/></transform>'
    path = _write(tmp_path / "scene.xml", matrix + BALL.format(place.format("$row")))
    message = r"matrix in .*scene\.xml must end with the row 0 0 0 1; got 0 0"
    with pytest.raises(InputError, match=message):
        mitsuba_xml.load(path)


@pytest.mark.parametrize("matrix", ["1 0 0 0 1 0 0 0 1", "2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1"])
def test_affine_matrices_are_read(tmp_path: Path, matrix: str):
    place = f'<transform name="to_world"><matrix value="{matrix}"/></transform>'
    assert mitsuba_xml.load(_write(tmp_path / "scene.xml", BALL.format(place))).shapes


def test_a_matrix_without_numbers_is_refused(tmp_path: Path):
    place = f'<transform name="to_world"><matrix value="{"x " * 16}"/></transform>'
    with pytest.raises(InputError, match="scene must be a Mitsuba XML"):
        mitsuba_xml.load(_write(tmp_path / "scene.xml", BALL.format(place)))


CHECKS = '<texture type="checkerboard" name="reflectance"/>'
ONE_SIDED = {
    "none": "",
    "diffuse": DIFFUSE.format('<rgb name="reflectance" value="0.5"/>'),
    "textured": DIFFUSE.format(CHECKS),
    "plastic": '<bsdf type="roughplastic"/>',
    "metal": '<bsdf type="principled"><float name="metallic" value="1"/></bsdf>',
    "mask": f'<bsdf type="mask"><float name="opacity" value="0.7"/>{DIFFUSE.format("")}</bsdf>',
    "blend": f'<bsdf type="blendbsdf"><float name="weight" value="0.25"/>{DIFFUSE.format("")}'
    '<bsdf type="plastic"/></bsdf>',
    "twosided": f'<bsdf type="twosided">{DIFFUSE.format("")}</bsdf>',
}


@pytest.mark.parametrize("name", ONE_SIDED)
def test_surfaces_reflect_equally_on_both_sides(tmp_path: Path, name: str):
    """A rectangle's front is at +z. Its back reflects as much light as the front."""
    material = ONE_SIDED[name]
    square = f'<shape type="rectangle">{material}</shape>'
    scene = mitsuba_xml.load(_write(tmp_path / "scene.xml", square))
    mi = backend.mitsuba()
    world = mi.load_dict({"type": "scene", "shape": scene.shapes[0]})
    shares = []
    for side in (1.0, -1.0):
        ray = mi.Ray3f(mi.Point3f(0.3, 0.2, 2 * side), mi.Vector3f(0, 0, -side))
        surface = world.ray_intersect(ray)
        outgoing = mi.Vector3f(0.6, 0.0, 0.8 * side)
        value = surface.bsdf().eval(mi.BSDFContext(), surface, surface.to_local(outgoing), True)
        albedo = surface.bsdf().eval_diffuse_reflectance(surface, True)
        shares.append((float(value[0][0]), float(albedo[0][0])))
    assert shares[0] == pytest.approx(shares[1], rel=1e-5)
    assert shares[0][0] > 0


def test_glass_keeps_its_sides(tmp_path: Path):
    glass = '<bsdf type="dielectric"/>'
    thin = '<bsdf type="principled"><float name="spec_trans" value="0.5"/></bsdf>'
    text = BALL.format(glass) + BALL.format(thin)
    shapes = mitsuba_xml.load(_write(tmp_path / "scene.xml", text)).shapes
    names = {type(shape.bsdf()).__name__ + str(shape.bsdf())[:10] for shape in shapes}
    assert len(names) == 2 and not any("TwoSided" in name for name in names)
