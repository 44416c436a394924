"""Surface materials of a parsed Mitsuba XML: which are known, and both sides of each."""

from __future__ import annotations

from typing import Any

from starling.patterns import errors
from starling.sim.render import backend

# Fewest and most materials inside a material, by plugin. Mitsuba ends the process for some counts.
_INSIDE = {"blendbsdf": (2, 2), "bumpmap": (1, 1), "mask": (1, 1), "normalmap": (1, 1)}
_BOTH = "twosided"
# Materials that reflect on their front only.
_ONE_SIDED = frozenset({"conductor", "diffuse", "measured", "plastic", "pplastic"}) | {
    *("principled", "roughconductor", "roughplastic"),
}
_KNOWN = {
    **dict.fromkeys(_ONE_SIDED, (0, 0)),
    **dict.fromkeys(("circular", "dielectric", "measured_polarized", "null"), (0, 0)),
    **dict.fromkeys(("polarizer", "principledthin", "retarder"), (0, 0)),
    **dict.fromkeys(("roughdielectric", "thindielectric"), (0, 0)),
    **_INSIDE,
    _BOTH: (1, 2),
}
_PICTURE = "bitmap"
_TEXTURES = (
    *(_PICTURE, "checkerboard", "mesh_attribute"),
    *("blackbody", "d65", "irregular", "rawconstant", "regular", "srgb", "uniform"),
)
_BUMPS = ("bumpmap", "normalmap")  # Materials whose texture must be a picture.
_TRANSMISSION = "spec_trans"  # Property of a `principled` material that lets light through.


def refuse_unknown(state: Any, where: str, node: Any) -> None:
    """Refuse a material that is not supported, or has too few or many materials inside.

    Args:
        state: parsed scene.
        where: place in the file, for the message.
        node: node of the material.

    Raises:
        InputError: if it is.
    """
    plugin = node.props.plugin_name()
    errors.one_of(f"bsdf in {where}", plugin, _KNOWN)
    low, high = _KNOWN[plugin]
    kind = backend.mitsuba().ObjectType.BSDF
    count = sum(state.nodes[number].type == kind for _, number in children(node))
    if not low <= count <= high:
        wanted = str(low) if low == high else f"{low} or {high}"
        rule = f"must have {wanted} material{'s' if high > 1 else ''} inside"
        raise errors.refuse(f"{plugin} in {where}", rule, count, "Complete the file.")
    inner = [state.nodes[number].props.plugin_name() for _, number in children(node)]
    wrong = [name for name in inner if name in _TEXTURES and name != _PICTURE]
    if plugin in _BUMPS and wrong:
        rule, advice = "must have a bitmap as texture", "Bake it to a picture."
        raise errors.refuse(f"{plugin} in {where}", rule, wrong[0], advice)


def refuse_texture(where: str, node: Any) -> None:
    """Refuse a texture that is not supported, or a picture without a file.

    Args:
        where: place in the file, for the message.
        node: node of the texture.

    Raises:
        InputError: if it is.
    """
    plugin = node.props.plugin_name()
    errors.one_of(f"texture in {where}", plugin, _TEXTURES)
    if plugin == _PICTURE and "filename" not in node.props:
        rule, advice = "must have a filename", "Complete the file."
        raise errors.refuse(f"{plugin} in {where}", rule, "none", advice)


def make_two_sided(state: Any) -> None:
    """Let all surfaces reflect on both sides, as real ones and those of meshes do.

    Mitsuba's materials are black from behind, and its rectangles and disks are often seen so.
    """
    mi = backend.mitsuba()
    both = {
        number
        for node in state.nodes
        if node.props.plugin_name() == _BOTH
        for number in _inside(state, node)
    }
    for number in range(len(state.nodes)):
        node = state.nodes[number]
        if node.type == mi.ObjectType.Shape and not _materials(state, node):
            node.props["bsdf"] = mi.Properties.ResolvedReference(len(state.nodes))
            state.nodes.append(_like(node, "diffuse"))
            number = len(state.nodes) - 1
            node = state.nodes[number]
        plugin = node.props.plugin_name()
        if plugin in _ONE_SIDED and _TRANSMISSION not in node.props and number not in both:
            inner = _like(node, plugin)
            inner.props = mi.Properties(node.props)
            wrapped = mi.Properties(_BOTH)
            wrapped["bsdf"] = mi.Properties.ResolvedReference(len(state.nodes))
            state.nodes.append(inner)
            state.nodes[number].props = wrapped


def children(node: Any) -> list[tuple[str, int]]:
    """Property and number of the nodes inside a node."""
    kind = backend.mitsuba().Properties.Type.ResolvedReference
    names = [name for name in node.props.keys() if node.props.type(name) == kind]  # noqa: SIM118
    return [(name, node.props[name].index()) for name in names]


def _materials(state: Any, node: Any) -> list[int]:
    kind = backend.mitsuba().ObjectType.BSDF
    return [number for _, number in children(node) if state.nodes[number].type == kind]


def _inside(state: Any, node: Any) -> set[int]:
    """Return the numbers of all materials inside a material, at any depth."""
    inner = _materials(state, node)
    return {*inner, *(each for number in inner for each in _inside(state, state.nodes[number]))}


def _like(node: Any, plugin: str) -> Any:
    """Build a material at the place of a node in the file."""
    mi = backend.mitsuba()
    result = mi.parser.SceneNode()
    result.type, result.props = mi.ObjectType.BSDF, mi.Properties(plugin)
    result.file_index, result.offset = node.file_index, node.offset
    return result
