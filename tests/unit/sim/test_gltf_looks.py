"""Looks of GLB files: base colour, metal, roughness, wrap modes, and what is not used."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from starling.patterns import InputError
from starling.sim.scene import colours
from tests.unit.sim.square import (
    CORNERS,
    PICTURE,
    Edit,
    glb,
    load,
    material_of,
    obj,
    only,
    uv_of_corner,
)


@pytest.mark.parametrize("kind", ["glb", "obj"])
def test_the_top_row_of_a_picture_lies_at_v_0(tmp_path: Path, kind: str) -> None:
    body = only(glb(tmp_path / "m.glb") if kind == "glb" else obj(tmp_path, "map_Kd p.png"))
    assert body.colour is not None and body.texture is not None and body.repeats
    np.testing.assert_array_equal(body.colour, PICTURE / 255)
    np.testing.assert_array_equal(body.texture, colours.near_infrared(body.colour))
    assert uv_of_corner(body, CORNERS[3]) == [0, 0]  # Upper left.
    assert uv_of_corner(body, CORNERS[1]) == [1, 1]


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


def test_vertex_colours_of_textured_surfaces_are_not_used(tmp_path: Path) -> None:
    def edit(header: dict[str, Any]) -> None:
        attributes = header["meshes"][0]["primitives"][0]["attributes"]
        attributes["COLOR_0"] = attributes["POSITION"]

    with pytest.warns(UserWarning, match="not used: vertex colours of textured surfaces"):
        assert only(glb(tmp_path / "m.glb", edit)).colour is not None


def test_a_file_without_surprises_gives_no_warning(tmp_path: Path) -> None:
    path = glb(tmp_path / "m.glb")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(path)
