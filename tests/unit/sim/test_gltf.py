"""GLB files: what the mesh reader would ignore is refused or reported."""

import json
import struct
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import trimesh

from starling.patterns import InputError
from starling.sim.scene import sources

IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]

Edit = Callable[[dict[str, Any]], object]


def _glb(path: Path, edit: Edit) -> Path:
    """Write a box whose JSON is edited."""
    data = trimesh.creation.box().export(file_type="glb")
    assert isinstance(data, bytes)
    (length,) = struct.unpack_from("<I", data, 12)
    header = json.loads(data[20 : 20 + length])
    edit(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunk = struct.pack("<I4s", len(text), b"JSON") + text + data[20 + length :]
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunk)) + chunk)
    return path


def _primitive(header: dict[str, Any]) -> dict[str, Any]:
    return header["meshes"][0]["primitives"][0]


def _positions(header: dict[str, Any]) -> dict[str, Any]:
    return header["accessors"][_primitive(header)["attributes"]["POSITION"]]


@pytest.mark.parametrize(
    ("edit", "reason"),
    [
        (
            lambda header: header.update(extensionsRequired=["KHR_materials_unlit", "EXT_moved"]),
            "it requires EXT_moved, which is not supported",
        ),
        (
            lambda header: header.update(extensionsRequired=["KHR_draco_mesh_compression"]),
            "it requires KHR_draco_mesh_compression",
        ),
        (lambda header: header["bufferViews"][0].update(byteOffset=-4), "byteOffset is -4"),
        (lambda header: header["bufferViews"][0].update(byteLength=-4), "byteLength is -4"),
        (lambda header: header["bufferViews"][0].update(buffer=3), "buffer 3 is missing"),
        (
            lambda header: header["bufferViews"][1].update(byteLength=10**12),
            r"buffer view 1 ends at byte \d+ of \d+",
        ),
        (
            lambda header: header["buffers"][0].update(byteLength=10**12),
            r"its buffer has 1000000000000 bytes, and \d+ follow",
        ),
        (lambda header: header["accessors"][0].update(count=-1), "count is -1"),
        (
            lambda header: header["accessors"][0].update(count=10**9),
            r"accessor 0 ends at byte \d+ of \d+",
        ),
        (lambda header: header["accessors"][0].update(bufferView=-1), "bufferView is -1"),
        (lambda header: header["accessors"][0].update(bufferView=9), "bufferView 9 is missing"),
        (lambda header: _primitive(header).update(mode=6), "triangle fans are not supported"),
        (lambda header: _positions(header).update(sparse={}), r"accessor \d is sparse"),
        (lambda header: _positions(header).update(normalized=True), r"accessor \d is normalized"),
        (lambda header: _primitive(header).pop("attributes"), "attributes"),
        (
            lambda header: header["nodes"][-1].update(matrix=[1e30] * 16),
            r"the matrix of node \d is not affine",
        ),
        (
            lambda header: header["nodes"][-1].update(matrix=[*IDENTITY[:-1], 2]),
            r"the matrix of node \d is not affine",
        ),
        (
            lambda header: header["nodes"][-1].update(matrix=[1e7, *IDENTITY[1:]]),
            r"the matrix of node \d is not affine, or out of range",
        ),
        (lambda header: _primitive(header).update(indices=True), "indices is true"),
        (
            lambda header: _primitive(header).update(
                indices=_primitive(header)["attributes"]["POSITION"]
            ),
            "indices must not be of type VEC3, 5126",
        ),
        (
            lambda header: _positions(header).update(componentType=5125),
            "POSITION must not be of type VEC3, 5125",
        ),
    ],
)
def test_what_would_be_read_wrongly_is_refused(tmp_path: Path, edit: Edit, reason: str):
    path = _glb(tmp_path / "box.glb", edit)
    with pytest.raises(InputError, match=rf"box\.glb\. It cannot be read: .*{reason}"):
        sources.mesh_parts(path)


@pytest.mark.parametrize("data", [b"", b"not one", b"glTF", b"glTF" + b"\xff" * 40])
def test_damaged_headers_are_refused_with_a_reason(tmp_path: Path, data: bytes):
    (tmp_path / "box.glb").write_bytes(data)
    with pytest.raises(InputError, match=r"It cannot be read: \S"):
        sources.mesh_parts(tmp_path / "box.glb")


def test_an_error_without_a_text_gets_a_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def fail(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr(trimesh, "load_scene", fail)
    path = _glb(tmp_path / "box.glb", lambda header: None)
    with pytest.raises(InputError, match="It cannot be read: its parts contradict each other"):
        sources.mesh_parts(path)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda header: header["nodes"][-1].update(skin=0), r"glb: skins are not applied"),
        (
            lambda header: _primitive(header).update(targets=[{"POSITION": 0}]),
            "glb: morph targets are not applied",
        ),
        (
            lambda header: (
                header["nodes"][-1].update(skin=0),
                _primitive(header).update(targets=[{"POSITION": 0}]),
            ),
            "glb: skins and morph targets are not applied",
        ),
    ],
)
def test_skins_and_morph_targets_give_one_warning(tmp_path: Path, edit: Edit, message: str):
    path = _glb(tmp_path / "box.glb", edit)
    with pytest.warns(UserWarning, match=message) as caught:
        assert sources.mesh_parts(path)
    assert len(caught) == 1


def test_extensions_of_looks_are_read_without_a_warning(tmp_path: Path):
    names = ["KHR_materials_unlit", "KHR_texture_transform", "KHR_lights_punctual"]
    path = _glb(tmp_path / "box.glb", lambda header: header.update(extensionsRequired=names))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ((_, mesh),) = sources.mesh_parts(path)
    assert len(mesh.faces) == 12
