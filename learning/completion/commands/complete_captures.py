"""Implementation of `starling complete`: fills the holes of captures."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion import methods
from starling.learning.completion.data.pairs import Pair, Picture, read_pair
from starling.learning.completion.method import Image, complete
from starling.patterns import errors
from starling.sim.captures import capture, png
from starling.sim.captures import info as capture_info
from starling.sim.captures.capture import CapturedScene
from starling.sim.captures.info import CaptureInfo
from starling.sim.console import progress, record
from starling.sim.console.output import RECORD, Folder, OutputFolder, refuse_own_input
from starling.sim.scene import scene_file
from starling.sim.scene.captured import known_geometry
from starling.sim.stereo.depth import to_code

# Files that belong to the old depth and are not copied.
_OF_DEPTH = ("depth.png", "depth_colour.png", "sigma.png", "reason.png", "frame.exr")
_NOT_COPIED = {*_OF_DEPTH, "frame.json", scene_file.FILE}
_SAME_VIEW = ((1.0, 0, 0, 0), (0, 1.0, 0, 0), (0, 0, 1.0, 0), (0, 0, 0, 1.0))


def complete_captures(
    captures: str,
    method: str,
    out: Path,
    *,
    picture: Picture = "ir_left",
    force: bool = False,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Complete every frame of a capture set, or of one scene.

    The output is a capture set with completed `depth.png`, and with its expected error `sigma.png`
    in the same unit if the method estimates it. Other files are copied, except those of the old
    depth (`reason.png`, `frame.exr`, `depth_colour.png`). For a colour image, `depth.png`,
    `rgb.png` and `truth.png` are written in the view of the colour camera, and nothing else.

    Args:
        captures: capture set, or one scene of it.
        method: see `methods.create`.
        out: output folder.
        picture: image to use with the depth.
        force: replace earlier results.
        track: wraps the loop over frames.

    Returns:
        `{"out", "method", "frames", "cannot", "holes_before", "holes_after", "seconds_a_frame",
        "seconds"}`; holes are mean shares of pixels.

    Raises:
        InputError: if captures, method or folder are invalid; then nothing is written.
    """
    start = time.perf_counter()
    captured = capture.open_set(captures)
    captured.refuse_mixed()
    refuse_own_input(out, captured.path)
    ready = methods.create(method)
    before, after, durations, cannot = [], [], [], 0
    arguments = {"captures": captures, "method": method, "picture": picture}
    with OutputFolder(out, force=force) as folder:
        folder.write(capture_info.FILE, capture_info.dumps(_info(captured.info, picture)))
        frames = [(scene, number) for scene in captured.scenes for number in scene.frames]
        for scene, number in track(frames, "complete"):
            pair = read_pair(scene, number, picture)
            frame_start = time.perf_counter()
            with errors.naming(f"scene {scene.name}, frame {number}"):
                completed = complete(ready, pair.image, pair.depth_m, pair.valid)
            durations.append(time.perf_counter() - frame_start)
            cannot += not np.isfinite(completed.depth_m).any()
            before.append(float(1 - pair.valid.mean()))
            code = to_code(completed.depth_m, captured.info.depth_unit_m)
            after.append(float((code == 0).mean()))
            frame_record = {"completed_by": method, "said": completed.note}
            if picture == "rgb":
                _write_view(folder, pair, captured.info.depth_unit_m)
            else:
                frame_record = {**_copy(folder, scene, number), **frame_record}
            _write(folder, pair, code, completed.sigma_m, captured.info.depth_unit_m, frame_record)
        figures = {
            "method": method,
            "frames": len(durations),
            "cannot": cannot,
            "holes_before": float(np.mean(before)),
            "holes_after": float(np.mean(after)),
            "seconds_a_frame": float(np.median(durations)),
        }
        content = {"verb": "complete", "arguments": arguments, "versions": record.versions()}
        folder.write(RECORD, record.dumps({**content, "figures": figures}))
    return {"out": str(folder.path), **figures, "seconds": round(time.perf_counter() - start, 3)}


def _info(info: CaptureInfo, picture: Picture) -> CaptureInfo:
    """Return the capture information of the view in which depth is completed."""
    if picture != "rgb" or info.colour is None:
        return info
    view = info.colour
    return dataclasses.replace(
        info, **dataclasses.asdict(view), colour=view, colour_from_left=_SAME_VIEW
    )


def _write(
    folder: Folder,
    pair: Pair,
    code: NDArray[np.uint16],
    sigma_m: Image,
    unit_m: float,
    frame_record: Mapping[str, Any],
) -> None:
    """Write one completed frame."""
    folder_name = f"{pair.scene}/{pair.number}"
    folder.write(f"{folder_name}/depth.png", png.encode(code))
    if np.isfinite(sigma_m).any():
        clipped = np.maximum(sigma_m, np.float32(unit_m))  # In the file, 0 means unknown.
        folder.write(f"{folder_name}/sigma.png", png.encode(to_code(clipped, unit_m)))
    folder.write(f"{folder_name}/frame.json", record.dumps(frame_record))


def _write_view(folder: Folder, pair: Pair, unit_m: float) -> None:
    """Write image, room and truth of a frame in the colour camera's view."""
    encode = png.encode_colour if pair.image.ndim == 3 else png.encode
    folder.write(f"{pair.scene}/{pair.number}/rgb.png", encode(pair.image))
    folder.write(f"{pair.scene}/room", pair.room + "\n")
    if pair.truth_m is not None:
        folder.write(f"{pair.scene}/truth.png", png.encode(to_code(pair.truth_m, unit_m)))


def _copy(folder: OutputFolder, scene: CapturedScene, number: int) -> dict[str, Any]:
    """Copy files that do not depend on depth, and return the frame's record."""
    frame = scene.path / str(number)
    for path in (*scene.path.iterdir(), *frame.iterdir()):
        if path.is_file() and path.name not in _NOT_COPIED:
            name = path.relative_to(scene.path).as_posix()
            folder.write(f"{scene.name}/{name}", path.read_bytes())
    folder.write(f"{scene.name}/room", scene.room + "\n")
    geometry = known_geometry.for_folder(scene, folder.path / scene.name)
    if geometry is not None:
        folder.write(f"{scene.name}/{scene_file.FILE}", scene_file.dumps(geometry))
    content = scene.record(number)
    return {name: value for name, value in content.items() if name != "reasons"}
