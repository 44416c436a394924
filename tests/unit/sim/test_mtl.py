"""Looks of OBJ files: materials of their MTL, pictures, and what is not used."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from starling.patterns import InputError
from starling.sim.scene import colours
from tests.unit.sim.square import (
    load,
    obj,
    only,
)


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
        ("map_Kd m.mtl", r"textures that cannot be read \(m\.mtl\)"),
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


def test_a_picture_of_floating_point_numbers_is_refused(tmp_path: Path) -> None:
    path = obj(tmp_path, "map_Kd f.tiff")
    Image.fromarray(np.full((2, 2), 0.5, np.float32)).save(tmp_path / "f.tiff")
    with pytest.raises(InputError, match="a texture cannot be read: it holds floating-point"):
        load(path)


@pytest.mark.parametrize(
    "options", ["-clamp on", "-blendu off -mm 0.1 1.5", "-imfchan l", "-bm 1e-1 -texres 512"]
)
def test_options_of_a_picture_are_no_part_of_its_name(tmp_path: Path, options: str) -> None:
    plain = only(obj(tmp_path, "map_Kd p.png"))
    assert plain.colour is not None
    body = only(obj(tmp_path, f"map_Kd {options} p.png"))
    assert body.colour is not None and np.array_equal(body.colour, plain.colour)


@pytest.mark.parametrize("options", ["-s 2 2 1", "-clamp on -o 0.5"])
def test_a_moved_picture_is_one_warning(tmp_path: Path, options: str) -> None:
    path = obj(tmp_path, f"map_Kd {options} p.png")
    with pytest.warns(UserWarning, match=r"not used: offset and scale of textures\.$"):
        load(path)


def test_byte_order_marks_are_no_content(tmp_path: Path) -> None:
    path = obj(tmp_path, "map_Kd p.png")
    expected = only(path)
    for file in (path, tmp_path / "m.mtl"):
        file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    body = only(path)
    assert body.colour is not None and expected.colour is not None
    assert np.array_equal(body.colour, expected.colour)
    assert np.array_equal(body.mesh.vertices, expected.mesh.vertices)
