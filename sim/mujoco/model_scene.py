"""A MuJoCo model in one state as a scene, and the poses of its geoms and cameras."""

from __future__ import annotations

import dataclasses
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.mujoco import geoms, looks
from starling.sim.mujoco.library import mujoco
from starling.sim.scene.scene import Ambient, Scene

GROUPS = (0, 1, 2)  # Groups of geoms that MuJoCo draws by default; others are for collisions.
UP = (0.0, 0.0, 1.0)


def scene(
    model: Any,
    data: Any,
    *,
    camera: str | None = None,
    groups: tuple[int, ...] = GROUPS,
    ambient_w_m2: float = 0.1,
) -> Scene:
    """Return what a model shows in one state: geoms with their colours and textures.

    Near-infrared reflectances are guessed from colours (see `starling.sim.scene.colours`). Infinite
    planes end 50 m from their middle. Skins and flexible bodies are left out, with a warning.

    Args:
        model: `mujoco.MjModel`.
        data: `mujoco.MjData` with current kinematics (`mujoco.mj_forward`).
        camera: name of the camera that becomes the left imager; None looks from the origin.
        groups: groups of geoms to show.
        ambient_w_m2: irradiance of ambient light from above.

    Raises:
        InputError: no model, nothing to show, or an unknown camera.

    Examples:
        >>> scene = starling.mujoco.scene(model, data, camera="wrist")
        >>> starling.simulate(scene, "d435").depth.depth_m.shape
        (480, 848)
    """
    refuse_model(model, groups)
    left = None if camera is None else camera_number(model, camera)
    numbers = shown(model, groups)
    title = f"mujoco {camera}" if camera else "mujoco"
    seen = assembled(model, data, numbers, name=title, ambient_w_m2=ambient_w_m2)
    pose = np.eye(4) if left is None else camera_pose(data, left)
    return dataclasses.replace(seen, world_from_left=pose)


def assembled(
    model: Any, data: Any, numbers: list[int], *, name: str, ambient_w_m2: float
) -> Scene:
    """Return the geoms with these numbers as a scene, seen from the origin."""
    bodies = tuple(
        dataclasses.replace(looks.body(model, geom, body), world_from_body=geom_pose(data, geom))
        for body, geom in zip(names(model, numbers), numbers, strict=True)
    )
    return Scene(name=name, bodies=bodies, ambient=Ambient(irradiance_w_m2=ambient_w_m2, up=UP))


def refuse_model(model: Any, groups: Any) -> None:
    """Refuse what is no `mujoco.MjModel`, and groups that no geom has.

    Raises:
        InputError: if one of them is wrong.
    """
    advice = "Load it: mujoco.MjModel.from_xml_path(PATH)."
    errors.instance("model", model, mujoco().MjModel, advice)
    for group in errors.instance("groups", groups, tuple, "Give a tuple, such as (0, 1, 2)."):
        errors.whole_number("entry of groups", group, 0, mujoco().mjNGROUP - 1)


def refuse_data(data: Any, model: Any) -> None:
    """Refuse what is no state of a model, and a state that is not finite.

    Raises:
        InputError: if one of them is so.
    """
    errors.instance("data", data, mujoco().MjData, "Give mujoco.MjData(model).")
    counts = [(len(data.geom_xpos), len(data.cam_xpos)), (model.ngeom, model.ncam)]
    if counts[0] != counts[1]:
        got = "{} geoms and {} cameras, not {} and {}".format(*counts[0], *counts[1])
        raise errors.refuse("data", "must be of the camera's model", got, "Make a new camera.")
    if not (np.isfinite(data.geom_xpos).all() and np.isfinite(data.geom_xmat).all()):
        rule, advice = "must be finite", "The simulation diverged: reset it, or shorten its step."
        raise errors.refuse("data", rule, "poses of NaN or infinity", advice)


def looks_of(model: Any) -> bytes:
    """Sizes, groups, colours and materials of all geoms, which a program may change."""
    geoms_have = ("size", "rgba", "matid", "group")
    materials_have = ("rgba", "metallic", "roughness", "texid", "texrepeat", "texuniform")
    fields = [f"geom_{name}" for name in geoms_have] + [f"mat_{name}" for name in materials_have]
    return b"".join(np.asarray(getattr(model, name)).tobytes() for name in fields)


