"""USD stages: units, axes, meshes, primitives, looks, and what is refused."""

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from starling.patterns import InputError
from starling.sim.scene import sources
from starling.sim.scene.scene import Body, Scene
from starling.sim.sensor import presets

pytest.importorskip("pxr")
SENSOR = presets.load("d435")
PICTURE = np.array([[(255, 0, 0), (0, 255, 0)], [(0, 0, 255), (255, 255, 255)]], np.uint8)
HEAD = '#usda 1.0\n(upAxis = "{up}"\nmetersPerUnit = {unit})\n'

SQUARE = """def Mesh "square" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
  point3f[] points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
  int[] faceVertexCounts = [4]
  int[] faceVertexIndices = [0, 1, 2, 3]
  texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "{st}")
  {more}
}}
"""
BOUND = "rel material:binding = </paint>"
PAINT = """def Material "paint" {{
  token outputs:surface.connect = </paint/s.outputs:surface>
  def Shader "s" {{
    uniform token info:id = "UsdPreviewSurface"
    {inputs}
    token outputs:surface
  }}
  def Shader "t" {{
    uniform token info:id = "UsdUVTexture"
    asset inputs:file = @./p.png@
    token inputs:wrapS = "{wrap}"
    token inputs:wrapT = "{wrap}"
    float2 inputs:st.connect = </paint/m.outputs:result>
    float3 outputs:rgb
  }}
  def Shader "m" {{
    uniform token info:id = "UsdTransform2d"
    float2 inputs:scale = (2, 1)
    float2 inputs:in.connect = </paint/r.outputs:result>
    float2 outputs:result
  }}
  def Shader "r" {{
    uniform token info:id = "UsdPrimvarReader_float2"
    token inputs:varname = "st"
    float2 outputs:result
  }}
}}
"""
TEXTURED = "color3f inputs:diffuseColor.connect = </paint/t.outputs:rgb>"


def stage(folder: Path, *prims: str, up: str = "Z", unit: float = 0.1) -> Path:
    (folder / "m.usda").write_text(HEAD.format(up=up, unit=unit) + "\n".join(prims))
    Image.fromarray(PICTURE).save(folder / "p.png")
    return folder / "m.usda"


def load(path: Path) -> Scene:
    return sources.load(str(path), SENSOR)


def only(path: Path) -> Body:
    (body,) = load(path).bodies
    return body


def square(more: str = "", st: str = "vertex") -> str:
    return SQUARE.format(more=more, st=st)


def paint(inputs: str, wrap: str = "repeat") -> str:
    return PAINT.format(inputs=inputs, wrap=wrap)


@pytest.mark.parametrize(("up", "direction"), [("Z", (0.0, 0.0, 1.0)), ("Y", (0.0, 1.0, 0.0))])
def test_unit_and_axis_are_the_stages(tmp_path: Path, up: str, direction: Any) -> None:
    scene = load(stage(tmp_path, square(), up=up, unit=0.02))
    assert scene.ambient.up == direction
    assert np.ptp(scene.bodies[0].mesh.vertices, axis=0).tolist() == pytest.approx([0.04, 0.04, 0])
    assert scene.bodies[0].material.reflectance == 0.5


@pytest.mark.parametrize("st", ["vertex", "faceVarying"])
def test_textures_of_a_preview_surface(tmp_path: Path, st: str) -> None:
    path = stage(tmp_path, square(BOUND, st), paint(TEXTURED + "\nfloat inputs:roughness = 0.4"))
    body = only(path)
    assert body.colour is not None and body.mesh.uv is not None and body.repeats
    np.testing.assert_array_equal(body.colour, PICTURE / 255)
    corner = np.abs(body.mesh.vertices - (0.1, 0.1, 0)).sum(axis=1).argmin()
    assert body.mesh.uv[corner].tolist() == [2, 0]  # Upper right; the transform doubles u.
    assert (body.material.name, body.material.kind) == ("paint", "glossy")
    assert body.material.roughness == pytest.approx(0.16)


def test_clamped_textures_do_not_repeat(tmp_path: Path) -> None:
    assert not only(stage(tmp_path, square(BOUND), paint(TEXTURED, "clamp"))).repeats


def test_numbers_of_a_preview_surface(tmp_path: Path) -> None:
    inputs = "color3f inputs:diffuseColor = (0.2, 0.4, 0.6)\nfloat inputs:metallic = 1"
    material = only(stage(tmp_path, square(BOUND), paint(inputs))).material
    assert (material.kind, material.rgb) == ("metal", pytest.approx((0.2, 0.4, 0.6)))


@pytest.mark.parametrize(
    ("interpolation", "values"),
    [
        ("constant", "[(0.1, 0.2, 0.3)]"),
        ("uniform", "[(0.1, 0.2, 0.3)]"),
        ("vertex", "[(0.1, 0.2, 0.3), (0.1, 0.2, 0.3), (0.1, 0.2, 0.3), (0.1, 0.2, 0.3)]"),
    ],
)
def test_display_colours(tmp_path: Path, interpolation: str, values: str) -> None:
    more = f'color3f[] primvars:displayColor = {values} (interpolation = "{interpolation}")'
    assert only(stage(tmp_path, square(more))).material.rgb == pytest.approx((0.1, 0.2, 0.3))


