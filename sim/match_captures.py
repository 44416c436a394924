"""The work of `starling match`: our matcher on a capture's own infrared pair, held to account."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from patterns import errors
from sim import capture, capture_writer, depth, metrics, progress
from sim.capture import CapturedScene
from sim.output import OutputFolder
from sim.sensor import Sensor


def match_captures(
    captures: str,
    sensor: Sensor,
    *,
    out: Path | None = None,
    force: bool = False,
    tell: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Match the first frame of every scene and measure the outcome.

    Args:
        captures: a capture set or one scene in it, with infrared pairs.
        sensor: with the captures' geometry; its matcher and range are used.
        out: folder to make: our depth as a capture set. None writes nothing.
        force: replace a folder made before.
        tell: wraps the loop over scenes.

    Returns:
        `{"scenes": {NAME: {"ours": F, "device": F, "agreement": F}}, "median": {...}}`, F as
        `sim.metrics.disparity_figures` defines it; ours and the device's against the truth,
        agreement is ours against the device's. What cannot be had (no truth, no device depth)
        is NaN.

    Raises:
        InputError: captures that cannot be read or have no infrared pair, or a folder that
            cannot be written.
    """
    scenes = capture.open_set(captures).scenes
    found: dict[str, depth.DepthMap] = {}
    figures: dict[str, Any] = {}
    if out is None:
        for scene in tell(scenes, "match"):
            figures[scene.name] = _figures(scene, _match(scene, sensor))
        return {"scenes": figures, "median": _medians(figures)}
    with OutputFolder(out, force=force) as folder:
        for scene in tell(scenes, "match"):
            found = _match(scene, sensor)
            figures[scene.name] = _figures(scene, found)
            _write(folder, scene, found, sensor)
        result = {"scenes": figures, "median": _medians(figures)}
        capture_writer.write_set(
            folder,
            dataclasses.replace(scenes[0].info, notes=f"depth by starling match {captures}"),
            sensor,
            verb="match",
            arguments={"captures": captures},
            figures=result,
        )
    return {**result, "out": str(folder.path)}


def _match(scene: CapturedScene, sensor: Sensor) -> depth.DepthMap:
    frame = scene.frame(scene.frames[0])
    if frame.ir_left is None or frame.ir_right is None:
        raise errors.refuse(
            f"scene {scene.name}",
            "must hold ir_left.png and ir_right.png",
            scene.path,
            "Matching needs an infrared pair.",
        )
    return depth.measure(frame.ir_left, frame.ir_right, sensor, causes={})