def shown(model: Any, groups: tuple[int, ...], *, level: int = 3) -> list[int]:
    """Numbers of the geoms that are in the groups and not fully transparent.

    Args:
        model: `mujoco.MjModel`.
        groups: groups of geoms.
        level: of `warnings.warn`; 3 is the caller of the caller.

    Raises:
        InputError: if there is none.
    """
    known = geoms.names()
    numbers = [
        geom
        for geom in range(model.ngeom)
        if int(model.geom_group[geom]) in groups and looks.rgba(model, geom)[3] > 0
    ]
    unknown = sorted({int(model.geom_type[geom]) for geom in numbers} - set(known))
    dropped = [f"geoms of kind {kind}" for kind in unknown]
    dropped += [kind for kind in ("skin", "flex") if getattr(model, f"n{kind}")]
    if dropped:
        text = f"{', '.join(dropped)} are not shown. Convert them to meshes."
        warnings.warn(text, stacklevel=level)
    numbers = [geom for geom in numbers if int(model.geom_type[geom]) in known]
    if not model.ngeom:
        raise errors.refuse("model", "must have geoms", "none", "Are its meshes there?")
    if not numbers:
        rule = f"must have geoms in the groups {', '.join(map(str, groups)) or 'given'}"
        held = sorted({int(group) for group in model.geom_group})
        raise errors.refuse("model", rule, f"groups {held}", "Give groups=(...).")
    return numbers


def names(model: Any, numbers: list[int]) -> list[str]:
    """Names of bodies for geoms: the geom's name, or the body's with the geom's number."""
    return [
        model.geom(geom).name or f"{model.body(int(model.geom_bodyid[geom])).name or 'body'}/{geom}"
        for geom in numbers
    ]


def camera_number(model: Any, name: str) -> int:
    """Number of a named camera.

    Raises:
        InputError: if the model has none of this name, or it is no perspective camera.
    """
    known = [model.camera(number).name for number in range(model.ncam)]
    if not known:
        raise errors.refuse("camera", "must be a camera of the model", repr(name), "It has none.")
    errors.one_of("camera", name, known)
    number = int(model.camera(name).id)
    if int(model.cam_projection[number]) != mujoco().mjtProjection.mjPROJ_PERSPECTIVE:
        rule = "must be a perspective camera"
        raise errors.refuse("camera", rule, f"another kind of {name}", "Remove its projection.")
    return number


def camera_pose(data: Any, number: int) -> Pose:
    """Pose `world_from_camera` (4, 4) of a camera, in OpenCV's axes."""
    return frames.from_opengl(_pose(data.cam_xpos[number], data.cam_xmat[number]))


def geom_pose(data: Any, number: int) -> Pose:
    """Pose `world_from_geom` (4, 4)."""
    return _pose(data.geom_xpos[number], data.geom_xmat[number])


def _pose(place: NDArray[np.float64], turn: NDArray[np.float64]) -> Pose:
    if not turn.any():
        advice = "Call mujoco.mj_forward(model, data)."
        raise errors.refuse("data", "must have current kinematics", "poses of zeros", advice)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.reshape(turn, (3, 3)), place
    return pose


def intrinsics(model: Any, number: int, size: tuple[int, int]) -> NDArray[np.float64]:
    """Camera matrix (3, 3) [px] of a camera with images of (width, height).

    A camera with `sensorsize` has its own focal lengths and principal point; others have `fovy`.
    MuJoCo draws a principal point with positive offsets left of and above the image's middle.
    """
    width, height = size
    x, y = (width - 1) / 2, (height - 1) / 2
    if model.cam_sensorsize[number].any():
        focal_x, focal_y, left, up = model.cam_intrinsic[number].tolist()
        side_x, side_y = model.cam_sensorsize[number].tolist()
        fx, fy = focal_x / side_x * width, focal_y / side_y * height
        x, y = x - left / side_x * width, y - up / side_y * height
    else:
        fx = fy = height / 2 / np.tan(np.deg2rad(float(model.cam_fovy[number])) / 2)
    return np.array([[fx, 0, x], [0, fy, y], [0, 0, 1]])


def field_of(model: Any, number: int) -> bytes:
    """Return what the model states of a camera's field of view."""
    names = ("cam_fovy", "cam_intrinsic", "cam_sensorsize")
    return b"".join(np.asarray(getattr(model, name)[number]).tobytes() for name in names)


def resolution(model: Any, number: int) -> tuple[int, int] | None:
    """(width, height) of a camera's images; None if its file gives none."""
    width, height = model.cam_resolution[number].tolist()
    return None if width <= 1 or height <= 1 else (width, height)
