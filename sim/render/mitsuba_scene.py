"""A scene loaded in Mitsuba."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.geometry.frames import Pose
from starling.sim.render import backend, bsdf, skylight
from starling.sim.render.mirrors_and_glass import Specular, shape_handle
from starling.sim.render.rays import opaque
from starling.sim.render.skylight import Skylight
from starling.sim.scene.scene import Body, Scene, move_mesh


class MitsubaScene:
    """Mitsuba's shapes of one `Scene`. They are built once and rendered from many poses."""

    def __init__(self, scene: Scene) -> None:
        """Build the shapes.

        Raises:
            InputError: if the scene is not in metres, or the camera is inside a body. Also if an
                entry of `scene.shapes` is no Mitsuba shape.
        """
        self.scene = scene
        kind = backend.mitsuba().Shape
        for shape in scene.shapes:
            errors.instance("entry of scene.shapes", shape, kind, "Load it with mitsuba.")
        bodies = (_shape(body, bsdf.from_body(body, scene.finish)) for body in scene.bodies)
        shapes = [*bodies, *scene.shapes]
        self.shapes = shapes
        self.mitsuba: Any = _scene(shapes)
        self.numbers = _numbers(shapes)  # Body number by Dr.Jit's shape handle.
        self._diffuse = _diffuse(scene, shapes)
        shares = [body.ambient_share for body in scene.bodies if body.ambient_share is not None]
        # Largest ambient share of any body.
        self.largest_share = max([1.0, *(float(share.max()) for share in shares)])
        self._shares = _shares(scene, shapes, self.largest_share)
        self.skylight = _skylight(scene, shapes)  # None if all surfaces are diffuse.
        # Mirrors and glass; None if there are none.
        self.specular = Specular.from_shapes(shapes) if backend.is_jit() else None
        _refuse_extent(self)
        refuse_inside(self)

    def body_numbers(
        self, handles: NDArray[np.uint32], valid: NDArray[np.bool_]
    ) -> NDArray[np.uint32]:
        """Return body numbers, from 1, of Dr.Jit's shape handles; 0 where not valid."""
        known = self.numbers[np.minimum(handles, len(self.numbers) - 1)]
        return np.where(valid, known, 0).astype(np.uint32)

    def albedo(self, si: Any) -> Any:
        """Reflectance of surface points, times their opaque share."""
        mi, dr = backend.mitsuba(), backend.drjit()
        surface = si.bsdf()
        if self._diffuse:
            table, handle = mi.BSDFPtr(self._diffuse), dr.reinterpret_array(mi.UInt32, si.shape)
            surface = dr.gather(mi.BSDFPtr, table, handle, si.is_valid())
        # Mitsuba's value for a mirror may exceed 1.
        albedo = dr.minimum(surface.eval_diffuse_reflectance(si, si.is_valid())[0], 1)
        return albedo * self.opaque(si)

    def ambient_share(self, si: Any) -> Any:
        """Local ambient light at surface points over the scene's."""
        mi, dr = backend.mitsuba(), backend.drjit()
        if not self._shares:
            return mi.Float(1)
        table, handle = mi.BSDFPtr(self._shares), dr.reinterpret_array(mi.UInt32, si.shape)
        surface = dr.gather(mi.BSDFPtr, table, handle, si.is_valid())
        return surface.eval_diffuse_reflectance(si, si.is_valid())[0] * self.largest_share

    def opaque(self, si: Any) -> Any:
        """Share of light that does not pass straight through surface points."""
        if self.specular is None or not self.specular.has_panes:
            return backend.mitsuba().Float(1)
        return 1 - si.bsdf().eval_null_transmission(si, si.is_valid())[0]

    @cached_property
    def albedo_scene(self) -> Any:
        """Mitsuba scene whose surfaces report `albedo`, for the scalar variant."""
        bodies, finish = self.scene.bodies, self.scene.finish
        return self._with_bsdfs([bsdf.albedo_bsdf(body, finish) for body in bodies])

    @cached_property
    def ambient_share_scene(self) -> Any:
        """Mitsuba scene whose albedo is the ambient share over the largest share.

        None if ambient light is even.
        """
        if all(body.ambient_share is None for body in self.scene.bodies):
            return None
        return self._with_bsdfs(
            [bsdf.ambient_share(body, self.largest_share) for body in self.scene.bodies]
        )

    def _with_bsdfs(self, bsdfs: list[dict[str, Any] | None]) -> Any:
        """Mitsuba scene with the given BSDFs; None keeps a body's BSDF."""
        if not any(bsdfs):
            return self.mitsuba
        bodies = self.scene.bodies
        replaced = [
            shape if surface is None else _shape(body, surface)
            for shape, body, surface in zip(self.shapes, bodies, bsdfs, strict=False)
        ]
        return _scene([*replaced, *self.shapes[len(bodies) :]])

    def place(self, poses: Mapping[str, Pose]) -> MitsubaScene:
        """Move bodies, and return the scene to render, with the bits of a newly built one.

        The shapes move in place, so this object and its copies are of no use afterwards.

        Args:
            poses: `world_from_body` (4, 4) by the body's name; other bodies keep theirs.

        Raises:
            InputError: unknown body, a pose that is not rigid, or as for a new scene.
        """
        names = {body.name for body in self.scene.bodies}
        for name in poses:
            errors.one_of("body", name, names)
        bodies = tuple(
            dataclasses.replace(body, world_from_body=poses[body.name])
            if body.name in poses
            else body
            for body in self.scene.bodies
        )
        scene = dataclasses.replace(self.scene, bodies=bodies)
        if not backend.is_jit():
            return MitsubaScene(scene)
        for number, body in enumerate(bodies):
            if body is not self.scene.bodies[number]:
                self._move(number, body)
        self._parameters.update()
        placed = copy.copy(self)
        placed.scene = scene
        _refuse_extent(placed)
        refuse_inside(placed)
        return placed

    def _move(self, number: int, body: Body) -> None:
        """Set the vertices of a body's shape, without an update of the scene."""
        mi, name = backend.mitsuba(), _key(number)
        vertices, normals = move_mesh(body.mesh, body.world_from_body)
        self._parameters[f"{name}.vertex_positions"] = mi.Float(vertices.ravel())
        if normals is not None:
            self._parameters[f"{name}.vertex_normals"] = mi.Float(normals.ravel())

    @cached_property
    def _parameters(self) -> Any:
        return backend.mitsuba().traverse(self.mitsuba)

    def with_scene(self, scene: Scene) -> MitsubaScene:
        """Return another scene in Mitsuba; equal surfaces are shared."""
        if scene is self.scene:
            return self
        surfaces = (self.scene.bodies, self.scene.shapes, self.scene.finish)
        if (scene.bodies, scene.shapes, scene.finish) != surfaces:
            return MitsubaScene(scene)
        shared = copy.copy(self)
        shared.scene = scene
        return shared

    def seen(self, ray: Any) -> Any:
        """Surface points that rays of an image meet first; rays side by side are traced together.

        Packets of rays give the bits of single rays.
        """
        mi = backend.mitsuba()
        return self.mitsuba.ray_intersect(ray, int(mi.RayFlags.All), coherent=True)

    def transmittance(self, ray: Any, active: Any, *, coherent: bool = False) -> Any:
        """Share of light that passes along rays to their ends; 0 in shadow.

        Glass and panes transmit a share of the light.

        Args:
            ray: Rays that end at the light or at the surface.
            active: Mask of the rays; the share of the others is 0.
            coherent: Whether adjacent rays are close, as those of an image (see `seen`).
        """
        dr, through = backend.drjit(), self.specular
        if through is None or not (through.has_glass or through.has_panes):
            return dr.select(active & ~self.mitsuba.ray_test(ray, coherent, active), 1.0, 0.0)
        return through.transmittance(self.mitsuba, ray, active)


