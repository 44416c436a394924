"""A scene: bodies with near-infrared materials, lights, and the camera's pose."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import arrays, quantities
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.sensor.projector import Projector

# Upper limit of the light of sky or sun. Of daylight of 150 klx, imagers without a filter count
# 1,530 at 850 nm and 3,060 at 940 nm (`starling.sim.scene.spectra`).
BRIGHTEST_W_M2 = 4e3

_TUPLE = "Give a tuple."
_IMAGES = {"texture": ("h", "w"), "colour": ("h", "w", 3), "ambient_share": ("h", "w")}
Kind = Literal["diffuse", "glossy", "metal", "mirror", "glass"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Material:
    """Reflection of a surface at the laser's wavelength."""

    name: str
    kind: Kind = "diffuse"
    reflectance: float = 0.5  # Diffuse reflectance (of metals at normal incidence), in [0, 1].
    roughness: float = 0.1  # Microfacet slope (GGX alpha) of glossy and metal.
    ior: float = 1.5  # Refractive index of glass.
    rgb: tuple[float, float, float] | None = None  # Visible reflectance, linear; None is grey.

    def __post_init__(self) -> None:
        errors.unicode_text("name of a material", self.name)
        errors.one_of(f"kind of {self.name}", self.kind, get_args(Kind))
        errors.in_interval(f"reflectance of {self.name}", self.reflectance, 0.0, 1.0)
        errors.in_interval(f"roughness of {self.name}", self.roughness, 0.01, 1.0)
        errors.in_interval(f"ior of {self.name}", self.ior, 1.0, 3.0)
        for value in () if self.rgb is None else errors.triple(f"rgb of {self.name}", self.rgb):
            errors.in_interval(f"rgb of {self.name}", value, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Mesh:
    """Triangles in the body's frame [m]."""

    vertices: NDArray[np.float32]  # (n, 3)
    faces: NDArray[np.uint32]  # (m, 3), counter-clockwise seen from outside
    normals: NDArray[np.float32] | None = None  # (n, 3); None shades each face flat.
    uv: NDArray[np.float32] | None = None  # (n, 2) into the body's texture

    def __post_init__(self) -> None:
        arrays.check_form("mesh vertices", self.vertices, ("n", 3))
        quantities.check_array("mesh vertices", self.vertices, "coordinate_m")
        corners = len(self.vertices)
        arrays.check_form("mesh faces", self.faces, ("m", 3), kinds="iu")
        for number in (int(self.faces.min()), int(self.faces.max())):
            if not 0 <= number < corners:
                raise errors.refuse(
                    "mesh faces", "must index its vertices", number, "Export the file again."
                )
        if self.normals is not None:
            arrays.check_form("mesh normals", self.normals, (corners, 3), kinds="f")
            with np.errstate(all="ignore"):  # Huge numbers are refused below.
                lengths = np.sqrt(np.einsum("ij,ij->i", self.normals, self.normals))
            # Vertices without a triangle have no normal.
            lengths = lengths[self.faces]
            quantities.check_array("length of mesh normals", lengths, "unit_length")
        if self.uv is not None:
            arrays.check_form("mesh uv", self.uv, (corners, 2))
            quantities.check_array("mesh uv", self.uv, "uv")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Body:
    """A mesh with one material."""

    name: str
    mesh: Mesh
    material: Material
    world_from_body: Pose = field(default_factory=lambda: np.eye(4))
    # (h, w) reflectance that replaces the material's. All images need uv of the mesh.
    texture: NDArray[np.float32] | None = None
    # (h, w, 3) visible reflectance, linear, that replaces the material's `rgb`.
    colour: NDArray[np.float32] | None = None
    repeats: bool = False  # Images repeat outside uv of 0 to 1; otherwise their edges continue.
    # (h, w) local ambient light over the scene's, due to shadows and near lamps; None: 1.
    ambient_share: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        errors.unicode_text("name of a body", self.name)
        errors.instance(f"mesh of {self.name}", self.mesh, Mesh, "Give a starling.sim Mesh.")
        errors.instance(f"material of {self.name}", self.material, Material, "Give a Material.")
        name = f"world_from_body of {self.name}"
        arrays.check_form(name, self.world_from_body, (4, 4))
        frames.refuse_not_rigid(name, self.world_from_body, rounding=frames.SIMULATOR_ROUNDING)
        errors.instance(f"repeats of {self.name}", self.repeats, bool, "Give True or False.")
        for field_name, form in _IMAGES.items():
            image = getattr(self, field_name)
            if image is None:
                continue
            name = f"{field_name} of {self.name}"
            arrays.check_form(name, image, form)
            quantities.check_array(name, image, field_name)
            if self.mesh.uv is None:
                raise errors.refuse(name, "needs uv of the mesh", None, "Give Mesh(uv=...).")

    @property
    def world_mesh(self) -> Mesh:
        """The mesh in the world frame."""
        if np.array_equal(self.world_from_body, np.eye(4)):
            return self.mesh
        vertices, normals = move_mesh(self.mesh, self.world_from_body)
        return dataclasses.replace(self.mesh, vertices=vertices, normals=normals)


def move_mesh(mesh: Mesh, pose: Pose) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Vertices and normals of a mesh, moved by a pose `world_from_body` (4, 4)."""
    turn, shift = pose[:3, :3].T, pose[:3, 3]
    vertices = (mesh.vertices @ turn + shift).astype(np.float32)
    normals = None if mesh.normals is None else (mesh.normals @ turn).astype(np.float32)
    return vertices, normals


@dataclass(frozen=True, kw_only=True, slots=True)
class Ambient:
    """Ambient light: a sky of radiance L0 (1 + g w . up) from direction w.

    A diffuse surface of normal n receives pi L0 (1 + 2/3 g n . up) of an open sky. This closed form
    has no Monte-Carlo noise. Power is the equivalent power at the laser's wavelength.
    """

    irradiance_w_m2: float = 0.1  # pi L0 in the imager's band [W m^-2].
    gradient: float = 0.5  # g: 0 is uniform, 1 is dark from below.
    up: tuple[float, float, float] = (0.0, -1.0, 0.0)  # Unit, world frame.
    # Share of the sky's light that blocked directions lack (see `starling.sim.render.occlusion`).
    occlusion: float = 0.0
    reach_m: float = 1.0  # Surfaces farther away do not block; they are as bright as the sky.

    def __post_init__(self) -> None:
        errors.in_interval("ambient.irradiance_w_m2", self.irradiance_w_m2, 0.0, BRIGHTEST_W_M2)
        errors.in_interval("ambient.gradient", self.gradient, 0.0, 1.0)
        errors.in_interval("ambient.occlusion", self.occlusion, 0.0, 1.0)
        errors.in_interval("ambient.reach_m", self.reach_m, 0.01, 1e3, "Give metres.")
        unit = quantities.QUANTITIES["unit_length"]
        errors.direction("ambient.up", self.up, unit.low, unit.high, unit.remedy)


@dataclass(frozen=True, kw_only=True, slots=True)
class Sun:
    """Directional light with sharp shadows; the sun's diameter of half a degree is ignored."""

    irradiance_w_m2: float = 0.0  # On a surface facing it; units as `Ambient` [W m^-2].
    towards: tuple[float, float, float] = (0.3, -0.9, -0.3)  # World frame, any length.

    def __post_init__(self) -> None:
        errors.in_interval("sun.irradiance_w_m2", self.irradiance_w_m2, 0.0, BRIGHTEST_W_M2)
        errors.direction("sun.towards", self.towards, 1e-3, 1e3, "Give a direction.")


@dataclass(frozen=True, kw_only=True, slots=True)
class Finish:
    """Changes of the surfaces relative to their materials; the defaults change nothing.

    A finish has no effect on glass. For mirrors it changes only the reflectance. Shapes with their
    own BSDF (`Scene.shapes`) are unaffected.
    """

    of: str = "*"  # Names of the bodies, with wildcards `*` and `?`.
    reflectance_scale: float = 1.0  # Factor of the reflectance, which stays at most 1.
    gloss: float = 0.0  # Share of the surface that has a clear coat.
    metal: float = 0.0  # Share of the surface that is bare metal.
    roughness: float = 0.1  # Microfacet slope (GGX alpha) of coat and metal.
    transparency: float = 0.0  # Share of light that passes straight through, as in a thin pane.
    subsurface_m: float = 0.0  # Sigma of light's spread inside the surface [m].
    texture_contrast: float = 0.0  # Standard deviation of the relative reflectance over a surface.
    texture_slope: float = 3.0  # Exponent of the fall of its power density with frequency.

    def __post_init__(self) -> None:
        errors.in_interval("finish.reflectance_scale", self.reflectance_scale, 0.0, 20.0)
        for name in ("gloss", "metal", "transparency"):
            errors.in_interval(f"finish.{name}", getattr(self, name), 0.0, 1.0)
        errors.in_interval("finish.roughness", self.roughness, 0.01, 1.0)
        errors.in_interval("finish.subsurface_m", self.subsurface_m, 0.0, 0.05, "Give metres.")
        errors.in_interval("finish.texture_contrast", self.texture_contrast, 0.0, 1.0)
        errors.in_interval("finish.texture_slope", self.texture_slope, 0.0, 5.0)
        errors.unicode_text("finish.of", self.of)
        if not self.of:
            raise errors.refuse(
                "finish.of", "must name bodies", "''", "Give a name, or * for all of them."
            )

    def touches(self, name: str) -> bool:
        """Whether the finish acts on the body of this name."""
        return fnmatchcase(name, self.of)


@dataclass(frozen=True, kw_only=True, slots=True)
class Motion:
    """Steady motion of the sensor, in the left imager's frame at the middle of the exposure.

    Rotation is about the left imager.
    """

    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn_deg_s: tuple[float, float, float] = (0.0, 0.0, 0.0)  # Rotation vector per second.

    def __post_init__(self) -> None:
        errors.vector("motion.velocity_m_s", self.velocity_m_s, -50.0, 50.0)
        errors.vector("motion.turn_deg_s", self.turn_deg_s, -1000.0, 1000.0)

    @property
    def still(self) -> bool:
        """Whether the sensor is at rest."""
        return not any((*self.velocity_m_s, *self.turn_deg_s))


@dataclass(frozen=True, kw_only=True, slots=True)
class ModelError:
    """Error of the scene's position and scale relative to its model.

    The true position of a model point p, in the left imager's frame, is s R p + t.
    """

    scale: float = 1.0  # s, about the left imager.
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # t, left frame [m].
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)  # Rotation vector of R [deg].

    def __post_init__(self) -> None:
        errors.in_interval("model_error.scale", self.scale, 0.5, 2.0)
        errors.vector("model_error.shift_m", self.shift_m, -1.0, 1.0, "Give metres.")
        errors.vector("model_error.turn_deg", self.turn_deg, -45.0, 45.0)


