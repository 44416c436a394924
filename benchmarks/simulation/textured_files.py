"""Textures of a GLB and of an OBJ with MTL: in colour against Mitsuba's own render, and in depth.

Usage: python benchmarks/simulation/textured_files.py [--size 640] [--pictures FOLDER]

The files are made here: a ball with a map, a box with a picture on each side, and a plane whose
tiles repeat. The plane is a floor that carries the others, or a board 1.5 m behind them. Mitsuba
reads the same meshes by its own OBJ reader and its own textures, in a white environment, without
Starling's scenes, materials or colour picture. Bodies occlude the sky in both.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual.material import PBRMaterial, SimpleMaterial
from trimesh.visual.texture import TextureVisuals

from starling.sim.geometry import frames
from starling.sim.imaging import colour_picture
from starling.sim.render import backend
from starling.sim.scene import sources
from starling.sim.scene.placing import Viewpoint
from starling.sim.scene.scene import Ambient
from starling.sim.sensor import presets
from starling.sim.sensor.edits import apply
from starling.sim.sensor.sensor import Colour, Sensor
from starling.sim.simulate import simulate

LOOK_AT = (0.15, 0.55, 1.1, 0.0, 0.1, 0.0)  # Eye and target [m].
_SAMPLES = 128  # Of Mitsuba in a pixel.
_FORMATS = ("glb", "obj")
_POWERS_W = (0.05, 0.03, 0.02)
_PLANES = ("board", "floor")

_SKY = Ambient(gradient=0.0, up=(0.0, 1.0, 0.0), occlusion=1.0, reach_m=100.0)

Solid = tuple[trimesh.Trimesh, NDArray[np.float64], NDArray[np.uint8]]


def sensor(width: int) -> Sensor:
    """A D435 whose colour camera has `width` pixels and stands at the left imager."""
    base = presets.load("d435")
    height, focal_px = round(width * 0.75), width * 0.95
    colour = Colour(
        width=width,
        height=height,
        fx_px=focal_px,
        fy_px=focal_px,
        cx_px=(width - 1) / 2,
        cy_px=(height - 1) / 2,
        position_m=(0.0, 0.0, 0.0),
    )
    return dataclasses.replace(base, colour=colour)


def solids(plane: str) -> dict[str, Solid]:
    """Meshes with uv (v upwards) and pictures, by name.

    Args:
        plane: `floor` or `board`.
    """
    return {"ball": _ball(), "box": _box(), plane: _plane(board=plane == "board")}


def write(folder: Path, kind: str, plane: str) -> Path:
    """Write the scene as `scene.glb`, or as `scene.obj` with its MTL and pictures."""
    scene = trimesh.Scene()
    for name, (mesh, uv, image) in solids(plane).items():
        picture: Any = Image.fromarray(image)
        picture.format = "PNG"
        material = (
            PBRMaterial(
                name=name,
                baseColorTexture=picture,
                baseColorFactor=[1.0, 1.0, 1.0, 1.0],
                metallicFactor=0.0,
                roughnessFactor=1.0,
            )
            if kind == "glb"
            else SimpleMaterial(
                name=name, image=picture, diffuse=[255] * 4, specular=[0, 0, 0, 255]
            )
        )
        held = mesh.copy()
        held.visual = TextureVisuals(uv=uv, material=material)
        scene.add_geometry(held, geom_name=name, node_name=name)
    path = folder / f"scene.{kind}"
    if kind == "glb":
        scene.export(path)
        return path
    text, files = trimesh.exchange.obj.export_obj(scene, return_texture=True, mtl_name="scene.mtl")
    path.write_text(text)
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return path


def seen(path: Path, camera: Sensor) -> NDArray[np.uint8]:
    """Starling's colour picture of a file under an even sky."""
    scene = sources.load(str(path), camera, view=Viewpoint(look_at=LOOK_AT))
    scene = dataclasses.replace(scene, ambient=_SKY)
    return colour_picture.picture(scene, camera)


