"""Render job for Cycles: a folder with `job.json` and arrays. Lengths are in metres.

| key | content |
| --- | --- |
| width, height | size of the images [px] |
| focal_px, centre_px | (fx, fy), (cx, cy) of both views; integers are pixel centres |
| cameras | by side: rows of the 4 x 4 `world_from_camera`; x right, y down, z forward |
| bodies | number, name, kind, reflectance, roughness, ior; files of vertices (n, 3), faces (m, 3) and normals (n, 3) in the world frame, null for flat faces |
| projectors | by name: `world_from_projector` (axes as a camera's); `half_tangents` of its field; `intensity_w_sr`: file (h, w, channels) on the tangent plane, first row on top |
| left_from_projector | pose of the device's projector in the frame of the left camera |
| sky | irradiance_w_m2, gradient, up (world): radiance L0 (1 + gradient w . up), irradiance pi L0 |
| electrons | electrons per pixel for a radiance of 1 W m^-2 sr^-1 (`radiometry.electrons_per_radiance`) |
| power_w | power of the device's projector |
| samples, seed | samples per pixel, and their seed |
"""  # noqa: E501

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera.errors import refusal

FILE = "job.json"
KINDS = ("diffuse", "glossy", "metal")
Pose = NDArray[np.float64]  # (4, 4) rigid, named `to_from`.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class JobBody:
    """One body of a scene, in the world frame."""

    name: str
    vertices_m: NDArray[np.float32]  # (n, 3)
    faces: NDArray[np.uint32]  # (m, 3), counter-clockwise from outside.
    normals: NDArray[np.float32] | None  # (n, 3); None gives flat shading.
    kind: str  # One of `KINDS`.
    reflectance: float  # Diffuse reflectance, or that of a metal at normal incidence.
    roughness: float  # GGX alpha of coat or metal.
    ior: float  # Refractive index of the coat.

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise refusal(
                f"kind of {self.name}",
                "must be one that the render job supports",
                repr(self.kind),
                f"Take one of {', '.join(KINDS)}.",
            )


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
    table = {
        "width": job.width,
        "height": job.height,
        "focal_px": job.focal_px,
        "centre_px": job.centre_px,
        "cameras": {side: pose.tolist() for side, pose in job.cameras.items()},
        "bodies": [_body(folder, number, body) for number, body in enumerate(job.bodies, 1)],
        "projectors": {name: _projector(folder, name, p) for name, p in job.projectors.items()},
        "left_from_projector": job.left_from_projector.tolist(),
        "sky": {
            "irradiance_w_m2": job.sky.irradiance_w_m2,
            "gradient": job.sky.gradient,
            "up": job.sky.up,
        },
        "electrons": job.electrons,
        "power_w": job.power_w,
        "samples": samples,
        "seed": seed,
    }
    (folder / FILE).write_text(json.dumps(table, indent=1), encoding="utf-8")


def _body(folder: Path, number: int, body: JobBody) -> dict[str, Any]:
    arrays = {"vertices": body.vertices_m, "faces": body.faces, "normals": body.normals}
    return {
        "number": number,
        "name": body.name,
        "kind": body.kind,
        "reflectance": body.reflectance,
        "roughness": body.roughness,
        "ior": body.ior,
        **{key: _save(folder, f"body-{number}-{key}", value) for key, value in arrays.items()},
    }


def _projector(folder: Path, name: str, part: JobProjector) -> dict[str, Any]:
    return {
        "world_from_projector": part.world_from_projector.tolist(),
        "half_tangents": part.half_tangents,
        "intensity_w_sr": _save(folder, name, part.intensity_w_sr),
    }


def _save(folder: Path, name: str, array: NDArray[Any] | None) -> str | None:
    if array is None:
        return None
    np.save(folder / f"{name}.npy", array)
    return f"{name}.npy"