_PARTS: dict[str, type] = {  # Type of each part of a scene.
    "ambient": Ambient,
    "sun": Sun,
    "other_projector": Projector,
    "finish": Finish,
    "motion": Motion,
    "model_error": ModelError,
}


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Scene:
    """A complete scene. The world frame is arbitrary; lengths are in metres."""

    name: str
    bodies: tuple[Body, ...] = ()
    shapes: tuple[Any, ...] = ()  # Loaded Mitsuba shapes, in addition to the bodies.
    ambient: Ambient = field(default_factory=Ambient)
    sun: Sun = field(default_factory=Sun)
    # Another device's projector in the left imager's frame, by default at a plausible distance.
    other_projector: Projector = field(
        default_factory=lambda: Projector(power_w=0.0, position_m=(0.2, 0.0, 0.0))
    )
    finish: Finish = field(default_factory=Finish)
    interreflection: float = 0.0  # Strength of light with two or more bounces; 1 is physical.
    motion: Motion = field(default_factory=Motion)
    model_error: ModelError = field(default_factory=ModelError)
    world_from_left: Pose = field(default_factory=lambda: np.eye(4))
    # Origin of the world in the frame of the scene's file [m]. Distant meshes are shifted to the
    # origin, because single precision does not resolve their coordinates.
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # Shadow rays end this share of their length before the surface, since surfaces measured with
    # noise would otherwise shadow themselves.
    shadow_tolerance: float = 1e-3

    def __post_init__(self) -> None:
        errors.unicode_text("scene.name", self.name)
        errors.instance("scene.bodies", self.bodies, tuple, _TUPLE)
        errors.instance("scene.shapes", self.shapes, tuple, _TUPLE)
        for body in self.bodies:
            errors.instance("entry of scene.bodies", body, Body, "Give bodies.")
        for name, kind in _PARTS.items():
            errors.instance(f"scene.{name}", getattr(self, name), kind, f"Give a {kind.__name__}.")
        if not self.bodies and not self.shapes:
            raise errors.refuse("scene", "must hold at least one body", self.name, "Add a body.")
        errors.in_interval("scene.interreflection", self.interreflection, 0.0, 1.0)
        errors.in_interval("scene.shadow_tolerance", self.shadow_tolerance, 1e-5, 0.1)
        errors.vector("scene.origin_m", self.origin_m, -frames.FARTHEST_M, frames.FARTHEST_M)
        arrays.check_form("scene.world_from_left", self.world_from_left, (4, 4))
        frames.refuse_not_rigid(
            "scene.world_from_left", self.world_from_left, rounding=frames.SIMULATOR_ROUNDING
        )

    @property
    def file_from_left(self) -> Pose:
        """Pose of the left imager (4, 4) in the frame of the scene's file."""
        file_from_left = np.array(self.world_from_left, np.float64)
        file_from_left[:3, 3] += self.origin_m
        return file_from_left
