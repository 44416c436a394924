"""Export to the layout of the BOP challenge: images, depth, masks, object poses and models.

    camera.json, models/obj_000001.ply, models/models_info.json
    SPLIT/000000/scene_camera.json, scene_gt.json, scene_gt_info.json
    SPLIT/000000/gray/000000.png, depth/000000.png, mask/000000_000000.png, mask_visib/...

Lengths are in millimetres. Each room becomes a BOP scene; each frame becomes an image.

Source: Hodan et al., BOP: benchmark for 6D object pose estimation, ECCV 2018, and the toolkit's
page on the data set format.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from starling.patterns.errors import refuse
from starling.sim import files
from starling.sim.captures import png
from starling.sim.captures.capture import CapturedScene, CaptureSet, Frame
from starling.sim.captures.exchange.stream import by_room, left_from_world
from starling.sim.console.output import Folder
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.scene import sources
from starling.sim.scene.builtin import solids
from starling.sim.stereo.depth import to_code

_SPLIT = "train_starling"
_MM = 1e3
_CLOUD = 2000  # Largest number of hull points for measuring the diameter.

Models = Mapping[str, trimesh.Trimesh]


def export(captures: CaptureSet, meshes: Path, folder: Folder) -> int:
    """Write a data set of dropped objects.

    Args:
        captures: captures with `objects` in `frame.json`, and `label.png`.
        meshes: folder with the objects' mesh files.
        folder: output folder.

    Returns:
        Number of written images.

    Raises:
        InputError: if there are no objects, a mesh is missing, or a frame has no depth.
    """
    rooms = by_room(captures.scenes)
    models = _models(captures, meshes)
    ids = {name: number for number, name in enumerate(sorted(models), 1)}
    count = 0
    for number, scenes in enumerate(rooms.values()):
        count += _scene(f"{_SPLIT}/{number:06d}", scenes, models, ids, folder)
    info = {}
    for name, mesh in models.items():
        scaled = mesh.copy()
        scaled.apply_scale(_MM)
        folder.write(f"models/obj_{ids[name]:06d}.ply", _bytes(scaled.export(file_type="ply")))
        info[str(ids[name])] = _model_info(scaled)
    folder.write("models/models_info.json", json.dumps(info, indent=1))
    camera = captures.info
    folder.write(
        "camera.json",
        json.dumps(
            {
                **{"cx": camera.cx_px, "cy": camera.cy_px, "fx": camera.fx_px, "fy": camera.fy_px},
                **{"width": camera.width, "height": camera.height},
                "depth_scale": camera.depth_unit_m * _MM,
            }
        ),
    )
    return count


def _models(captures: CaptureSet, meshes: Path) -> dict[str, trimesh.Trimesh]:
    """Load the meshes [m] of all objects in any frame, by path inside `meshes`."""
    digests = {
        shown["mesh"]: shown.get("sha256")
        for scene in captures.scenes
        for shown in scene.record(scene.frames[0]).get("objects", [])
    }
    if not digests:
        advice = "Generate it with a source of kind dropped."
        raise refuse("captures", "must show objects", captures.path, advice)
    models = {}
    for name, digest in digests.items():
        path = _mesh_file(meshes, name)
        if digest is not None and files.file_digest(path) != digest:
            rule = f"must hold the {name} that was rendered"
            raise refuse("meshes", rule, f"another content in {path}", "Restore the file.")
        models[name] = solids.join([part for _, part in sources.mesh_parts(path)])
    return models


def _mesh_file(meshes: Path, name: str) -> Path:
    """Find a mesh by its path inside the folder, or by a file name that occurs once."""
    if (meshes / name).is_file():
        return meshes / name
    paths = sorted(meshes.rglob(name)) if "/" not in name else []
    if not paths:
        raise refuse("meshes", f"must hold {name}", meshes, "Give the plan's folder.")
    if len(paths) > 1:
        rule, advice = f"must hold one file {name}", "Give the folder with the right one."
        raise refuse("meshes", rule, f"{len(paths)} in {meshes}", advice)
    return paths[0]


def _scene(
    place: str,
    scenes: Sequence[CapturedScene],
    models: Models,
    ids: Mapping[str, int],
    folder: Folder,
) -> int:
    cameras: dict[str, Any] = {}
    truth: dict[str, Any] = {}
    counts: dict[str, Any] = {}
    for scene in scenes:
        label = scene.label()
        for number in scene.frames:
            frame, image = scene.frame(number), str(len(cameras))
            _write_images(f"{place}/{{}}/{int(image):06d}.png", scene, frame, folder)
            cameras[image] = _camera(scene, frame)
            truth[image], counts[image] = [], []
            for turn, shown in enumerate(frame.record.get("objects", [])):
                pose = np.array(shown["left_from_mesh"])
                truth[image].append(
                    {
                        "cam_R_m2c": pose[:3, :3].ravel().tolist(),
                        "cam_t_m2c": (_MM * pose[:3, 3]).tolist(),
                        "obj_id": ids[shown["mesh"]],
                    }
                )
                body = frame.record["bodies"].index(shown["body"]) + 1
                whole = silhouette(models[shown["mesh"]], pose, Pinhole.from_camera(scene.info))
                seen = np.zeros_like(whole) if label is None else (label == body) & whole
                for kind, mask in (("mask", whole), ("mask_visib", seen)):
                    name = f"{place}/{kind}/{int(image):06d}_{turn:06d}.png"
                    folder.write(name, png.encode(np.where(mask, 255, 0).astype(np.uint8)))
                counts[image].append(_counts(whole, seen, frame))
    for name, table in (("camera", cameras), ("gt", truth), ("gt_info", counts)):
        folder.write(f"{place}/scene_{name}.json", json.dumps(table, indent=1))
    return len(cameras)


def _write_images(pattern: str, scene: CapturedScene, frame: Frame, folder: Folder) -> None:
    if frame.depth_m is None:
        name = f"frame {frame.number} of {scene.name}"
        raise refuse(name, "must have depth", "none", "BOP's layout needs depth.")
    code = to_code(frame.depth_m, scene.info.depth_unit_m)
    folder.write(pattern.format("depth"), png.encode(code))
    if frame.ir_left is not None:
        folder.write(pattern.format("gray"), png.encode(frame.ir_left))


def _camera(scene: CapturedScene, frame: Frame) -> dict[str, Any]:
    info = scene.info
    camera: dict[str, Any] = {
        "cam_K": [info.fx_px, 0.0, info.cx_px, 0.0, info.fy_px, info.cy_px, 0.0, 0.0, 1.0],
        "depth_scale": info.depth_unit_m * _MM,
    }
    pose = left_from_world(scene, frame.record)
    if pose is not None:
        camera["cam_R_w2c"] = pose[:3, :3].ravel().tolist()
        camera["cam_t_w2c"] = (_MM * pose[:3, 3]).tolist()
    return camera


def silhouette(
    mesh: trimesh.Trimesh, left_from_mesh: NDArray[np.float64], camera: Pinhole
) -> NDArray[np.bool_]:
    """Return the mask (h, w) of pixels whose rays meet a mesh, without occlusion.

    Triangles are filled as polygons including their outline, which adds up to half a pixel.

    Args:
        mesh: mesh [m].
        left_from_mesh: rigid pose of the mesh.
        camera: intrinsics.
    """
    points = np.asarray(mesh.vertices) @ left_from_mesh[:3, :3].T + left_from_mesh[:3, 3]
    mask = np.zeros((camera.height, camera.width), np.uint8)
    ahead = points[:, 2] > 1e-3
    z = np.where(ahead, points[:, 2], 1.0)
    x = camera.fx_px * points[:, 0] / z + camera.cx_px
    y = camera.fy_px * points[:, 1] / z + camera.cy_px
    corners = np.stack([x, y], axis=1)[mesh.faces]
    fine = np.rint(16 * corners).clip(-(2**30), 2**30).astype(np.int32)  # Sixteenths of a pixel.
    for triangle in fine[ahead[mesh.faces].all(axis=1)]:
        cv2.fillConvexPoly(mask, triangle, 1, shift=4)
    return mask.astype(bool)


def _counts(whole: NDArray[np.bool_], seen: NDArray[np.bool_], frame: Frame) -> dict[str, Any]:
    assert frame.depth_m is not None  # `_write_images` has checked it.
    count = int(whole.sum())
    return {
        "bbox_obj": _box(whole),
        "bbox_visib": _box(seen),
        "px_count_all": count,
        "px_count_valid": int((whole & np.isfinite(frame.depth_m)).sum()),
        "px_count_visib": int(seen.sum()),
        "visib_fract": int(seen.sum()) / count if count else 0.0,
    }


def _box(mask: NDArray[np.bool_]) -> list[int]:
    """Return left, top, width, height; all -1 for an empty mask, as in BOP."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return [-1, -1, -1, -1]
    left, top = int(columns[0]), int(rows[0])
    return [left, top, int(columns[-1]) - left + 1, int(rows[-1]) - top + 1]


def _model_info(mesh: trimesh.Trimesh) -> dict[str, float]:
    """Return a model's bounding box and diameter (largest distance of two points) [mm]."""
    low, high = mesh.bounds
    points = np.asarray(mesh.convex_hull.vertices)[:_CLOUD]
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    return {
        "diameter": float(apart.max()),
        **{f"min_{axis}": float(value) for axis, value in zip("xyz", low, strict=True)},
        **{f"size_{axis}": float(value) for axis, value in zip("xyz", high - low, strict=True)},
    }


def _bytes(content: Any) -> bytes:
    return content if isinstance(content, bytes) else str(content).encode()
