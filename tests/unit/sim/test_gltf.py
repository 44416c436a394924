"""GLB files: what the mesh reader would ignore is refused or reported."""

import warnings
from pathlib import Path
from typing import Any

import pytest
import trimesh

from starling.patterns import InputError
from starling.sim.scene import sources
from tests.unit.sim.square import Edit, edited

IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


def _glb(path: Path, edit: Edit) -> Path:
    """Write a box whose JSON is edited."""
    data = trimesh.creation.box().export(file_type="glb")
    assert isinstance(data, bytes)
    return edited(data, path, edit)


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
        (lambda header: header["nodes"][0].update(children=[0]), "node 0 is above itself"),
        (
            lambda header: header["nodes"].extend([{"children": [2]}, {"children": [1]}]),
            r"node \d is above itself",
        ),
        (
            lambda header: header["nodes"].extend(
                [{"children": [0, 2]}, {"children": [3]}, {"children": [1]}]
            ),
            r"node \d is above itself",
        ),
        (lambda header: header["nodes"][0].update(children=[99]), "node 99 is missing"),
        (lambda header: header["scenes"][0].update(nodes=[99]), "node 99 is missing"),
        (lambda header: header["nodes"].extend([{"children": [0]}] * 2), "node 0 has two parents"),
        (lambda header: header["scenes"][0].update(nodes=[0, 0]), "node 0 is in a scene twice"),
        (lambda header: header["nodes"].append({"children": [0]}), "node 0 is in a scene twice"),
        (
            lambda header: header["nodes"][-1].update(rotation=[0, 0, 0, 2]),
            r"the rotation of node \d must have the length 1",
        ),
        (
            lambda header: header["nodes"][-1].update(rotation=[0, 1]),
            r"the rotation of node \d must have the length 1",
        ),
        (
            lambda header: header.update(
                materials=[{"pbrMetallicRoughness": {"baseColorFactor": [9, 1, 1, 1]}}]
            ),
            r"baseColorFactor of material 0 must be in \[0, 1\]; got 9",
        ),
        (
            lambda header: header["bufferViews"][_positions(header)["bufferView"]].update(
                byteStride=4
            ),
            r"the byteStride of accessor \d must be at least 12",
        ),
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


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (
            lambda header: header["nodes"][-1].update(extensions={"EXT_mesh_gpu_instancing": {}}),
            "glb: EXT_mesh_gpu_instancing is not applied. Export the meshes without it",
        ),
        (
            lambda header: _positions(header).update(min=[5, 5, 5], max=[6, 6, 6]),
            r"glb: the vertices of accessor \d lie outside its min and max",
        ),
    ],
)
def test_what_may_be_missing_gives_a_warning(tmp_path: Path, edit: Edit, message: str):
    path = _glb(tmp_path / "box.glb", edit)
    with pytest.warns(UserWarning, match=message) as caught:
        assert sources.mesh_parts(path)
    assert len(caught) == 1


@pytest.mark.parametrize(
    "edit",
    [
        lambda header: header["nodes"][-1].update(extensions={"KHR_lights_punctual": {}}),
        lambda header: _positions(header).pop("min"),
        lambda header: header["nodes"][-1].update(rotation=[0, 0, 0.6, 0.8005]),
        lambda header: header["scenes"].append({"nodes": [0]}),
    ],
)
def test_parts_that_change_nothing_give_no_warning(tmp_path: Path, edit: Edit):
    path = _glb(tmp_path / "box.glb", edit)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sources.mesh_parts(path)


def test_bounds_of_buffers_elsewhere_are_not_checked(tmp_path: Path):
    """Their vertices are not in the file."""

    def edit(header: dict[str, Any]) -> None:
        header["buffers"] = [{"byteLength": 10**6, "uri": "box.bin"}]
        _positions(header).update(min=[5, 5, 5], max=[6, 6, 6])

    path = _glb(tmp_path / "box.glb", edit)
    with warnings.catch_warnings(), pytest.raises(InputError, match="It cannot be read"):
        warnings.simplefilter("error")
        sources.mesh_parts(path)


def test_long_chains_of_nodes_are_read(tmp_path: Path):
    def edit(header: dict[str, Any]) -> None:
        mesh = header["nodes"][0]
        header["nodes"] = [*({"children": [n + 1]} for n in range(200)), mesh]

    assert sources.mesh_parts(_glb(tmp_path / "box.glb", edit))
