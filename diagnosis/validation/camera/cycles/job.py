"""What Cycles is to render: a folder of `job.json` and arrays, whose lengths are metres.

| key | what |
| --- | --- |
| width, height | of the images [px] |
| focal_px, centre_px | (fx, fy), (cx, cy) of both views; an integer is a pixel's centre |
| cameras | by side: `world_from_camera`, rows of a 4 x 4; x right, y down, z forward |
| bodies | number, name, kind, reflectance, roughness, ior; names of the files of vertices (n, 3), faces (m, 3) and normals (n, 3) in the world, normals null where faces are flat |
| projectors | by name: `world_from_projector` (axes as a camera's); `half_tangents` of its field; `intensity_w_sr`, a file (h, w, channels) over the field on the tangent plane, first row on top |
| left_from_projector | the device's own projector in the left camera's frame |
| sky | irradiance_w_m2, gradient, up (world): radiance L0 (1 + gradient w . up), pi L0 the irradiance |
| electrons | in a pixel for a radiance of 1 W m^-2 sr^-1, by `radiometry.electrons_per_radiance` |
| power_w | of the device's own projector |
| samples, seed | places in a pixel; of these places |
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
class Body:
    """One thing of a scene, in the world's frame."""

    name: str
    vertices_m: NDArray[np.float32]  # (n, 3)
    faces: NDArray[np.uint32]  # (m, 3), counter-clockwise seen from outside.
    normals: NDArray[np.float32] | None  # (n, 3); None shades each face flat.
    kind: str  # One of `KINDS`.
    reflectance: float  # Diffuse share; of a metal at normal incidence.
    roughness: float  # Microfacets' slope (GGX alpha) of coat and metal.
    ior: float  # Of the coat.

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise refusal(
                f"kind of {self.name}",
                "must be one that Cycles is told",
                repr(self.kind),
                f"Take one of {', '.join(KINDS)}.",
            )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Projector:
    """A point that shines into a rectangular field about its z axis."""

    world_from_projector: Pose
    half_tangents: tuple[float, float]  # Of half the field, across and down.
    intensity_w_sr: NDArray[np.float32]  # (h, w, channels) over the field, even in tangents.


@dataclass(frozen=True, kw_only=True, slots=True)
class Sky:
    """Light from all round that nothing stands before."""

    irradiance_w_m2: float  # pi L0.
    gradient: float  # Radiance is L0 (1 + gradient w . up) in direction w.
    up: tuple[float, float, float]  # Unit, world.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Job:
    """One scene with its lights and both views."""

    width: int  # [px]
    height: int  # [px]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    cameras: Mapping[str, Pose]  # world_from_camera by side.
    bodies: tuple[Body, ...]  # Numbered from 1.
    projectors: Mapping[str, Projector]  # `own-N` with dots and even, `other-N` with dots.
    left_from_projector: Pose  # The own one's.
    sky: Sky
    electrons: float  # For a radiance of 1 W m^-2 sr^-1.
    power_w: float  # Of the own projector.


def write(job: Job, folder: Path, *, samples: int, seed: int) -> None:
    """Write a job's files.

    Args:
        job: what to render.
        folder: made where it is not.
        samples: places in a pixel.
        seed: of these places.

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


def _body(folder: Path, number: int, body: Body) -> dict[str, Any]:
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


def _projector(folder: Path, name: str, part: Projector) -> dict[str, Any]:
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
