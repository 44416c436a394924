"""Scenes of odd values are refused when they are built, or simulate."""

from __future__ import annotations

import dataclasses
import itertools
import re
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import starling
from starling.patterns.errors import InputError
from starling.sim.geometry import frames
from starling.sim.scene.scene import (
    Ambient,
    Body,
    Finish,
    Material,
    Mesh,
    ModelError,
    Motion,
    Scene,
    Sun,
)
from starling.sim.sensor.projector import Emitter, Projector

SIZE = ("width=48", "height=36", "fx_px=30", "fy_px=30", "cx_px=23.5", "cy_px=17.5")
SENSOR = starling.load_sensor("d435", edits=[*SIZE, "matcher.search_px=16"])
CORNERS = np.array([[-1, -1, 1], [-1, 1, 1], [1, 1, 1], [1, -1, 1]], np.float32)
FACES = np.array([[0, 3, 2], [0, 2, 1]], np.uint32)
NORMALS = np.array([[0, 0, -1]] * 4, np.float32)
UV = np.array([[0, 0], [0, 1], [1, 1], [1, 0]], np.float32)
GREY = np.full((2, 2), 0.5, np.float32)
MESH = Mesh(vertices=CORNERS, faces=FACES, normals=NORMALS, uv=UV)
PAINT = Material(name="paint")
BODY = Body(name="wall", mesh=MESH, material=PAINT, texture=GREY, ambient_share=GREY)
PROJECTOR = Projector(power_w=0.1, position_m=(0.2, 0.0, 0.0), emitters=(Emitter(),))
SCENE = Scene(name="wall", bodies=(BODY,), other_projector=PROJECTOR)
HUGE = 10 ** (sys.get_int_max_str_digits() + 1)  # Python prints no such number.
TALL = (0.0, -1.0, 0.0, 0.0)
TILTED = np.eye(4) + np.eye(4, k=1)
NUMBERS = ("xyz", None, 1.0, [0.0, 1.0, 0.0], (1.0,), TALL, np.zeros(3), iter((0, 1, 0)), ())
ENTRIES = ((1j, 0, 0), ("0", "1", "0"), (None,) * 3, (0, HUGE, 0), (0, np.nan, 0), (0, np.inf, 0))
NO_ARRAYS = (None, 1, "a", [[0.5, 0.5]], object(), np.ma.masked_array(GREY, GREY > 0))
NO_NUMBERS = (GREY > 0, GREY.astype(complex), GREY.astype(str), GREY.astype(object))


def _refuses(part: Any, field: str, value: Any, message: str) -> None:
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        dataclasses.replace(part, **{field: value})


@pytest.mark.parametrize(
    ("part", "field", "name"),
    [
        (Ambient(), "up", "ambient.up"),
        (Sun(), "towards", "sun.towards"),
        (Motion(), "velocity_m_s", "motion.velocity_m_s"),
        (Motion(), "turn_deg_s", "motion.turn_deg_s"),
        (ModelError(), "shift_m", "model_error.shift_m"),
        (ModelError(), "turn_deg", "model_error.turn_deg"),
        (Projector(), "position_m", "projector.position_m"),
        (Projector(), "rotation_deg", "projector.rotation_deg"),
        (Emitter(), "offset_m", "projector.emitters.offset_m"),
        (Emitter(), "rotation_deg", "projector.emitters.rotation_deg"),
        (SCENE, "origin_m", "scene.origin_m"),
    ],
)
def test_vectors_are_tuples_of_three_numbers(part: Any, field: str, name: str) -> None:
    for value in NUMBERS:
        _refuses(part, field, value, f"{name} must be a tuple of three numbers; got")
    for value in ENTRIES:
        with pytest.raises(InputError, match=rf"^{re.escape(name)}\.[xyz] must be in \["):
            dataclasses.replace(part, **{field: value})


@pytest.mark.parametrize("part", [PAINT, BODY, SCENE])
@pytest.mark.parametrize("value", [None, 5, b"wall", ["wall"], "\ud800", "a\udcff"])
def test_names_are_unicode_text(part: Any, value: Any) -> None:
    with pytest.raises(InputError, match=r"name.* must be (of type str|Unicode text); got "):
        dataclasses.replace(part, name=value)


@pytest.mark.parametrize("value", [None, 5, ["*"], np.array(["*", "a"]), "\ud800"])
def test_patterns_of_names_are_unicode_text(value: Any) -> None:
    for part, field in ((Finish(), "of"), (Projector(), "pattern"), (Emitter(), "pattern")):
        with pytest.raises(InputError, match=rf"{field} must be (of type str|Unicode text); got "):
            dataclasses.replace(part, **{field: value})


