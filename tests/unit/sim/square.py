"""A square with a picture as GLB and as OBJ with MTL, and its only body when it is loaded."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from starling.sim.scene import sources
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
