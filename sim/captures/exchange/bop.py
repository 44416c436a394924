"""The BOP challenge's layout: images, depths, masks and poses of objects, and their models.

    camera.json, models/obj_000001.ply, models/models_info.json
    SPLIT/000000/scene_camera.json, scene_gt.json, scene_gt_info.json
    SPLIT/000000/gray/000000.png, depth/000000.png, mask/000000_000000.png, mask_visib/...

Lengths are millimetres. Scenes are rooms; every frame of a room's views is an image.

Source: Hodan et al., BOP: benchmark for 6D object pose estimation, ECCV 2018, and the toolkit's
page on the format of data sets.
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
from starling.sim.captures import png
from starling.sim.captures.capture import CapturedScene, CaptureSet, Frame
from starling.sim.console.output import Folder
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.scene import mesh as mesh_file
from starling.sim.scene.builtin import solids
from starling.sim.stereo.depth import to_code

_SPLIT = "train_starling"
_MM = 1e3
_CLOUD = 2000  # Points of the hull at most, between which the diameter is measured.

Models = Mapping[str, trimesh.Trimesh]


def export(captures: CaptureSet, meshes: Path, folder: Folder) -> int:
    """Write a data set of dropped objects.

    Args:
        captures: with `objects` in their `frame.json`, and `label.png`.
        meshes: folder in which the objects' files lie.
        folder: where to.

    Returns:
        How many images were written.

    Raises:
        InputError: if there are no objects, a mesh is missing, or a frame has no depth.
    """
    rooms: dict[str, list[CapturedScene]] = {}
    for scene in captures.scenes:
        rooms.setdefault(scene.room, []).append(scene)
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
        info[str(ids[name])] = _told(scaled)
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
    """Meshes of all objects that any frame shows, by file name, in metres."""
    names = {
        one["mesh"]
        for scene in captures.scenes
        for one in scene.frame(scene.frames[0]).record.get("objects", [])
    }
    if not names:
        advice = "Generate it with a source of kind dropped."
        raise refuse("captures", "must show objects", captures.path, advice)
    found = {}
    for name in names:
        paths = sorted(meshes.rglob(name))
        if not paths:
            raise refuse("meshes", f"must hold {name}", meshes, "Give the plan's folder.")
        found[name] = solids.joined([part for _, part in mesh_file.parts(paths[0])])
    return found


def _scene(
    place: str,
    scenes: Sequence[CapturedScene],
    models: Models,
    ids: Mapping[str, int],
    folder: Folder,
) -> int:
    cameras: dict[str, Any] = {}
    truth: dict[str, Any] = {}
    told: dict[str, Any] = {}
    for scene in scenes:
        label = scene.label()
        for number in scene.frames:
            frame, image = scene.frame(number), str(len(cameras))
            _write_images(f"{place}/{{}}/{int(image):06d}.png", scene, frame, folder)
            cameras[image] = _camera(scene, frame)
            truth[image], told[image] = [], []
            for turn, one in enumerate(frame.record.get("objects", [])):
                pose = np.array(one["left_from_mesh"])
                truth[image].append(
                    {
                        "cam_R_m2c": pose[:3, :3].ravel().tolist(),
                        "cam_t_m2c": (_MM * pose[:3, 3]).tolist(),
                        "obj_id": ids[one["mesh"]],
                    }
                )
                body = frame.record["bodies"].index(one["body"]) + 1
                whole = silhouette(models[one["mesh"]], pose, Pinhole.of(scene.info))
                seen = np.zeros_like(whole) if label is None else (label == body) & whole
                for kind, mask in (("mask", whole), ("mask_visib", seen)):
                    name = f"{place}/{kind}/{int(image):06d}_{turn:06d}.png"
                    folder.write(name, png.encode(np.where(mask, 255, 0).astype(np.uint8)))
                told[image].append(_counts(whole, seen, frame))
    for name, table in (("camera", cameras), ("gt", truth), ("gt_info", told)):
        folder.write(f"{place}/scene_{name}.json", json.dumps(table, indent=1))
    return len(cameras)


def _write_images(pattern: str, scene: CapturedScene, frame: Frame, folder: Folder) -> None:
    if frame.depth_m is None:
        name = f"frame {frame.number} of {scene.name}"
        raise refuse(name, "must have depth", "none", "BOP's layout is of depth.")
    code = to_code(frame.depth_m, scene.info.depth_unit_m)
    folder.write(pattern.format("depth"), png.encode(code))
    if frame.ir_left is not None:
        folder.write(pattern.format("gray"), png.encode(frame.ir_left))


def _camera(scene: CapturedScene, frame: Frame) -> dict[str, Any]:
    info = scene.info
    told: dict[str, Any] = {
        "cam_K": [info.fx_px, 0.0, info.cx_px, 0.0, info.fy_px, info.cy_px, 0.0, 0.0, 1.0],
        "depth_scale": info.depth_unit_m * _MM,
    }
    if "left_from_world" in frame.record:
        pose = np.array(frame.record["left_from_world"])
        told["cam_R_w2c"] = pose[:3, :3].ravel().tolist()
        told["cam_t_w2c"] = (_MM * pose[:3, 3]).tolist()
    return told


def silhouette(
    mesh: trimesh.Trimesh, left_from_mesh: NDArray[np.float64], camera: Pinhole
) -> NDArray[np.bool_]:
    """Pixels (h, w) whose rays meet a mesh, as if nothing stood before it.

    Triangles are filled as polygons, whose outline counts as inside: up to half a pixel is added.

    Args:
        mesh: in metres.
        left_from_mesh: rigid.
        camera: OpenCV frame.
    """
    points = np.asarray(mesh.vertices) @ left_from_mesh[:3, :3].T + left_from_mesh[:3, 3]
    found = np.zeros((camera.height, camera.width), np.uint8)
    ahead = points[:, 2] > 1e-3
    z = np.where(ahead, points[:, 2], 1.0)
    x = camera.fx_px * points[:, 0] / z + camera.cx_px
    y = camera.fy_px * points[:, 1] / z + camera.cy_px
    corners = np.stack([x, y], axis=1)[mesh.faces]
    fine = np.rint(16 * corners).clip(-(2**30), 2**30).astype(np.int32)  # Sixteenths of a pixel.
    for triangle in fine[ahead[mesh.faces].all(axis=1)]:
        cv2.fillConvexPoly(found, triangle, 1, shift=4)
    return found.astype(bool)


def _counts(whole: NDArray[np.bool_], seen: NDArray[np.bool_], frame: Frame) -> dict[str, Any]:
    assert frame.depth_m is not None  # `_write_images` has refused it.
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
    """Left, top, width, height; BOP's -1 of nothing."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return [-1, -1, -1, -1]
    left, top = int(columns[0]), int(rows[0])
    return [left, top, int(columns[-1]) - left + 1, int(rows[-1]) - top + 1]


def _told(mesh: trimesh.Trimesh) -> dict[str, float]:
    """Size of a model [mm]: its box, and the largest distance between two of its points."""
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