def test_colours_are_tuples_of_three_shares() -> None:
    for value in (1.0, [0.5] * 3, (), (0.5,), (0.5,) * 4):
        _refuses(PAINT, "rgb", value, "rgb of paint must be a tuple of three numbers; got")
    for value in ((0.5, 0.5, 1.5), (0.5, "a", 0.5), (np.nan, 0.5, 0.5)):
        _refuses(PAINT, "rgb", value, "rgb of paint must be in [0, 1]; got")


@pytest.mark.parametrize("field", ["texture", "ambient_share"])
def test_images_of_a_body_are_refused(field: str) -> None:
    name = f"{field} of wall"
    for value in NO_ARRAYS[1:]:
        _refuses(BODY, field, value, f"{name} must be ")
    for value in NO_NUMBERS:
        _refuses(BODY, field, value, f"{name} must hold real numbers; got")
    for value in (GREY[:0], GREY[:, :0], GREY[0], GREY[..., None]):
        _refuses(BODY, field, value, f"{name} must be (h, w), not empty; got")
    for value in (np.nan, np.inf, -np.inf):
        _refuses(BODY, field, GREY * value, f"{name} must be finite; got")
    for value in (-GREY, GREY * np.float32(1e4), (GREY * 2e4).astype(np.uint16)):
        _refuses(BODY, field, value, f"{name} must be in [0, 1")
    bare = dataclasses.replace(MESH, uv=None)
    with pytest.raises(InputError, match=f"^{name} needs uv of the mesh; got None"):
        Body(name="wall", mesh=bare, material=PAINT, **{field: GREY})


def test_codes_of_eight_bits_are_no_reflectance() -> None:
    _refuses(BODY, "texture", np.full((2, 2), 200, np.uint8), "texture of wall must be in [0, 1]")


@pytest.mark.parametrize(
    ("field", "array", "shape"),
    [("vertices", CORNERS, "(n, 3)"), ("normals", NORMALS, "(4, 3)"), ("uv", UV, "(4, 2)")],
)
def test_points_of_a_mesh_are_refused(field: str, array: np.ndarray, shape: str) -> None:
    for value in NO_ARRAYS[1:]:
        _refuses(MESH, field, value, f"mesh {field} must be ")
    for value in NO_NUMBERS:
        _refuses(MESH, field, value, f"mesh {field} must hold ")
    for value in (array[:0], array[0], array[:, :1], array[None]):
        _refuses(MESH, field, value, f"mesh {field} must be {shape}, not empty; got")
    for value in (np.nan, np.inf, 1e30):
        with pytest.raises(InputError, match=rf"mesh {field} must be (finite|in \[)"):
            dataclasses.replace(MESH, **{field: array + np.float32(value)})


def test_longer_lists_than_the_vertices_are_refused() -> None:
    _refuses(MESH, "normals", NORMALS[:3], "mesh normals must be (4, 3)")
    _refuses(MESH, "uv", np.vstack([UV, UV[:1]]), "mesh uv must be (4, 2)")


def test_normals_have_unit_length_where_there_are_triangles() -> None:
    for factor in (0, 0.5, 2):
        _refuses(MESH, "normals", NORMALS * np.float32(factor), "length of mesh normals must be ")
    _refuses(MESH, "normals", NORMALS.astype(int), "mesh normals must hold floating-point numbers")
    unused = np.vstack([NORMALS, np.zeros((1, 3), np.float32)])
    Mesh(vertices=np.vstack([CORNERS, CORNERS[:1]]), faces=FACES, normals=unused)


@pytest.mark.parametrize("kind", [np.float64, np.float16, np.longdouble])
def test_normals_of_any_precision_are_accepted(kind: type) -> None:
    slant = np.array([[0.6, 0.0, -0.8]] * 4, kind)
    assert dataclasses.replace(MESH, normals=slant).normals is slant


def test_faces_number_vertices() -> None:
    signed = FACES.astype(np.int64)
    for value in NO_ARRAYS:
        _refuses(MESH, "faces", value, "mesh faces must be ")
    for value in (*NO_NUMBERS, FACES.astype(float), FACES + 0.5, FACES * np.nan):
        _refuses(MESH, "faces", value, "mesh faces must hold whole numbers; got")
    for value in (FACES[:0], FACES[:, :2], FACES[0]):
        _refuses(MESH, "faces", value, "mesh faces must be (m, 3), not empty; got")
    for value in (signed - 1, signed - 2**32, signed + 1, signed + 2**40):
        _refuses(MESH, "faces", value, "mesh faces must index its vertices; got")


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        (None, "must be of type ndarray"),
        (np.eye(4).tolist(), "must be of type ndarray"),
        (np.ma.masked_array(np.eye(4)), "must be a"),
        (np.eye(3), "must be (4, 4)"),
        (np.eye(5), "must be (4, 4)"),
        (np.ones(16), "must be (4, 4)"),
        (np.eye(4) * 1j, "must hold real numbers"),
        (np.eye(4).astype(str), "must hold real numbers"),
        (np.eye(4) * np.nan, "must be rigid"),
        (np.zeros((4, 4)), "must be rigid"),
        (np.diag([2.0, 2, 2, 1]), "must be rigid"),
        (TILTED, "must be rigid"),
        (np.diag([-1.0, 1, 1, 1]), "must turn, not mirror"),
    ],
)
def test_poses_are_rigid(pose: Any, message: str) -> None:
    _refuses(SCENE, "world_from_left", pose, f"scene.world_from_left {message}")


