"""Loading of Mitsuba XML files, whose lights are replaced and whose values are checked."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from starling.patterns import errors, regular_file
from starling.sim.geometry import frames
from starling.sim.render import backend
from starling.sim.scene import mitsuba_surfaces, ply, serialized
from starling.sim.scene.scene import Ambient, Scene, Sun

SUN_Y_UP = (0.3, 0.9, 0.3)  # Above and in front, as the default is where y points down.
_FLOAT32 = 1e-5  # Rounding of Mitsuba's single-precision matrices.
_WHOLE = ("instance", "shapegroup")  # Shapes with child shapes, which are not supported.
# Checks of mesh files by plugin; Mitsuba checks the others itself.
_CHECKS = {"ply": ply.refuse_damaged, "serialized": serialized.refuse_damaged}
# Properties of surfaces that are shares of light.
_SHARE = re.compile(r"\w*reflectance|\w*transmittance|base_color|opacity|weight")
_COLOURS = ("color", "color0", "color1", "value")  # Properties of textures that are shares then.


def load(path: Path) -> Scene:
    """Load a Mitsuba 3 scene, y up, at the pose of its first sensor or Mitsuba's default pose.

    Projector and ambient light replace all emitters of the file and of files that it includes.
    The shapes of lamps remain. All surfaces reflect on both sides.

    Raises:
        InputError: if the file is missing, cannot be loaded, has no shapes, or has instances.
            Also if a mesh is damaged, a share of light is outside [0, 1], a material is not
            supported, or a matrix is not affine.
    """
    if not path.is_file():
        raise errors.refuse("scene", "must be a file that exists", path, "Check the path.")
    loaded = _without_lights(path)
    if not loaded.shapes():
        raise errors.refuse("scene", "must hold shapes", path, "Add a shape to the XML.")
    to_world = np.eye(4)
    if loaded.sensors():
        matrix = np.array(loaded.sensors()[0].world_transform().matrix, np.float64)
        to_world = matrix.reshape(4, 4)
        scale = np.linalg.norm(to_world[:3, :3], axis=0)
        to_world[:3, :3] /= np.where(scale > 0, scale, 1.0)
    world_from_left = frames.opencv_from_mitsuba(to_world)
    frames.refuse_not_rigid(f"to_world of the sensor in {path}", world_from_left, rounding=_FLOAT32)
    return Scene(
        name=path.stem,
        shapes=tuple(loaded.shapes()),
        ambient=Ambient(up=(0.0, 1.0, 0.0)),
        sun=Sun(towards=SUN_Y_UP),
        world_from_left=world_from_left,
    )


def _without_lights(path: Path) -> Any:
    """Load the file without emitters, including those attached to shapes."""
    mi = backend.mitsuba()
    with _resolver(path.parent) as resolver:
        _refuse_pipes(path, resolver, {}, {path})
        try:
            config = mi.parser.ParserConfig(mi.variant())
            state = mi.parser.parse_file(config, str(path))
            mi.parser.transform_upgrade(config, state)
            mi.parser.transform_resolve(config, state)
            _remove_lights(state)
            _refuse_nodes(state, path, resolver)
            mitsuba_surfaces.make_two_sided(state)
            mi.parser.transform_merge_equivalent(config, state)
            mi.parser.transform_merge_meshes(config, state)
            loaded = mi.parser.instantiate(config, state)
        except errors.InputError:
            raise
        except (RuntimeError, OSError, ValueError) as error:
            raise errors.refuse("scene", "must be a Mitsuba XML", path, f"{error}") from None
    _refuse_textures(loaded, state, path)
    return loaded


@contextmanager
def _resolver(folder: Path) -> Iterator[Any]:
    """Let paths of files start at a folder, until the context ends."""
    mi = backend.mitsuba()
    before = mi.file_resolver()
    resolver = mi.FileResolver(before)
    resolver.prepend(str(folder.resolve()))
    mi.set_file_resolver(resolver)
    try:
        yield resolver
    finally:
        mi.set_file_resolver(before)


def _refuse_pipes(path: Path, resolver: Any, values: dict[str, str], files: set[Path]) -> None:
    """Refuse pipes and devices, on which Mitsuba would wait for ever, and damaged matrices.

    Args:
        path: File of the scene, or a file that it includes.
        resolver: Mitsuba's search path; folders that the file names are added.
        values: Values of the parameters `$name`; those of the file are added.
        files: Files that are checked; the file's includes are added.
    """
    try:
        root = ElementTree.fromstring(regular_file.read(path))
    except (ElementTree.ParseError, OSError, ValueError) as error:
        raise errors.refuse("scene", "must be a Mitsuba XML", path, f"{error}.") from None
    for element in root.iter():
        attributes = {key: _substitute(text, values) for key, text in element.attrib.items()}
        if element.tag == "default":
            values.setdefault(attributes.get("name", ""), attributes.get("value", ""))
        if element.tag == "matrix":
            _refuse_not_affine(attributes.get("value", ""), path)
        if element.tag == "path":
            resolver.prepend(str(resolver.resolve(attributes.get("value", "."))))
        named = attributes.get("value") if attributes.get("name") == "filename" else None
        file = Path(str(resolver.resolve(attributes.get("filename") or named or ".")))
        if regular_file.is_pipe_or_device(file):
            raise errors.refuse(
                "scene", "must name regular files", f"{file} in {path}", "Is it a pipe?"
            )
        if element.tag == "include" and file not in files:
            files.add(file)
            _refuse_pipes(file, resolver, values, files)


def _refuse_not_affine(text: str, path: Path) -> None:
    """Refuse a matrix whose last row is not 0 0 0 1: Mitsuba would ignore the row."""
    words = re.split(r"[\s,]+", text.strip())
    if len(words) != 16:
        return
    try:
        row = [float(word) for word in words[12:]]
    except ValueError:  # Mitsuba refuses it.
        return
    if row != [0, 0, 0, 1]:
        rule, got = "must end with the row 0 0 0 1", " ".join(words[12:])
        raise errors.refuse(f"matrix in {path}", rule, got, "Is it transposed?")


def _substitute(text: str, values: dict[str, str]) -> str:
    for name in sorted(values, key=len, reverse=True):  # As Mitsuba: `$ab` before `$a`.
        text = text.replace(f"${name}", values[name])
    return text


def _remove_lights(state: Any) -> None:
    mi = backend.mitsuba()
    for node in state.nodes:
        for name, number in mitsuba_surfaces.children(node):
            if state.nodes[number].type == mi.ObjectType.Emitter:
                del node.props[name]


def _refuse_nodes(state: Any, path: Path, resolver: Any) -> None:
    """Refuse instances, damaged meshes and shares of light outside [0, 1]."""
    mi = backend.mitsuba()
    for node in state.nodes:
        plugin = node.props.plugin_name()
        if plugin in _WHOLE:
            raise errors.refuse(
                "scene", "must not hold instances", path, "Write each shape out, or export a mesh."
            )
        if plugin in _CHECKS and "filename" in node.props:
            mesh = Path(str(resolver.resolve(node.props["filename"])))
            try:
                _CHECKS[plugin](mesh)
            except (ValueError, OSError) as error:
                rule, advice = f"in {path} must be a mesh", f"It cannot be read: {error}"
                raise errors.refuse("shape", rule, mesh, advice) from None
        where = mi.parser.file_location(state, node)
        if node.type == mi.ObjectType.Texture:
            mitsuba_surfaces.refuse_texture(where, node)
        if node.type == mi.ObjectType.BSDF:
            mitsuba_surfaces.refuse_unknown(state, where, node)
            for name in filter(_SHARE.fullmatch, node.props.keys()):
                for value in _numbers(state, node, name):
                    errors.in_interval(f"{name} in {where}", value, 0.0, 1.0)


def _numbers(state: Any, node: Any, name: str) -> list[float]:
    """Numbers of a property: of a number, colour, spectrum or the colours of a texture."""
    types = backend.mitsuba().Properties.Type
    value, kind = node.props[name], node.props.type(name)
    if kind == types.ResolvedReference:
        texture = state.nodes[value.index()]
        colours = [colour for colour in _COLOURS if colour in texture.props]
        return [number for colour in colours for number in _numbers(state, texture, colour)]
    if kind in (types.Float, types.Integer):
        return [float(value)]
    if kind == types.Color:
        return [float(number) for number in value]
    return [float(number) for number in value.values] if kind == types.Spectrum else []


def _refuse_textures(loaded: Any, state: Any, path: Path) -> None:
    """Refuse pictures and colours of vertices that are shares of light outside [0, 1]."""
    mi = backend.mitsuba()
    attributes = {
        node.props.get("name", "")
        for node in state.nodes
        if node.props.plugin_name() == "mesh_attribute"
    }
    for key, value in mi.traverse(loaded):
        *_, owner, name = ("", *key.split("."))
        if name in attributes or (name == "data" and _SHARE.fullmatch(owner)):
            numbers = np.array(value, np.float64).ravel()
            outside = numbers[~((numbers >= 0) & (numbers <= 1))]
            for number in outside[:1].tolist():
                shown = name if name in attributes else owner
                errors.in_interval(f"{shown} of a texture in {path}", number, 0.0, 1.0)