def test_subsets_have_materials_of_their_own(tmp_path: Path) -> None:
    text = """def Mesh "m" {
      point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
      int[] faceVertexCounts = [3, 3]
      int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
      normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)] (interpolation = "vertex")
      def GeomSubset "half" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1]
        rel material:binding = </paint>
      }
    }"""
    bodies = load(stage(tmp_path, text, paint("color3f inputs:diffuseColor = (1, 0, 0)"))).bodies
    assert [body.name for body in bodies] == ["/m/half", "/m"]
    assert [len(body.mesh.faces) for body in bodies] == [1, 1]
    assert [body.material.rgb for body in bodies] == [(1.0, 0.0, 0.0), None]
    assert all(body.mesh.normals is not None for body in bodies)


@pytest.mark.parametrize(
    ("prim", "size"),
    [
        ('def Cube "p" { double size = 4 }', (4, 4, 4)),
        ('def Sphere "p" { double radius = 2 }', (4, 4, 4)),
        ('def Cylinder "p" { double radius = 1 double height = 6 token axis = "X" }', (6, 2, 2)),
        ('def Capsule "p" { double radius = 1 double height = 4 token axis = "Y" }', (2, 6, 2)),
        ('def Cone "p" { double radius = 1 double height = 4 token axis = "Z" }', (2, 2, 4)),
        ('def Plane "p" { double width = 2 double length = 4 token axis = "Z" }', (2, 4, 0)),
        ('def Plane "p" { double width = 2 double length = 4 token axis = "Y" }', (2, 0, 4)),
        ('def Plane "p" { double width = 2 double length = 4 token axis = "X" }', (0, 4, 2)),
    ],
)
def test_primitives_are_centred_and_of_their_size(
    tmp_path: Path, prim: str, size: tuple[float, ...]
) -> None:
    prim = (
        prim.replace(" double", "\ndouble")
        .replace(" token", "\nuniform token")
        .replace(" }", "\n}")
    )
    vertices = only(stage(tmp_path, prim)).mesh.vertices
    assert np.ptp(vertices, axis=0).tolist() == pytest.approx(
        [0.1 * side for side in size], abs=0.01
    )
    assert (vertices.min(axis=0) + vertices.max(axis=0)).tolist() == pytest.approx(
        [0] * 3, abs=1e-6
    )


def test_places_and_mirrors(tmp_path: Path) -> None:
    """Triangles of a mirrored mesh still face outwards."""
    text = """def Xform "up" {
      double3 xformOp:translate = (0, 0, 5)
      double3 xformOp:scale = (-1, 1, 1)
      uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
      def Cube "box" {
        color3f[] primvars:displayColor = [(1, 0, 0)]
      }
      def Cube "hidden" {
        token visibility = "invisible"
      }
      def Cube "helper" {
        uniform token purpose = "guide"
      }
    }"""
    body = only(stage(tmp_path, text))
    corners = body.mesh.vertices[body.mesh.faces] - np.array((0, 0, 0.5), np.float32)
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", outwards, corners.mean(axis=1)) > 0).all()
    assert body.material.rgb == (1.0, 0.0, 0.0)


def test_left_handed_meshes_are_turned(tmp_path: Path) -> None:
    mesh = only(stage(tmp_path, square('uniform token orientation = "leftHanded"'))).mesh
    a, b, c = mesh.vertices[mesh.faces[0]]
    assert np.cross(b - a, c - a)[2] < 0


@pytest.mark.parametrize(
    ("prims", "words"),
    [
        ([square(), 'def SphereLight "l" {}', 'def Camera "c" {}'], "cameras, lights"),
        ([square(BOUND), paint("float inputs:opacity = 0.5")], "transparency"),
        ([square(BOUND), paint("color3f inputs:emissiveColor = (1, 0, 0)")], "emission"),
        (
            [square(BOUND), paint("normal3f inputs:normal.connect = </paint/t.outputs:rgb>")],
            "normal maps",
        ),
        ([square(BOUND), paint(TEXTURED, "mirror")], "mirrored repetition of textures"),
        (
            [square(BOUND), paint("").replace("UsdPreviewSurface", "ND_standard")],
            "materials other than UsdPreviewSurface and OmniPBR",
        ),
        ([square(BOUND, "constant"), paint(TEXTURED)], "textures without coordinates"),
    ],
)
def test_what_a_stage_holds_in_vain_is_one_warning(
    tmp_path: Path, prims: list[str], words: str
) -> None:
    with pytest.warns(UserWarning, match=rf"m\.usda: not used: {words}"):
        load(stage(tmp_path, *prims))


OMNIVERSE = """def Material "paint" {{
  token outputs:mdl:surface.connect = </paint/s.outputs:out>
  def Shader "s" {{
    uniform token info:implementationSource = "sourceAsset"
    uniform asset info:mdl:sourceAsset = @OmniPBR.mdl@
    uniform token info:mdl:sourceAsset:subIdentifier = "OmniPBR"
    {inputs}
    token outputs:out
  }}
}}
"""


