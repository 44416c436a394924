"""Reading of mesh files: parts with their looks, unit, up axis, and a warning of what is unused."""

from __future__ import annotations

import io
import logging
import re
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from trimesh.resolvers import FilePathResolver

from starling.patterns import errors, regular_file
from starling.sim.scene import gltf, obj, ply
from starling.sim.scene.meshes import collada, gltf_looks, mtl, trimesh_parts
from starling.sim.scene.meshes.appearance import MeshFile

_USD = (".usd", ".usda", ".usdc", ".usdz")
SUFFIXES = (".ply", ".obj", ".glb", ".stl", ".dae", *_USD)
_TEXTURE = re.compile(rb"^comment[ \t]+TextureFile[ \t]+(\S.*?)[ \t\r]*$", re.MULTILINE)


def read(path: Path) -> MeshFile:
    """Read a mesh file; what is not used of it gives one warning.

    Raises:
        InputError: if the file is missing, corrupt or empty, or its reader is not installed.
    """
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # Its errors are reported below.
    if not path.is_file():
        raise errors.refuse("scene", "must be a file that exists", path, "Check the path.")
    reader = _reader(path.suffix.lower())
    try:
        file = reader(path)
    except Exception as error:  # The parsers of trimesh raise errors of any type.
        reason = str(error) or "its parts contradict each other"
        raise errors.refuse(
            "scene", "must be a mesh", path, f"It cannot be read: {reason}"
        ) from None
    if not file.parts:
        raise errors.refuse("scene", "must hold triangles", path, "The mesh is empty.")
    _warn(file, path)
    return file


def _warn(file: MeshFile, path: Path) -> None:
    unused = sorted(file.unused)
    if file.missing:
        unused.append(f"files that are missing ({', '.join(file.missing)})")
    if unused:
        warnings.warn(f"{path}: not used: {', '.join(unused)}.", stacklevel=4)


def _reader(suffix: str) -> Callable[[Path], MeshFile]:
    """Reader of a kind of file, whose packages are installed."""
    if suffix in _USD:
        from starling.sim.scene.meshes import usd

        usd.refuse_without_reader()
        return usd.read
    if suffix == ".dae":
        collada.refuse_without_reader()
    return {
        ".ply": _read_ply,
        ".obj": _read_obj,
        ".glb": _read_glb,
        ".stl": _read_stl,
        ".dae": _read_dae,
    }[suffix]


def _read_ply(path: Path) -> MeshFile:
    ply.refuse_damaged(path)
    header = regular_file.read(path).partition(b"end_header")[0]
    textures = [name.decode("utf-8", "replace") for name in _TEXTURE.findall(header)]
    looks = mtl.MtlLooks()
    parts = trimesh_parts.parts(_load(path), looks.look)
    missing = tuple(name for name in textures if not (path.parent / name).is_file())
    return MeshFile(parts=parts, unused=frozenset(looks.unused), missing=missing)


def _read_obj(path: Path) -> MeshFile:
    obj.refuse_damaged(path)
    looks = mtl.MtlLooks()
    parts = trimesh_parts.parts(_load(path, mtl.plain(regular_file.read(path))), looks.look)
    lost = sorted(mtl.used_materials(path) - looks.names)
    if lost:
        looks.unused.add(f"materials that cannot be read ({', '.join(lost)})")
    unread = mtl.unread_files(path)
    if unread:
        looks.unused.add(f"textures that cannot be read ({', '.join(unread)})")
    if mtl.moves_textures(path):
        looks.unused.add("offset and scale of textures")
    missing = tuple(mtl.missing_files(path))
    return MeshFile(parts=parts, unused=frozenset(looks.unused), missing=missing)


def _read_glb(path: Path) -> MeshFile:
    gltf.refuse_unsupported(path)
    data, header = gltf_looks.numbered(regular_file.read(path))
    looks = gltf_looks.GltfLooks(header)
    loaded = _load(path, data)
    parts = trimesh_parts.parts(loaded, looks.look, gltf_looks.linear_bytes)
    parts = [looks.adapted(part) for part in parts]
    return MeshFile(parts=parts, unused=frozenset(looks.unused))


def _read_stl(path: Path) -> MeshFile:
    regular_file.refuse_others(path)
    return MeshFile(parts=trimesh_parts.parts(_load(path), mtl.MtlLooks().look))


def _read_dae(path: Path) -> MeshFile:
    looks = collada.ColladaLooks(path)
    parts = trimesh_parts.parts(_load(path), looks.look)
    return MeshFile(
        parts=parts,
        unit_m=looks.unit_m,
        up=looks.up,
        unused=frozenset(looks.unused),
        missing=tuple(looks.missing_files(path)),
    )


def _load(path: Path, data: bytes | None = None) -> trimesh.Scene:
    """Load a file with trimesh, from other bytes if given."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        resolver = _RegularFiles(str(path))
        source = path if data is None else io.BytesIO(data)
        kind = path.suffix.lower().removeprefix(".")
        return trimesh.load_scene(source, file_type=kind, process=False, resolver=resolver)


class _RegularFiles(FilePathResolver):
    """Materials and textures in the folder of a mesh. Pipes and devices are as missing files."""

    def get(self, name: str) -> bytes:
        """Read one file."""
        if not self.absolute(name).is_file():
            raise FileNotFoundError(name)
        return mtl.plain(super().get(name)) if name.lower().endswith(".mtl") else super().get(name)
