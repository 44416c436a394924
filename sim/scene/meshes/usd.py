"""USD stages (.usd, .usda, .usdc, .usdz): meshes and primitives with their looks.

Of an animated stage the first time is read. Polygons are cut into fans of triangles; subdivision
surfaces are read as their polygons.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from starling.patterns import errors, regular_file
from starling.sim.scene.meshes import usd_looks
from starling.sim.scene.meshes.appearance import MeshFile, Part
from starling.sim.scene.meshes.usd_looks import pxr
from starling.sim.scene.polygons import warn_of_concave

_SECTIONS = 64  # Sides of round primitives.
_UNUSED = {
    "PointInstancer": "point instancers",
    "Points": "points",
    "BasisCurves": "curves",
    "NurbsPatch": "patches",
    "SkelRoot": "skins",
    "Camera": "cameras",
    "Volume": "volumes",
}
# Turns a primitive along z to its axis.
_ALONG = {
    "X": np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
    "Y": np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]]),
    "Z": np.eye(4),
}


def refuse_without_reader() -> None:
    """Refuse the file if usd-core is not installed.

    Raises:
        InputError: if it is not.
    """
    try:
        pxr("Usd")
    except ImportError as error:
        raise errors.needs("USD", "usd-core", "scenes") from error


def read(path: Path) -> MeshFile:
    """Read a stage.

    Raises:
        ValueError: if the stage is damaged, or layers that it names are missing.
        OSError: if the file cannot be read.
    """
    Tf, Usd, UsdGeom, UsdUtils = map(pxr, ("Tf", "Usd", "UsdGeom", "UsdUtils"))
    regular_file.refuse_others(path)
    delegate = UsdUtils.CoalescingDiagnosticDelegate()  # It keeps warnings off stderr while alive.
    try:
        stage = Usd.Stage.Open(str(path))
        unresolved = [str(name) for name in UsdUtils.ComputeAllDependencies(str(path))[2]]
    except Tf.ErrorException as error:
        raise ValueError("it is no USD stage") from error
    delegate.TakeUncoalescedDiagnostics()
    # Omniverse brings MDL files of its own; materials that are not read are reported by kind.
    unresolved = [name for name in unresolved if not name.lower().endswith(".mdl")]
    layers = [name for name in unresolved if ".usd" in Path(name).suffix.lower()]
    if layers:
        raise ValueError(f"layers that it names are missing: {', '.join(layers)}")
    unit_m, up = float(UsdGeom.GetStageMetersPerUnit(stage)), str(UsdGeom.GetStageUpAxis(stage))
    if not 0 < unit_m < np.inf or up not in _ALONG:
        raise ValueError(f"its unit is {unit_m:g} m, and its up axis {up}")
    reading = _Reading(path, stage)
    prims = iter(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))
    for prim in prims:
        reading.add(prim)
        if prim.GetTypeName() == "PointInstancer":
            prims.PruneChildren()  # Prototypes below it are not drawn themselves.
    return MeshFile(
        parts=reading.parts,
        unit_m=unit_m,
        up=up.lower(),
        unused=frozenset(reading.unused | reading.looks.unused),
        missing=tuple(dict.fromkeys(unresolved)),
    )


class _Reading:
    """Parts of a stage, and what is not used of it."""

    def __init__(self, path: Path, stage: Any) -> None:
        Usd, UsdGeom = pxr("Usd"), pxr("UsdGeom")

        self.parts: list[Part] = []
        self.unused: set[str] = set()
        self.looks = usd_looks.UsdLooks()
        self._path = path
        self._time = (
            Usd.TimeCode(stage.GetStartTimeCode())
            if stage.HasAuthoredTimeCodeRange()
            else (Usd.TimeCode.Default())
        )
        self._places = UsdGeom.XformCache(self._time)
        self._makers = {
            "Mesh": self._mesh,
            "Cube": self._cube,
            "Sphere": self._sphere,
            "Cylinder": self._cylinder,
            "Cylinder_1": self._cylinder,
            "Capsule": self._capsule,
            "Cone": self._cone,
            "Plane": self._plane,
        }

    def add(self, prim: Any) -> None:
        """Add the parts of one prim that is drawn."""
        UsdGeom = pxr("UsdGeom")

        kind = str(prim.GetTypeName())
        if kind in _UNUSED:
            self.unused.add(_UNUSED[kind])
        if kind.endswith("Light"):
            self.unused.add("lights")
        if kind not in self._makers:
            return
        drawn = UsdGeom.Imageable(prim)
        if drawn.ComputeVisibility(self._time) == "invisible":
            return
        if drawn.ComputePurpose() not in ("default", "render"):
            return
        place = np.array(self._places.GetLocalToWorldTransform(prim), np.float64).T
        for part in self._makers[kind](prim):
            self.parts.append(_moved(part, place))

    def _mesh(self, prim: Any) -> list[Part]:
        UsdGeom, UsdShade = pxr("UsdGeom"), pxr("UsdShade")

        mesh = UsdGeom.Mesh(prim)
        points = _array(mesh.GetPointsAttr().Get(self._time), 3)
        counts = np.array(mesh.GetFaceVertexCountsAttr().Get(self._time) or [], np.int64)
        corners = np.array(mesh.GetFaceVertexIndicesAttr().Get(self._time) or [], np.int64)
        if not len(counts) or not len(points):
            return []
        name = prim.GetPath().pathString
        if counts.sum() != len(corners) or counts.min() < 0:
            raise ValueError(f"{name} has {len(corners)} corners, and its faces count otherwise")
        if len(corners) and not 0 <= corners.min() <= corners.max() < len(points):
            raise ValueError("a triangle has a vertex that is missing")
        starts = np.cumsum(counts) - counts
        self._warn_of_concave(points, counts, starts, corners)
        flipped = mesh.GetOrientationAttr().Get() == "leftHanded"
        triangles, polygon = _fans(counts, starts, flipped)  # Into `corners`; polygon of each.
        look = self.looks.of_prim(prim)
        sample = _Sampler(corners, polygon, triangles, len(points), len(counts))
        normals = sample.of_values(
            _array(mesh.GetNormalsAttr().Get(self._time), 3), mesh.GetNormalsInterpolation()
        )
        primvars = UsdGeom.PrimvarsAPI(prim)
        uv = self._uv(primvars, look, sample)
        colour = primvars.GetPrimvar("displayColor")
        rgb: NDArray[Any] | None = None
        if look.appearance.rgb is None and colour and colour.HasValue():
            rgb = sample.of_values(
                _array(colour.ComputeFlattened(self._time), 3), str(colour.GetInterpolation())
            )
        whole = Part(
            name=name,
            vertices=points[corners[triangles]].reshape(-1, 3),
            faces=np.arange(3 * len(triangles)).reshape(-1, 3),
            normals=normals,
            uv=uv,
            vertex_rgb=None if rgb is None else np.clip(rgb, 0, 1).astype(np.float32),
            appearance=look.appearance,
        )
        subsets = UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
        if not subsets:
            return [whole]
        left = np.ones(len(counts), bool)
        parts: list[Part] = []
        for subset in subsets:
            chosen = np.zeros(len(counts), bool)
            faces = np.array(subset.GetIndicesAttr().Get(self._time) or [], np.int64)
            if len(faces) and not 0 <= faces.min() <= faces.max() < len(counts):
                raise ValueError(f"{subset.GetPath()} has a face that is missing")
            chosen[faces] = True
            left &= ~chosen
            inner = self.looks.of_prim(subset.GetPrim())
            part = _cut(whole, chosen[polygon], subset.GetPrim().GetPath().pathString)
            uv = self._uv(primvars, inner, sample)
            uv = None if uv is None else uv.reshape(-1, 3, 2)[chosen[polygon]].reshape(-1, 2)
            parts.append(
                Part(
                    name=part.name,
                    vertices=part.vertices,
                    faces=part.faces,
                    normals=part.normals,
                    uv=uv,
                    vertex_rgb=part.vertex_rgb if inner.appearance.rgb is None else None,
                    appearance=inner.appearance,
                )
            )
        parts.append(_cut(whole, left[polygon], name))
        return [part for part in parts if len(part.faces)]

    def _uv(self, primvars: Any, look: usd_looks.Look, sample: _Sampler) -> NDArray[Any] | None:
        """Coordinates (3 m, 2) of the look's texture."""
        if look.appearance.image is None:
            return None
        primvar = primvars.GetPrimvar(look.uv_name)
        values = _array(primvar.ComputeFlattened(self._time), 2) if primvar else np.zeros((0, 2))
        uv = sample.of_values(values, str(primvar.GetInterpolation()) if primvar else "")
        if uv is None:
            self.unused.add("textures without coordinates")
            return None
        uv = uv * look.uv_scale + look.uv_offset
        uv[:, 1] = 1 - uv[:, 1]  # USD has v upwards.
        return uv

    def _warn_of_concave(
        self,
        points: NDArray[Any],
        counts: NDArray[Any],
        starts: NDArray[Any],
        corners: NDArray[Any],
    ) -> None:
        sizes = set(counts.tolist()) - {0, 1, 2, 3}
        wide = [corners[starts[counts == size][:, None] + np.arange(size)] for size in sizes]
        warn_of_concave(self._path, points, wide)

    def _solid(self, prim: Any, solid: trimesh.Trimesh, *, smooth: bool) -> list[Part]:
        look = self.looks.of_prim(prim)
        UsdGeom = pxr("UsdGeom")

        colour = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get(self._time)
        rgb = None
        if look.appearance.rgb is None and colour:
            rgb = np.tile(np.clip(np.array(colour[0], np.float32), 0, 1), (len(solid.vertices), 1))
        if look.appearance.image is not None:
            self.unused.add("textures without coordinates")
        return [
            Part(
                name=prim.GetPath().pathString,
                vertices=np.array(solid.vertices),
                faces=np.array(solid.faces),
                normals=np.array(solid.vertex_normals) if smooth else None,
                vertex_rgb=rgb,
                appearance=look.appearance,
            )
        ]

    def _size(self, prim: Any, name: str) -> float:
        return float(prim.GetAttribute(name).Get(self._time))

    def _along(self, prim: Any, solid: trimesh.Trimesh) -> trimesh.Trimesh:
        return solid.apply_transform(_ALONG[str(prim.GetAttribute("axis").Get())])

    def _cube(self, prim: Any) -> list[Part]:
        side = self._size(prim, "size")
        return self._solid(prim, trimesh.creation.box((side, side, side)), smooth=False)

    def _sphere(self, prim: Any) -> list[Part]:
        ball = trimesh.creation.icosphere(subdivisions=4, radius=self._size(prim, "radius"))
        return self._solid(prim, ball, smooth=True)

    def _cylinder(self, prim: Any) -> list[Part]:
        name = "radiusBottom" if prim.GetTypeName() == "Cylinder_1" else "radius"
        radius, height = self._size(prim, name), self._size(prim, "height")
        solid = trimesh.creation.cylinder(radius=radius, height=height, sections=_SECTIONS)
        return self._solid(prim, self._along(prim, solid), smooth=False)

    def _capsule(self, prim: Any) -> list[Part]:
        radius, height = self._size(prim, "radius"), self._size(prim, "height")
        solid = trimesh.creation.capsule(height=height, radius=radius, count=[_SECTIONS, _SECTIONS])
        solid.apply_translation(-solid.bounds.mean(axis=0))
        return self._solid(prim, self._along(prim, solid), smooth=True)

    def _cone(self, prim: Any) -> list[Part]:
        radius, height = self._size(prim, "radius"), self._size(prim, "height")
        solid = trimesh.creation.cone(radius=radius, height=height, sections=_SECTIONS)
        solid.apply_translation((0, 0, -height / 2))
        return self._solid(prim, self._along(prim, solid), smooth=False)

    def _plane(self, prim: Any) -> list[Part]:
        x, y = self._size(prim, "width") / 2, self._size(prim, "length") / 2
        axis = str(prim.GetAttribute("axis").Get())
        if axis != "Z":  # Width is along x, or z where the axis is x; length along y, or z.
            x, y = (y, x)
        corners = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]], np.float64)
        solid = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
        return self._solid(prim, self._along(prim, solid), smooth=False)