def reference(camera: Sensor, folder: Path, plane: str) -> NDArray[np.uint8]:
    """Mitsuba's render of the same meshes at the same exposure."""
    colour = camera.colour
    assert colour is not None
    shapes: dict[str, Any] = {}
    for name, (mesh, uv, image) in solids(plane).items():
        cv2.imwrite(str(folder / f"{name}.png"), image[..., ::-1])
        (folder / f"{name}.obj").write_text(_obj(mesh, uv))
        texture = {"type": "bitmap", "filename": str(folder / f"{name}.png")}
        shapes[name] = {
            "type": "obj",
            "filename": str(folder / f"{name}.obj"),
            "face_normals": True,
            "bsdf": {
                "type": "twosided",
                "bsdf": {"type": "diffuse", "reflectance": texture},
            },
        }
    with _in_colour() as mi:
        look = mi.ScalarTransform4f().look_at(
            origin=list(LOOK_AT[:3]), target=list(LOOK_AT[3:]), up=[0.0, 1.0, 0.0]
        )
        film = {
            "type": "hdrfilm",
            "width": colour.width,
            "height": colour.height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
        }
        eye = {
            "type": "perspective",
            "fov": float(np.rad2deg(2 * np.arctan(colour.width / 2 / colour.fx_px))),
            "fov_axis": "x",
            "to_world": look,
            "film": film,
        }
        integrator = {"type": "direct", "hide_emitters": True}
        sky = {"type": "constant", "radiance": 1.0}
        loaded = mi.load_dict(
            {"type": "scene", "integrator": integrator, "sensor": eye, "sky": sky, **shapes}
        )
        linear = np.array(mi.render(loaded, spp=_SAMPLES, seed=1), np.float32)
    return colour_picture.encoded(linear[..., :3], colour.level)


def _obj(mesh: trimesh.Trimesh, uv: NDArray[np.float64]) -> str:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in uv]
    lines += ["f " + " ".join(f"{n + 1}/{n + 1}" for n in face) for face in mesh.faces]
    return "\n".join(lines) + "\n"


@contextmanager
def _in_colour() -> Iterator[Any]:
    """Mitsuba in a variant of three colours; Starling's own has one."""
    mi = backend.mitsuba()
    before = mi.variant()
    mi.set_variant("llvm_ad_rgb" if backend.is_jit() else "scalar_rgb")
    try:
        yield mi
    finally:
        mi.set_variant(before)


