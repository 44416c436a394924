"""`starling export`: write captures in the layout of another program."""

from __future__ import annotations

import time
import warnings
from pathlib import Path
from typing import Any, Literal

from starling.patterns import errors
from starling.sim.captures import capture
from starling.sim.captures.capture import CaptureSet
from starling.sim.captures.exchange import bop, point_cloud, ros2_bag, tum
from starling.sim.captures.exchange.lerobot import dataset
from starling.sim.console import record
from starling.sim.console.output import RECORD, OutputFolder, refuse_own_input, refused

Layout = Literal["tum", "bop", "ros2", "lerobot", "ply", "pcd"]


def export(
    captures: str,
    layout: Layout,
    out: Path,
    *,
    meshes: Path,
    storage: ros2_bag.Storage = "sqlite3",
    task: str = "",
    force: bool = False,
) -> dict[str, Any]:
    """Write a capture set in another layout.

    TUM and BOP do not take `rgb.png`, as their images have the view of the depth. A warning says
    so.

    Args:
        captures: capture set, or one scene in it.
        layout: name of the layout.
        out: folder to create.
        meshes: folder with the objects' meshes (BOP only).
        storage: kind of file (ROS 2 only).
        task: task of all frames (LeRobot only); empty takes the name of the room.
        force: replace an earlier export.

    Returns:
        `{"out", "layout", "frames", "files", "seconds"}`.

    Raises:
        InputError: as the layout's `export`, a flag of another layout, or if the folder cannot be
            written; no partial output remains.
    """
    started = time.perf_counter()
    _refuse_unused("--storage", storage, storage != "sqlite3", layout, "ros2")
    _refuse_unused("--task", task, bool(task), layout, "lerobot")
    opened = capture.open_set(captures)
    refuse_own_input(out, opened.path)
    if layout in ("tum", "bop"):
        _warn_of_colour(opened)
    with OutputFolder(out, force=force) as folder:
        if layout == "tum":
            count = tum.export(opened.scenes, folder)
        elif layout == "ros2":
            with refused(folder.path):
                count = ros2_bag.export(opened.scenes, folder.partial / "bag", storage=storage)
        elif layout == "lerobot":
            with refused(folder.path):
                count = dataset.export(opened, folder.partial, task=task)
        elif layout in ("ply", "pcd"):
            count = point_cloud.export(opened.scenes, folder, layout)
        else:
            count = bop.export(opened, meshes, folder)
        arguments = {
            "captures": captures,
            "layout": layout,
            "meshes": str(meshes),
            "storage": storage,
            "task": task,
        }
        folder.write(RECORD, record.of_run("export", arguments, {"frames": count}))
    return {
        "out": str(folder.path),
        "layout": layout,
        "frames": count,
        "files": sum(path.is_file() for path in folder.path.rglob("*")),
        "seconds": round(time.perf_counter() - started, 3),
    }


def _refuse_unused(flag: str, value: str, is_set: bool, layout: Layout, owner: Layout) -> None:
    """Refuse a flag that another layout has."""
    if is_set and layout != owner:
        rule = f"must be left out with --layout {layout}"
        raise errors.refuse(flag, rule, repr(value), f"It belongs to --layout {owner}.")


def _warn_of_colour(captures: CaptureSet) -> None:
    """Warn of colour pictures, which the layout does not take."""
    frames = [scene.path / str(number) for scene in captures.scenes for number in scene.frames]
    if any((frame / "rgb.png").is_file() for frame in frames):
        message = f"{captures.path}: rgb.png is not exported; the layout takes ir_left.png."
        warnings.warn(message, stacklevel=2)