def test_poses_of_simulators_are_accepted() -> None:
    pose = frames.pose((1.0, 2.0, 3.0), (20.0, -40.0, 70.0)).astype(np.float32)
    assert dataclasses.replace(SCENE, world_from_left=pose).world_from_left is pose


@pytest.mark.parametrize("shape", [None, 1, "a", BODY])
def test_shapes_are_of_mitsuba(shape: Any) -> None:
    scene = dataclasses.replace(SCENE, shapes=(shape,))
    with pytest.raises(InputError, match=r"^entry of scene\.shapes must be of type Shape; got"):
        starling.simulate(scene, SENSOR)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("emitters", None, "projector.emitters must be of type tuple"),
        ("emitters", [Emitter()], "projector.emitters must be of type tuple"),
        ("emitters", (None,), "entry of projector.emitters must be of type Emitter"),
        ("pattern_seed", 0.5, "projector.pattern_seed must be an integer"),
        ("pattern_seed", -1, "projector.pattern_seed must be an integer"),
        ("faults_seed", None, "projector.faults_seed must be an integer"),
    ],
)
def test_projectors_are_refused(field: str, value: Any, message: str) -> None:
    _refuses(Projector(), field, value, message)


def _with(path: tuple[str | int, ...], value: Any, tree: Any = SCENE) -> Any:
    """Return the tree with the value at a path of fields and entries."""
    if not path:
        return value
    head, *rest = path
    if isinstance(head, int):
        entries = list(tree)
        entries[head] = _with(tuple(rest), value, entries[head])
        return tuple(entries)
    new = _with(tuple(rest), value, getattr(tree, head))
    return dataclasses.replace(tree, **{head: new})


def _paths(tree: Any, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Return the paths of all fields of a tree, and of the entries of its tuples."""
    if dataclasses.is_dataclass(tree):
        steps = [(field.name, getattr(tree, field.name)) for field in dataclasses.fields(tree)]
    else:
        steps = list(enumerate(tree)) if isinstance(tree, tuple) else []
    inner = [_paths(value, (*path, step)) for step, value in steps]
    return [*([path] if path else []), *itertools.chain.from_iterable(inner)]


ODD = [
    *(None, True, 0, 1, -1, 2, 0.5, -0.0, 1e-300, 1e30, np.nan, np.inf, 10**400, HUGE, 1j),
    *("", "a", "a\0b", "\ud800", "*", b"x", [], {}, set(), (), (1,), (0, 1, 0), (0.5,) * 3, TALL),
    *(("0", "1", "0"), (None,) * 3, (1j, 0, 0), [0, 1, 0], {0: 1}, object(), iter((0, 1, 0))),
    *(np.float32(0.5), np.float16(1), np.int64(1), np.bool_(True), np.str_("a"), np.zeros(3)),
    *(np.zeros((0, 0)), np.zeros((0, 3)), np.zeros((2, 2)), np.ones((1, 1)), GREY * np.nan, -GREY),
    *(np.full((2, 2), 200, np.uint8), GREY.astype(np.float16), GREY.astype(np.longdouble)),
    *(GREY > 0, GREY * 1j, GREY.astype(object), GREY.astype(str), np.asfortranarray(GREY[::-1])),
    *(CORNERS.astype(np.float16), CORNERS.astype(int), CORNERS[::-1], CORNERS * 0, CORNERS * 1e5),
    *(FACES.astype(np.int8), FACES[:, ::-1], FACES * 0, FACES.astype(int) - 1, FACES + 0.5),
    *(UV.astype(bool), UV * 100, UV + np.inf, NORMALS * 0, NORMALS[:3], -NORMALS, NORMALS * 2),
    *(np.eye(4), np.eye(4, dtype=np.float16), np.eye(4, dtype=np.longdouble), np.eye(4, dtype=int)),
    *(np.eye(3), np.eye(5), -np.eye(4), TILTED, np.eye(4)[::-1], np.ma.masked_array(np.eye(4))),
    *(MESH, PAINT, BODY, SCENE, Ambient(), Sun(), Finish(), Motion(), Projector(), Emitter(), Mesh),
]


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(_paths(SCENE)), st.sampled_from(ODD))
def test_any_scene_is_refused_or_simulates(path: tuple[str | int, ...], value: Any) -> None:
    try:
        scene = _with(path, value)
        reading = starling.simulate(scene, SENSOR)
    except InputError as error:
        assert "\n" not in str(error)
        return
    assert np.isfinite(scene.file_from_left).all()
    assert reading.ir_left.any()
