"""Conversion of Cycles' images of a job to the arrays of `light.npz`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera.cycles import job as job_file
from starling.diagnosis.validation.camera.errors import refusal

DONE = "rendered.json"  # The script writes this file last.


def arrays(job: Path, rendered: Path) -> dict[str, NDArray[Any]]:
    """Compute the arrays that `starling.diagnosis.validation.camera.light` reads.

    Args:
        job: Folder that `job.write` made.
        rendered: Folder that `render_with_blender.py` wrote.

    Returns:
        Arrays by name `SIDE_NAME`.

    Raises:
        WithheldError: if an image is missing, has a wrong shape, or is not finite and >= 0.
    """
    table = json.loads((job / job_file.FILE).read_text(encoding="utf-8"))
    left = np.array(table["cameras"]["left"])
    light: dict[str, NDArray[Any]] = {}
    for side, pose in table["cameras"].items():
        geometry = _image(rendered, f"{side}_geometry", table)
        body = np.rint(geometry[..., 1]).astype(np.uint32)
        depth_m = np.where(body > 0, geometry[..., 0], np.nan).astype(np.float32)
        left_from_camera = np.linalg.inv(left) @ np.array(pose)
        px, py = _projector_tangents(table, depth_m, left_from_camera)
        device = _sum_emitters(rendered, side, "own", table)
        scale = table["electrons"]
        light |= {
            f"{side}_laser_e": device[..., 0] * np.float32(scale * table["power_w"]),
            f"{side}_even_e": device[..., 1] * np.float32(scale * table["power_w"]),
            f"{side}_ambient_e": _image(rendered, f"{side}_ambient", table)[..., 0]
            * np.float32(scale / table["sky"]["irradiance_w_m2"]),
            f"{side}_other_e": _sum_emitters(rendered, side, "other", table)[..., 0]
            * np.float32(scale),
            f"{side}_depth_m": depth_m,
            f"{side}_body": body,
            f"{side}_px": px,
            f"{side}_py": py,
            f"{side}_up": np.array(pose)[:3, :3].T @ np.array(table["sky"]["up"]),
        }
    return light


def _sum_emitters(
    rendered: Path, side: str, projector: str, table: dict[str, Any]
) -> NDArray[np.float32]:
    """Sum the light (h, w, 3) of all emitters of a projector, "own" or "other"."""
    names = [name for name in table["projectors"] if name.partition("-")[0] == projector]
    blank = np.zeros((table["height"], table["width"], 3), np.float32)
    return sum((_image(rendered, f"{side}_{name}", table) for name in names), start=blank)


def _image(rendered: Path, name: str, table: dict[str, Any]) -> NDArray[np.float32]:
    path = rendered / f"{name}.npy"
    try:
        values = np.load(path)
    except (OSError, ValueError) as error:
        raise refusal(name, "must be a readable array", path, f"{error}.") from error
    shape = (table["height"], table["width"], 3)
    if values.shape != shape:
        raise refusal(name, f"must be of shape {shape}", values.shape, "Render the job again.")
    if not (np.isfinite(values).all() and (values >= 0).all()):
        raise refusal(name, "must be finite and >= 0", np.min(values), "Render the job again.")
    return values


def _projector_tangents(
    table: dict[str, Any], depth_m: NDArray[np.float32], left_from_camera: job_file.Pose
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Tangents x / z and y / z (h, w) of the visible points in the frame of the projector."""
    (fx, fy), (cx, cy) = table["focal_px"], table["centre_px"]
    y, x = np.indices(depth_m.shape, np.float64)
    point = np.stack([(x - cx) / fx, (y - cy) / fy, np.ones_like(x)], axis=-1) * depth_m[..., None]
    projector_from_camera = np.linalg.inv(np.array(table["left_from_projector"])) @ left_from_camera
    local = point @ projector_from_camera[:3, :3].T + projector_from_camera[:3, 3]
    with np.errstate(invalid="ignore", divide="ignore"):
        px, py = local[..., 0] / local[..., 2], local[..., 1] / local[..., 2]
    return px.astype(np.float32), py.astype(np.float32)
