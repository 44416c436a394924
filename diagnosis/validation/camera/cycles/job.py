"""Render job for Cycles, its radiometry, and conversion of its images to `light.npz`.

A job is a folder with `job.json` and arrays. Lengths are in metres.

| key | content |
| --- | --- |
| width, height | size of the images [px] |
| focal_px, centre_px | (fx, fy), (cx, cy) of both views; integers are pixel centres |
| cameras | by side: rows of the 4 x 4 `world_from_camera`; x right, y down, z forward |
| bodies | number, name, kind, reflectance, roughness, ior; files of vertices (n, 3), faces (m, 3) and normals (n, 3) in the world frame, null for flat faces |
| projectors | by name: `world_from_projector` (axes as a camera's); `half_tangents` of its field; `intensity_w_sr`: file (h, w, channels) on the tangent plane, first row on top |
| left_from_projector | pose of the device's projector in the frame of the left camera |
| sky | irradiance_w_m2, gradient, up (world): radiance L0 (1 + gradient w . up), irradiance pi L0 |
| electrons | electrons per pixel for a radiance of 1 W m^-2 sr^-1 (`electrons_per_radiance`) |
| power_w | power of the device's projector |
| samples, seed | samples per pixel, and their seed |
"""  # noqa: E501

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.camera.nominal import Nominal

FILE = "job.json"
DONE = "rendered.json"  # The script writes this file last.
KINDS = ("diffuse", "glossy", "metal")
_PLANCK_J_S = 6.62607015e-34
_LIGHT_M_S = 299792458.0
Pose = NDArray[np.float64]  # (4, 4) rigid, named `to_from`.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class JobBody:
    """One body of a scene, in the world frame."""

    name: str
    vertices: NDArray[np.float32]  # (n, 3) [m]
    faces: NDArray[np.uint32]  # (m, 3), counter-clockwise from outside.
    normals: NDArray[np.float32] | None  # (n, 3); None gives flat shading.
    kind: str  # One of `KINDS`.
    reflectance: float  # Diffuse reflectance, or that of a metal at normal incidence.
    roughness: float  # GGX alpha of coat or metal.
    ior: float  # Refractive index of the coat.

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            rule, advice = "must be one that the render job supports", ", ".join(KINDS)
            raise refusal(f"kind of {self.name}", rule, repr(self.kind), f"Take one of {advice}.")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class JobProjector:
    """A point source that lights a rectangular field about its z axis."""

    world_from_projector: Pose
    half_tangents: tuple[float, float]  # Tangents of half the field (x, y).
    intensity_w_sr: NDArray[np.float32]  # (h, w, channels), uniform in tangents over the field.


@dataclass(frozen=True, kw_only=True, slots=True)
class Sky:
    """Ambient light from all directions, without occlusion."""

    irradiance_w_m2: float  # pi L0.
    gradient: float  # Radiance is L0 (1 + gradient w . up) in direction w.
    up: tuple[float, float, float]  # Unit vector in the world frame.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Job:
    """One scene with its light sources and both views."""

    width: int  # [px]
    height: int  # [px]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    cameras: Mapping[str, Pose]  # world_from_camera by side.
    bodies: tuple[JobBody, ...]  # Numbered from 1.
    projectors: Mapping[str, JobProjector]  # `own-N`: dots and uniform light; `other-N`: dots.
    left_from_projector: Pose  # Pose of the device's projector.
    sky: Sky
    electrons: float  # Electrons per pixel for a radiance of 1 W m^-2 sr^-1.
    power_w: float  # Power of the device's projector.


def write(job: Job, folder: Path, *, samples: int, seed: int) -> None:
    """Write the files of a job.

    Args:
        job: Scene to render.
        folder: Folder of the files. It is created if missing.
        samples: Samples per pixel.
        seed: Seed of the samples.

    Raises:
        WithheldError: if samples is below 1 or seed below 0.
    """
    for name, value, least in (("samples", samples, 1), ("seed", seed, 0)):
        if value < least:
            raise refusal(name, f"must be >= {least}", value, "Give a whole number.")
    folder.mkdir(parents=True, exist_ok=True)
    table = {**dataclasses.asdict(job), "samples": samples, "seed": seed}
    for number, body in enumerate(table["bodies"], 1):
        body["number"] = number
        for key in ("vertices", "faces", "normals"):
            if body[key] is not None:
                body[key] = _save(folder, f"body-{number}-{key}", body[key])
    for name, projector in table["projectors"].items():
        projector["intensity_w_sr"] = _save(folder, name, projector["intensity_w_sr"])
    text = json.dumps(table, indent=1, default=np.ndarray.tolist)
    (folder / FILE).write_text(text, encoding="utf-8")


def _save(folder: Path, name: str, array: NDArray[Any]) -> str:
    np.save(folder / f"{name}.npy", array)
    return f"{name}.npy"


def electrons_per_radiance(camera: Nominal, transmission: float) -> float:
    """Return the electrons per pixel for a radiance of 1 W m^-2 sr^-1 at the lens.

    A lens of f-number N gives an on-axis irradiance of pi L T / (4 N^2) (small-angle form, the
    convention of this project). Irradiance times pixel area and exposure is energy. Energy over
    h c / wavelength is photons, and the quantum efficiency converts them to electrons.

    Args:
        camera: Nominal camera.
        transmission: Transmission T of lens and filter, in (0, 1].
    """
    irradiance = math.pi * transmission / (4 * camera.f_number**2)
    energy_j = irradiance * camera.pixel_pitch_m**2 * camera.exposure_s
    photons = energy_j * camera.wavelength_nm * 1e-9 / (_PLANCK_J_S * _LIGHT_M_S)
    return photons * camera.quantum_efficiency


def intensity_w_sr(
    shape_of_light: NDArray[np.floating], half_tangents: tuple[float, float], power_w: float
) -> NDArray[np.float32]:
    """Return the radiant intensity [W sr^-1] of a point source with a given pattern and power.

    At a tangent vector t from the axis, a plane at unit distance receives the irradiance
    I / (1 + t^2)^(3/2). The irradiance integrated over the field is the power.

    Args:
        shape_of_light: Relative irradiance (h, w) >= 0 of the plane across the axis. Pixels are
            uniform in tangents. The field ends half a pixel beyond the outer pixel centres.
        half_tangents: Tangents of half the field (x, y).
        power_w: Total optical power [W].

    Returns:
        Radiant intensity (h, w) [W sr^-1] at the pixel centres.
    """
    height, width = shape_of_light.shape
    half_x, half_y = half_tangents
    area_m2 = 4 * half_x * half_y
    scale = power_w / (area_m2 * float(shape_of_light.mean(dtype=np.float64)))
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * half_x
    y = ((np.arange(height) + 0.5) / height * 2 - 1) * half_y
    obliquity = (1 + x[None, :] ** 2 + y[:, None] ** 2) ** 1.5
    return (shape_of_light * scale * obliquity).astype(np.float32)


def arrays(job: Path, rendered: Path) -> dict[str, NDArray[Any]]:
    """Compute the arrays that `starling.diagnosis.validation.camera.light` reads.

    Args:
        job: Folder that `write` made.
        rendered: Folder that `render_with_blender.py` wrote.

    Returns:
        Arrays by name `SIDE_NAME`.

    Raises:
        WithheldError: if an image is missing, has a wrong shape, or is not finite and >= 0.
    """
    table = json.loads((job / FILE).read_text(encoding="utf-8"))
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
    table: dict[str, Any], depth_m: NDArray[np.float32], left_from_camera: Pose
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