_LARGEST_M = 2000.0  # Largest extent of a scene [m]; staircase:50 is 1,788 m wide.
_FARTHEST_M = 1e4  # Largest coordinate: single precision resolves 1 mm there [m].
_DIRECTIONS = 64  # Directions that test whether the camera is inside a body.


def _refuse_extent(mi_scene: MitsubaScene) -> None:
    """Refuse a scene that is not in metres."""
    bounds = mi_scene.mitsuba.bbox()
    extent = float(max(np.array(bounds.max).ravel() - np.array(bounds.min).ravel()))
    if extent > _LARGEST_M:
        rule = f"must be at most {_LARGEST_M:g} m"
        advice = "Give metres; of captures, check depth_unit_m and fx_px."
        raise errors.refuse("scene extent", rule, f"{extent:g} m in {mi_scene.scene.name}", advice)
    farthest = float(np.abs(np.concatenate([np.array(bounds.max), np.array(bounds.min)])).max())
    if farthest > _FARTHEST_M:
        rule, advice = f"must lie within {_FARTHEST_M:g} m of the origin", "Shift it."
        raise errors.refuse("scene", rule, f"{farthest:g} m in {mi_scene.scene.name}", advice)
    if extent == 0:
        raise errors.refuse("scene extent", "must be > 0", "0 m", "Is the mesh a point?")