def omniverse(folder: Path, inputs: str) -> Path:
    return stage(folder, square(BOUND), OMNIVERSE.format(inputs=inputs))


def test_materials_of_omniverse(tmp_path: Path) -> None:
    numbers = "float inputs:metallic_constant = 1\nfloat inputs:reflection_roughness_constant = 0.3"
    colour = "color3f inputs:diffuse_color_constant = (0.1, 0.2, 0.3)"
    material = only(omniverse(tmp_path, f"{numbers}\n{colour}")).material
    assert (material.kind, material.name) == ("metal", "paint")
    assert material.roughness == pytest.approx(0.09)
    assert material.rgb == pytest.approx((0.1, 0.2, 0.3))
    body = only(omniverse(tmp_path, "asset inputs:diffuse_texture = @./p.png@"))
    assert body.colour is not None and body.repeats
    np.testing.assert_array_equal(body.colour, PICTURE / 255)


@pytest.mark.parametrize(
    ("inputs", "words"),
    [
        ("bool inputs:enable_emission = 1", "emission"),
        ("asset inputs:normalmap_texture = @./p.png@", "normal maps"),
        ("float2 inputs:texture_scale = (2, 2)", "scale of textures"),
        ("asset inputs:diffuse_texture = @./q.png@", "textures that cannot be read"),
    ],
)
def test_what_an_omniverse_material_holds_in_vain(tmp_path: Path, inputs: str, words: str) -> None:
    with pytest.warns(UserWarning, match=rf"m\.usda: not used: {words}"):
        load(omniverse(tmp_path, inputs))


def test_values_that_change_nothing_are_not_reported(tmp_path: Path) -> None:
    inputs = "bool inputs:enable_emission = 0\nfloat2 inputs:texture_scale = (1, 1)"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(omniverse(tmp_path, inputs))


def test_missing_textures_are_named(tmp_path: Path) -> None:
    path = stage(tmp_path, square(BOUND), paint(TEXTURED))
    (tmp_path / "p.png").unlink()
    with pytest.warns(UserWarning, match=r"textures that cannot be read, files .*p\.png"):
        load(path)


def test_pictures_in_a_package_are_read(tmp_path: Path) -> None:
    from starling.sim.scene.meshes.usd_looks import pxr

    path = stage(tmp_path, square(BOUND), paint(TEXTURED))
    package = tmp_path / "m.usdz"
    pxr("UsdUtils").CreateNewUsdzPackage(str(path), str(package))
    colour = only(package).colour
    assert colour is not None and colour.shape == (2, 2, 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no stage", "It cannot be read: it is no USD stage"),
        (
            "#usda 1.0\n(subLayers = [@./other.usda@])\n",
            "layers that it names are missing: .*other",
        ),
        (HEAD.format(up="Y", unit=1), "scene must hold triangles"),
        (HEAD.format(up="Y", unit=0) + square(), "its unit is 0 m, and its up axis Y"),
        (HEAD.format(up="9", unit=1) + square(), "its unit is 1 m, and its up axis 9"),
        (
            HEAD.format(up="Y", unit=1) + square().replace("[0, 1, 2, 3]", "[0, 1, 2, 9]"),
            "a triangle has a vertex that is missing",
        ),
        (
            HEAD.format(up="Y", unit=1) + square().replace("[4]", "[3]"),
            "/square has 4 corners, and its faces count otherwise",
        ),
    ],
)
def test_damaged_stages_are_refused(
    tmp_path: Path, text: str, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m.usda").write_text(text)
    with pytest.raises(InputError, match=message):
        load(tmp_path / "m.usda")
    assert capfd.readouterr().err == ""


def test_a_damaged_picture_is_refused(tmp_path: Path) -> None:
    path = stage(tmp_path, square(BOUND), paint(TEXTURED))
    (tmp_path / "p.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"p\.png is no picture"):
        load(path)


def test_a_stage_needs_its_reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pxr.Usd", None)
    with pytest.raises(InputError, match=r"USD needs usd-core; .*\[scenes\]"):
        load(stage(tmp_path, square()))


def test_prototypes_below_an_instancer_are_not_drawn(tmp_path: Path) -> None:
    below = f'def PointInstancer "many" {{\n{square()}\n}}'
    path = stage(tmp_path, 'def Cube "box" {}', below)
    with pytest.warns(UserWarning, match="not used: point instancers"):
        assert only(path).name == "/box"


@pytest.mark.parametrize("face", [-1, 1])
def test_subsets_of_faces_that_are_missing_are_refused(tmp_path: Path, face: int) -> None:
    subset = f"""def GeomSubset "some" {{
      uniform token elementType = "face"
      uniform token familyName = "materialBind"
      int[] indices = [{face}]
    }}"""
    with pytest.raises(InputError, match="/square/some has a face that is missing"):
        load(stage(tmp_path, square(subset)))
