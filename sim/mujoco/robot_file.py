"""URDF files: robots as they look, with a camera at every link."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

from starling.patterns import errors, regular_file
from starling.sim.mujoco import robot_meshes
from starling.sim.mujoco.library import mujoco

_COMPILER = {
    "discardvisual": "false",  # A camera sees the visual geometry.
    "fusestatic": "false",  # Fixed links keep their names.
    "boundmass": "1e-6",  # Links without inertia load too [kg].
    "boundinertia": "1e-9",  # [kg m^2]
}
_COLLISION = 3  # Group of collision geoms, which is not shown.
# Orientations (w, x, y, z) of MuJoCo's cameras in a link.
_IN_OPTICAL_FRAME = (0.0, 1.0, 0.0, 0.0)  # z forward, x right (REP 103, optical frames).
_IN_LINK = (0.5, 0.5, -0.5, -0.5)  # x forward, z up (REP 103).


def load(path: Path) -> Any:
    """Return `mujoco.MjModel` of a URDF.

    Visual geometry is shown, and the collision geometry of links that have no visual one. Each link
    has a camera of its name. It looks along z if the name contains `optical`, and along x
    otherwise.

    Raises:
        InputError: if the file or one that it names is missing or unreadable.
    """
    try:
        robot = ElementTree.fromstring(regular_file.read(path))
    except (ElementTree.ParseError, OSError, ValueError) as error:
        raise errors.refuse("scene", "must be a URDF", path, f"{error}.") from None
    _set_compiler(robot, path)
    files = robot_meshes.converted(robot)
    text = ElementTree.tostring(robot, encoding="unicode")
    try:
        spec = mujoco().MjSpec.from_string(text, assets=files)
        for mesh in spec.meshes:
            if mesh.file in files:  # A surface may be flat and enclose no volume.
                mesh.inertia = mujoco().mjtMeshInertia.mjMESH_INERTIA_SHELL
        for body in spec.bodies[1:]:  # The first one is the world.
            _hide_collision(body)
            quat = _IN_OPTICAL_FRAME if "optical" in body.name else _IN_LINK
            body.add_camera(name=body.name, quat=quat)
        return spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise errors.refuse("scene", "must load in MuJoCo", path, reason) from None


def _set_compiler(robot: ElementTree.Element, path: Path) -> None:
    """Keep what is visible, and name files by absolute paths."""
    extension = robot.find("mujoco")
    if extension is None:
        extension = ElementTree.Element("mujoco")
        robot.insert(0, extension)
    compiler = extension.find("compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(extension, "compiler")
    for key, value in _COMPILER.items():
        compiler.attrib.setdefault(key, value)
    compiler.attrib["strippath"] = "false"
    folder = path.absolute().parent
    meshes = folder / compiler.attrib.get("meshdir", "")
    for element in robot.iter("mesh"):
        element.attrib["filename"] = str(_file(element.attrib.get("filename", ""), folder, meshes))


def _file(name: str, folder: Path, meshes: Path) -> Path:
    """Path of a mesh: a URL of ROS, or a path below the URDF or its `meshdir`."""
    kind, _, rest = name.rpartition("://")
    known = [folder / rest, meshes / rest, meshes / Path(rest).name]
    if kind == "package":
        package, _, within = rest.partition("/")
        known = [top / within for top in folder.parents if top.name == package]
        known += [top / rest for top in (folder, *folder.parents)]
        known += [meshes / within, meshes / Path(rest).name]
    return next((file for file in known if file.is_file()), known[-1])


def _hide_collision(body: Any) -> None:
    """Move collision geoms to a group that is not shown, if there are visual ones."""
    solid = [geom for geom in body.geoms if geom.contype or geom.conaffinity]
    if len(solid) < len(body.geoms):
        for geom in solid:
            geom.group = _COLLISION
