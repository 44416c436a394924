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
        '<texture type="checkerboard" name="reflectance"><transform name="to_uv">'
        '<scale value="8"/></transform></texture>',
    ],
)
def test_shares_of_light_inside_their_range_are_read(tmp_path: Path, values: str):
    assert mitsuba_xml.load(_surface(tmp_path / "scene.xml", values)).shapes