class _Sampler:
    """Values of a mesh at the corners of its triangles, by their interpolation."""

    def __init__(
        self,
        corners: NDArray[np.int64],
        polygon: NDArray[np.int64],
        triangles: NDArray[np.int64],
        points: int,
        polygons: int,
    ) -> None:
        self._corners, self._polygon, self._triangles = corners, polygon, triangles
        self._lengths = {
            "faceVarying": len(corners),
            "vertex": points,
            "varying": points,
            "uniform": polygons,
            "constant": 1,
        }

    def of_values(self, values: NDArray[Any], interpolation: str) -> NDArray[Any] | None:
        """Values (3 m, k) of `values` (n, k); None if their number does not fit."""
        if len(values) != self._lengths.get(interpolation, -1) or not len(values):
            return None
        places = {
            "faceVarying": self._triangles,
            "uniform": np.repeat(self._polygon[:, None], 3, axis=1),
            "constant": np.zeros_like(self._triangles),
        }.get(interpolation, self._corners[self._triangles])
        return values[places].reshape(-1, values.shape[1])


def _array(values: Any, width: int) -> NDArray[np.float64]:
    return np.array([] if values is None else values, np.float64).reshape(-1, width)


def _fans(
    counts: NDArray[np.int64], starts: NDArray[np.int64], flipped: bool
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles (m, 3) as places in the list of corners, and the polygon of each."""
    fans = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), fans)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(fans) - fans, fans)
    first = starts[polygon]
    triangles = np.stack([first, first + step + 1, first + step + 2], axis=1)
    return (triangles[:, ::-1] if flipped else triangles), polygon


def _cut(part: Part, chosen: NDArray[np.bool_], name: str) -> Part:
    """Triangles of a part whose triangles share no vertices."""
    each = np.repeat(chosen, 3)
    return Part(
        name=name,
        vertices=part.vertices[each],
        faces=np.arange(int(each.sum())).reshape(-1, 3),
        normals=None if part.normals is None else part.normals[each],
        uv=None if part.uv is None else part.uv[each],
        vertex_rgb=None if part.vertex_rgb is None else part.vertex_rgb[each],
        appearance=part.appearance,
    )


def _moved(part: Part, place: NDArray[np.float64]) -> Part:
    """A part at its place; a mirror turns its triangles, so that they still face outwards."""
    linear = place[:3, :3]
    mirrored = np.linalg.det(linear) < 0
    turn = np.linalg.pinv(linear)  # Normals move by the inverse transpose.
    return Part(
        name=part.name,
        vertices=part.vertices @ linear.T + place[:3, 3],
        faces=part.faces[:, ::-1] if mirrored else part.faces,
        normals=None if part.normals is None else part.normals @ turn,
        uv=part.uv,
        vertex_rgb=part.vertex_rgb,
        appearance=part.appearance,
    )
