"""Files of MuJoCo models (MJCF) and robots (URDF), loaded by MuJoCo."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors, regular_file
from starling.sim.mujoco import robot_file
from starling.sim.mujoco.library import mujoco
from starling.sim.mujoco.model_scene import scene
from starling.sim.scene.scene import Scene

SUFFIXES = (".xml", ".mjcf", ".urdf")
_START = 65536  # Bytes in which the first element of a file stands.
# Comments, processing instructions and declarations of XML.
_NO_ELEMENT = re.compile(r"<!--.*?(?:-->|$)|<\?.*?(?:\?>|$)|<!.*?(?:>|$)", re.DOTALL)


def is_model(path: Path) -> bool:
    """Whether a file is a model of MuJoCo or a URDF: its first element is `mujoco` or `robot`."""
    if path.suffix.lower() not in SUFFIXES or not path.is_file():
        return False
    return _first_element(path) in ("mujoco", "robot")


def _first_element(path: Path) -> str:
    """Name of the first element; empty if there is none."""
    text = regular_file.read(path)[:_START].decode("utf-8", errors="replace")
    element = re.search(r"<\s*([^\s<>/?!]+)", _NO_ELEMENT.sub("", text))
    return element[1] if element else ""


def load(
    path: Path, *, camera: str | None = None, keyframe: str = "", qpos: Path | None = None
) -> Scene:
    """Load a model in one state as a scene.

    Args:
        path: MJCF or URDF file.
        camera: name of the camera that becomes the left imager; None looks from the origin.
        keyframe: name of the model's keyframe; empty takes its reference state.
        qpos: `.npy` or text file of generalized positions (nq,), in place of a keyframe.

    Raises:
        InputError: if MuJoCo cannot load the file or a file that it names, or the state does not
            fit. Also if there is nothing to show, or the camera is unknown.
    """
    model, data = load_model(path)
    if keyframe and qpos is not None:
        raise errors.refuse("qpos", "must not be given with keyframe", qpos, "Drop one of them.")
    if keyframe:
        known = [model.key(number).name for number in range(model.nkey)]
        if not known:
            raise errors.refuse("keyframe", "must be in the model", keyframe, "It has none.")
        errors.one_of("keyframe", keyframe, known)
        mujoco().mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    if qpos is not None:
        data.qpos[:] = _positions(qpos, int(model.nq))
    mujoco().mj_forward(model, data)
    return scene(model, data, camera=camera)


def cameras(path: Path) -> list[str]:
    """Names of a model's cameras."""
    model, _ = load_model(path)
    return [model.camera(number).name for number in range(model.ncam)]


def load_model(path: Path) -> tuple[Any, Any]:
    """Return `mujoco.MjModel` and `mujoco.MjData` of a file.

    Raises:
        InputError: if MuJoCo cannot load it.
    """
    model = model_of(path)
    return model, mujoco().MjData(model)


def model_of(path: Path | str) -> Any:
    """Return `mujoco.MjModel` of an MJCF or URDF file.

    A URDF shows its visual geometry, and has a camera at every link, of the link's name. It looks
    along z if the name contains `optical`, as in ROS, and along x otherwise.

    Raises:
        InputError: if MuJoCo cannot load it.

    Examples:
        >>> model = starling.mujoco.model_of("arm.urdf")
        >>> starling.mujoco.DepthCamera(model, "camera_infra1_optical_frame", "d435")
    """
    path = Path(path)
    if not path.is_file():
        raise errors.refuse("scene", "must be a file that exists", path, "Check the path.")
    if _first_element(path) == "robot":
        return robot_file.load(path)
    try:
        return mujoco().MjModel.from_xml_path(str(path))
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise errors.refuse("scene", "must load in MuJoCo", path, reason) from None


def _positions(path: Path, count: int) -> NDArray[np.float64]:
    try:
        if path.suffix == ".npy":
            values = np.load(path, allow_pickle=False)
        else:
            values = np.loadtxt(path, ndmin=1)
        values = np.asarray(values, np.float64)
    except (OSError, ValueError, TypeError, EOFError) as error:
        raise errors.refuse("qpos", "must be .npy or text", path, str(error)) from None
    if values.shape != (count,) or not np.isfinite(values).all():
        rule = f"must be ({count},) finite numbers, as the model's nq"
        raise errors.refuse("qpos", rule, f"{values.shape} in {path}", "Save data.qpos.")
    return values
