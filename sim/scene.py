"""A scene: bodies with near-infrared materials, ambient light, and where the camera stands."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from patterns import errors
from sim.frames import Pose


@dataclass(frozen=True, kw_only=True, slots=True)
class Material:
    """How a surface returns light at the laser's wavelength."""

    name: str
    kind: Literal["diffuse", "glossy", "metal"] = "diffuse"
    reflectance: float = 0.5  # Diffuse share (of a metal: at normal incidence), in [0, 1].
    roughness: float = 0.1  # Microfacet slope (GGX alpha) of glossy and metal.

    def __post_init__(self) -> None:
        errors.one_of(f"kind of {self.name}", self.kind, ("diffuse", "glossy", "metal"))
        errors.in_interval(f"reflectance of {self.name}", self.reflectance, 0.0, 1.0)
        errors.in_interval(f"roughness of {self.name}", self.roughness, 0.01, 1.0)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Mesh:
    """Triangles in the world frame [m]."""

    vertices: NDArray[np.float32]  # (n, 3)
    faces: NDArray[np.uint32]  # (m, 3), counter-clockwise seen from outside
    normals: NDArray[np.float32] | None = None  # (n, 3); None shades each face flat.
    uv: NDArray[np.float32] | None = None  # (n, 2) into the body's texture

    def __post_init__(self) -> None:
        for name, array in (("vertices", self.vertices), ("faces", self.faces)):
            if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
                raise errors.refuse(
                    f"mesh {name}", "must be (n, 3) with n > 0", array.shape, "Is the mesh empty?"
                )
        if not np.isfinite(self.vertices).all():
            raise errors.refuse("mesh vertices", "must be finite", "NaN", "Repair the mesh.")
        if int(self.faces.max()) >= len(self.vertices):
            raise errors.refuse(
                "mesh faces", "must index its vertices", int(self.faces.max()), "Repair the mesh."
            )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Body:
    """One thing of the scene."""

    name: str
    mesh: Mesh
    material: Material
    texture: NDArray[np.float32] | None = None  # (h, w) reflectance that replaces the material's


@dataclass(frozen=True, kw_only=True, slots=True)
class Ambient:
    """Light that is not the projector's: an unoccluded sky of radiance L0 (1 + g w . up).

    A diffuse surface of normal n receives pi L0 (1 + 2/3 g n . up) in closed form, so this
    layer has no Monte-Carlo noise. Its power is counted at the laser's wavelength.
    """

    irradiance_w_m2: float = 0.1  # pi L0, in the band that the imager passes [W m^-2].
    gradient: float = 0.5  # g: 0 is the same from everywhere, 1 is dark from below.
    up: tuple[float, float, float] = (0.0, -1.0, 0.0)  # Unit, world frame.

    def __post_init__(self) -> None:
        errors.in_interval("ambient.irradiance_w_m2", self.irradiance_w_m2, 0.0, 2e3)
        errors.in_interval("ambient.gradient", self.gradient, 0.0, 1.0)
        length = float(np.linalg.norm(self.up))
        errors.in_interval("length of ambient.up", length, 0.999, 1.001, "Give a unit vector.")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Scene:
    """Everything a sensor looks at; the world frame is free, lengths are metres."""

    name: str
    bodies: tuple[Body, ...] = ()
    shapes: tuple[Any, ...] = ()  # Mitsuba shapes, loaded, that are there beside the bodies.
    ambient: Ambient = field(default_factory=Ambient)
    world_from_left: Pose = field(default_factory=lambda: np.eye(4))
    # A ray from the projector counts as arrived when it ends this share of its length short:
    # surfaces measured with noise would otherwise shadow themselves.
    shadow_tolerance: float = 1e-3

    def __post_init__(self) -> None:
        if not self.bodies and not self.shapes:
            raise errors.refuse("scene", "must hold at least one body", self.name, "Add a body.")
        errors.in_interval("scene.shadow_tolerance", self.shadow_tolerance, 1e-5, 0.1)