def refuse_inside(mi_scene: MitsubaScene) -> None:
    """Refuse a camera that sees the back of a surface in every direction.

    Raises:
        InputError: if the camera is inside a body.
    """
    mi, dr = backend.mitsuba(), backend.drjit()
    eye = mi_scene.scene.world_from_left[:3, 3]
    origin = opaque("Point3f", eye)  # Otherwise each new pose would compile a kernel.
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(_DIRECTIONS)  # Directions on an even spiral.
    height = 1 - 2 * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    flat = np.sqrt(1 - height**2)
    directions = np.stack([flat * np.cos(turn), flat * np.sin(turn), height])
    for batch in [directions] if backend.is_jit() else directions.T:
        direction = mi.Vector3f(*map(mi.Float, batch))
        ray = mi.Ray3f(origin, direction)
        hit = mi_scene.mitsuba.ray_intersect(ray, int(mi.RayFlags.Minimal), coherent=False)
        if not dr.all(hit.is_valid() & (dr.dot(hit.n, direction) > 0)):
            return
    raise errors.refuse(
        "camera",
        "must stand outside every body",
        f"{np.round(eye, 3).tolist()} in {mi_scene.scene.name}",
        "Move it, or turn the normals of a room inwards.",
    )


def _numbers(shapes: list[Any]) -> NDArray[np.uint32]:
    """Table from Dr.Jit's shape handle to the shape's number, 1 for the first body."""
    if not backend.is_jit():
        return np.arange(1, len(shapes) + 1, dtype=np.uint32)
    handles = list(map(shape_handle, shapes))
    table = np.zeros(max(handles) + 1, np.uint32)
    table[handles] = np.arange(1, len(shapes) + 1)
    return table


def _diffuse(scene: Scene, shapes: list[Any]) -> list[Any]:
    """BSDFs by shape handle that report the albedo; empty if the shapes' own BSDFs do."""
    diffuse = [bsdf.albedo_bsdf(body, scene.finish) for body in scene.bodies]
    if not any(diffuse) or not backend.is_jit():
        return []
    mi = backend.mitsuba()
    surfaces = [shape.bsdf() for shape in shapes]
    for number, surface in enumerate(diffuse):
        if surface is not None:
            surfaces[number] = mi.load_dict(surface)
    return _by_handle(surfaces, shapes)


def _shares(scene: Scene, shapes: list[Any], largest: float) -> list[Any]:
    """BSDFs by shape handle whose reflectance is the ambient share over the largest share.

    Empty if ambient light is even.
    """
    bodies = scene.bodies
    if all(body.ambient_share is None for body in bodies) or not backend.is_jit():
        return []
    mi = backend.mitsuba()
    even = mi.load_dict({"type": "diffuse", "reflectance": 1 / largest})
    shares = [mi.load_dict(bsdf.ambient_share(body, largest)) for body in bodies]
    return _by_handle([*shares, *([even] * (len(shapes) - len(shares)))], shapes)


def _by_handle(surfaces: list[Any], shapes: list[Any]) -> list[Any]:
    """Table of the shapes' BSDFs by shape handle."""
    table: list[Any] = [surfaces[0]] * (max(map(shape_handle, shapes)) + 1)
    for surface, shape in zip(surfaces, shapes, strict=True):
        table[shape_handle(shape)] = surface
    return table


def _skylight(scene: Scene, shapes: list[Any]) -> Skylight | None:
    """Tables of reflected skylight. Shapes with their own BSDF count as diffuse."""
    if not backend.is_jit():  # `starling.sim.render.scalar` uses the tables itself.
        return None
    tables = [skylight.body_table(body, scene.finish) for body in scene.bodies]
    if all(table is None for table in tables):
        return None
    rest = [None] * (len(shapes) - len(tables))
    return Skylight([*tables, *rest], [shape_handle(shape) for shape in shapes])


def _scene(shapes: list[Any]) -> Any:
    """Build Mitsuba's scene of shapes, in their order."""
    named = {_key(number): shape for number, shape in enumerate(shapes)}
    return backend.mitsuba().load_dict({"type": "scene", **named})


def _key(number: int) -> str:
    return f"body_{number:04d}"


def _shape(body: Body, surface: dict[str, Any]) -> Any:
    """Build a Mitsuba mesh with a BSDF."""
    mi = backend.mitsuba()
    mesh = body.world_mesh
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(surface)
    props["face_normals"] = mesh.normals is None
    shape = mi.Mesh(
        body.name,
        vertex_count=len(mesh.vertices),
        face_count=len(mesh.faces),
        has_vertex_normals=mesh.normals is not None,
        has_vertex_texcoords=mesh.uv is not None,
        props=props,
    )
    params = mi.traverse(shape)
    params["vertex_positions"] = np.ascontiguousarray(mesh.vertices, np.float32).ravel()
    params["faces"] = np.ascontiguousarray(mesh.faces, np.uint32).ravel()
    if mesh.normals is not None:
        params["vertex_normals"] = np.ascontiguousarray(mesh.normals, np.float32).ravel()
    if mesh.uv is not None:
        params["vertex_texcoords"] = np.ascontiguousarray(mesh.uv, np.float32).ravel()
    params.update()
    return shape
