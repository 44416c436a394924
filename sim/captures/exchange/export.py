"""The work of `starling export`: captures in, another program's layout out."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Literal

from starling.sim.captures import capture
from starling.sim.captures.exchange import bop, ros2_bag, tum
from starling.sim.console import record
from starling.sim.console.output import RECORD, OutputFolder, refuse_own_input

Layout = Literal["tum", "bop", "ros2"]


def export(
    captures: str, layout: Layout, out: Path, *, meshes: Path, force: bool = False
) -> dict[str, Any]:
    """Write a capture set in another layout.

    Args:
        captures: capture set, or one scene in it.
        layout: whose.
        out: folder to make.
        meshes: folder of the objects' meshes, for BOP.
        force: replace what was exported before.

    Returns:
        `{"out", "layout", "frames", "files", "seconds"}`.

    Raises:
        InputError: as the layouts', or for the folder; nothing is left.
    """
    started = time.perf_counter()
    given = capture.open_set(captures)
    refuse_own_input(out, given.path)
    with OutputFolder(out, force=force) as folder:
        if layout == "tum":
            count = tum.export(given.scenes, folder)
        elif layout == "ros2":
            count = ros2_bag.export(given.scenes, folder.partial / "bag")
        else:
            count = bop.export(given, meshes, folder)
        arguments = {"captures": captures, "layout": layout, "meshes": str(meshes)}
        told = {"verb": "export", "arguments": arguments, "versions": record.versions()}
        folder.write(RECORD, record.dumps({**told, "figures": {"frames": count}}))
    return {
        "out": str(folder.path),
        "layout": layout,
        "frames": count,
        "files": sum(path.is_file() for path in folder.path.rglob("*")),
        "seconds": round(time.perf_counter() - started, 3),
    }
