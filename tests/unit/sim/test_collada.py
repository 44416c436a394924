"""DAE files: unit, up axis, looks, and what is refused."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from starling.patterns import InputError
from tests.unit.sim.square import (
    PICTURE,
    load,
    only,
    uv_of_corner,
)

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
