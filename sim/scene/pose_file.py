"""Files of camera poses: text, .npy or TOML, one pose or many.

A pose is `world_from_camera` in OpenCV's axes [m]: x right, y down, z forward. Text holds rows of
four numbers, four rows a pose, or a trajectory as of the TUM benchmark: `t x y z qx qy qz qw`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors, regular_file
from starling.sim import arrays, files, quantities
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.scene.placing import LookAt, Viewpoint

KEY = "world_from_camera"
_ROUNDING = 1e-3  # Tolerance of rotations; trajectories are often rounded.
_TUM = 8  # Numbers in a row of a trajectory.
_FORMS = "Write rows of 4 numbers, 4 rows a pose, or rows t x y z qx qy qz qw."


def views(path: Path | None, look_at: LookAt | None = None) -> list[Viewpoint]:
    """Views of a scene by a file of poses or by eye and target; the scene's own without both.

    Raises:
        InputError: if both are given; also as `read`.
    """
    if path is None:
        return [Viewpoint(look_at=look_at)]
    if look_at is not None:
        raise errors.refuse("pose, look-at", "must not both be given", "both", "Leave one out.")
    return read(path)


def of_matrices(values: object) -> list[Viewpoint]:
    """Viewpoints of one matrix (4, 4) or several (n, 4, 4), `world_from_camera`.

    Raises:
        InputError: if they are no rigid transforms.
    """
    return _matrices(arrays.numbers("pose", values))


def read(path: Path) -> list[Viewpoint]:
    """Read the poses of a file as views of a scene.

    Raises:
        InputError: if the file cannot be read, holds no pose, or a pose that is not rigid.
    """
    try:
        regular_file.refuse_others(path)
        if path.suffix.lower() == ".npy":
            return _named(path, np.load(path, allow_pickle=False))
        if path.suffix.lower() == ".toml":
            return _matrices(files.read_toml(path, _of_table))
        with errors.naming(path):
            return _of_text(regular_file.read(path).decode("utf-8-sig"))
    except errors.InputError:
        raise
    except FileNotFoundError:
        raise errors.refuse("pose", "must be a file that exists", path, "Check the path.") from None
    except (OSError, ValueError, EOFError) as error:
        raise errors.refuse("pose", "must be a file of poses", path, f"{error}. {_FORMS}") from None


def _of_table(table: dict[str, Any]) -> NDArray[Any]:
    for key in table:
        errors.one_of("key", key, [KEY])
    if KEY not in table:
        raise errors.refuse(KEY, "must be given", "nothing", "Give four rows of four numbers.")
    return arrays.numbers(KEY, table[KEY])


def _named(path: Path, values: NDArray[Any]) -> list[Viewpoint]:
    with errors.naming(path):
        return _matrices(values)


def _of_text(text: str) -> list[Viewpoint]:
    lines = (line.partition("#")[0].replace(",", " ").split() for line in text.splitlines())
    rows = [[float(word) for word in words] for words in lines if words]
    if rows and all(len(row) == _TUM for row in rows):
        return [_of_trajectory(number, row) for number, row in enumerate(rows)]
    if not rows or any(len(row) != 4 for row in rows):
        got = sorted({len(row) for row in rows}) or "nothing"
        raise errors.refuse("rows of poses", "must have 4 or 8 numbers", got, _FORMS)
    return _matrices(np.array(rows))


def _of_trajectory(number: int, row: list[float]) -> Viewpoint:
    length = float(np.linalg.norm(row[4:]))
    if not abs(length - 1) <= _ROUNDING:
        name, advice = f"quaternion of pose {number}", "The order is qx qy qz qw."
        raise errors.refuse(name, "must have length 1", f"{length:g}", advice)
    pose = frames.from_quaternion(np.array(row[1:4]), np.array(row[4:]))
    quantities.check(f"time of pose {number}", row[0], "time_s")
    return Viewpoint(pose=_checked(pose, number), timestamp=row[0])


def _matrices(values: NDArray[Any]) -> list[Viewpoint]:
    whole = values.ndim >= 2 and values.shape[-1] == 4 and values.size and values.size % 16 == 0
    if not whole or values.dtype.kind not in "fiu":
        got = f"{values.shape} {values.dtype}"
        raise errors.refuse("pose", "must be matrices of 4 x 4 numbers", got, _FORMS)
    poses = values.astype(np.float64).reshape(-1, 4, 4)
    return [Viewpoint(pose=_checked(pose, number)) for number, pose in enumerate(poses)]


def _checked(pose: Pose, number: int) -> Pose:
    frames.refuse_not_rigid(f"pose {number}", pose, rounding=_ROUNDING)
    left, _, right = np.linalg.svd(pose[:3, :3])
    pose = pose.copy()
    pose[:3, :3] = left @ right  # The nearest rotation: rounded digits are not rigid enough.
    return pose