def correlation(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
    """Correlation of all values of two pictures where the second is not black."""
    seen_there = second.any(axis=2)
    pair = [picture[seen_there].astype(np.float64).ravel() for picture in (first, second)]
    return float(np.corrcoef(*pair)[0, 1])


def hole_shares(folder: Path, power_w: float) -> dict[str, float]:
    """Share of pixels without depth on a board, half black and half white, 3 m from a D435.

    Args:
        folder: where the board is written.
        power_w: power of the projector [W].
    """
    camera = apply(presets.load("d435"), [f"projector.power_w={power_w}"])
    halves = np.zeros((64, 64, 3), np.uint8)
    halves[:, 32:] = 255
    shares: dict[str, float] = {}
    for image in (halves, None):
        corners = np.array([(-2.0, -1.0, 0.0), (2, -1, 0), (2, 1, 0), (-2, 1, 0)])
        board = trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)
        if image is not None:
            material = PBRMaterial(
                baseColorTexture=Image.fromarray(image), metallicFactor=0.0, roughnessFactor=1.0
            )
            uv = np.array([(0.0, 0), (1, 0), (1, 1), (0, 1)])
            board.visual = TextureVisuals(uv=uv, material=material)
        board.export(folder / "board.glb")
        view = Viewpoint(look_at=(0, 0, 3.0, 0, 0, 0))
        scene = sources.load(str(folder / "board.glb"), camera, view=view)
        ambient = Ambient(irradiance_w_m2=0.3, up=(0.0, 1.0, 0.0))
        shot = simulate(dataclasses.replace(scene, ambient=ambient), camera)
        rows = np.isfinite(shot.layers.truth.depth_m[:, camera.width // 2])
        valid, middle = shot.depth.valid[rows], camera.width // 2
        # Away from the band without overlap, the board's ends and the edge between the halves.
        left, right = valid[:, 220 : middle - 20], valid[:, middle + 20 : -220]
        if image is None:
            shares["no texture"] = float(1 - np.hstack([left, right]).mean())
        else:
            shares |= {"dark half": float(1 - left.mean()), "light half": float(1 - right.mean())}
    return shares


def _ball() -> Solid:
    """A globe with meridians, a white north and a letter."""
    rows, columns = 48, 96
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    polar, turn = np.pi * (1 - v), 2 * np.pi * u  # v = 1 is the north pole.
    points = np.stack([np.sin(polar) * np.sin(turn), np.cos(polar), np.sin(polar) * np.cos(turn)])
    number = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    vertices = 0.18 * points.reshape(3, -1).T + (-0.2, 0.18, 0.0)
    image = np.zeros((256, 512, 3), np.uint8)
    image[..., 0] = np.linspace(40, 250, 512)
    image[..., 1] = np.linspace(220, 30, 256)[:, None]
    image[..., 2] = 90 + 80 * (np.arange(512) // 32 % 2)
    image[:40] = 245
    cv2.putText(image, "north", (330, 110), cv2.FONT_HERSHEY_DUPLEX, 2.2, (10, 10, 30), 5)
    cv2.putText(image, "north", (10, 110), cv2.FONT_HERSHEY_DUPLEX, 2.2, (10, 10, 30), 5)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    return mesh, np.stack([u.ravel(), v.ravel()], axis=1), image


def _box() -> Solid:
    """A box that shows the same picture on each side."""
    side, corners, uv = 0.26, [], []
    square = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    turns = [frames.rotation(turn) for turn in ((0, 0, 0), (0, 90, 0), (0, 180, 0), (0, -90, 0))]
    turns += [frames.rotation(turn) for turn in ((-90, 0, 0), (90, 0, 0))]
    for turn in turns:
        corners += [turn @ (side / 2 * np.array([x, y, 1.0])) for x, y in square]
        uv += [((x + 1) / 2, (y + 1) / 2) for x, y in square]
    faces = [
        (4 * n + i, 4 * n + j, 4 * n + k) for n in range(6) for i, j, k in ((0, 1, 2), (0, 2, 3))
    ]
    upright = np.array(corners) @ frames.rotation((0.0, 25.0, 0.0)).T
    mesh = trimesh.Trimesh(upright + np.array((0.26, side / 2, 0.05)), faces, process=False)
    image = np.full((200, 200, 3), (200, 60, 40), np.uint8)
    image[:60, :60] = (40, 90, 220)  # Upper left: u near 0, v near 1.
    cv2.putText(image, "Up", (30, 150), cv2.FONT_HERSHEY_DUPLEX, 3.2, (250, 240, 200), 8)
    return mesh, np.array(uv), image


def _plane(*, board: bool) -> Solid:
    """A floor, or an upright board, whose picture repeats eight times."""
    corners = np.array([(-1.0, 0, 1.0), (1, 0, 1), (1, 0, -1), (-1, 0, -1)])
    if board:
        corners = corners @ frames.rotation((90.0, 0.0, 0.0)).T + (0.0, 0.1, -1.5)
    mesh = trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)
    image = np.full((64, 64, 3), 120, np.uint8)
    image[:32, :32], image[32:, 32:] = (70, 120, 60), (180, 170, 120)
    return mesh, np.array([(0.0, 0), (8, 0), (8, 8), (0, 8)]), image


def main() -> None:
    """Print the correlation for each format, and holes of a board by its texture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=640, help="width of the pictures [px]")
    parser.add_argument("--pictures", type=Path, help="folder for the pictures")
    options = parser.parse_args()
    camera = sensor(options.size)
    for plane in _PLANES:
        with tempfile.TemporaryDirectory() as name:
            pictures = {"mitsuba": reference(camera, Path(name), plane)}
            for kind in _FORMATS:
                pictures[kind] = seen(write(Path(name), kind, plane), camera)
                agreement = correlation(pictures[kind], pictures["mitsuba"])
                print(f"{plane}, {kind}: correlation {agreement:.4f}")
        if options.pictures is not None:
            options.pictures.mkdir(parents=True, exist_ok=True)
            row = np.hstack([pictures[label] for label in (*_FORMATS, "mitsuba")])
            cv2.imwrite(str(options.pictures / f"{plane}.png"), row[..., ::-1])
    for power_w in _POWERS_W:
        with tempfile.TemporaryDirectory() as name:
            for part, share in hole_shares(Path(name), power_w).items():
                print(f"{1e3 * power_w:.0f} mW, {part}: {100 * share:.2f} % without depth")


if __name__ == "__main__":
    main()
