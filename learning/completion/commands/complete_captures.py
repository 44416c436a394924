"""The work of `starling complete`: captures with holes in, captures with completed depth out."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion import methods
from starling.learning.completion.data.pairs import Pair, Picture, pair
from starling.learning.completion.frame import Image
from starling.learning.completion.method import complete
from starling.sim.captures import capture, png
from starling.sim.captures import info as capture_info
from starling.sim.captures.capture import CapturedScene
from starling.sim.captures.info import CaptureInfo
from starling.sim.console import progress, record
from starling.sim.console.output import RECORD, Folder, OutputFolder, refuse_own_input
from starling.sim.scene import scene_file
from starling.sim.scene.captured import known_geometry
from starling.sim.stereo.depth import to_code

_OF_DEPTH = ("depth.png", "depth_colour.png", "sigma.png", "reason.png", "frame.exr")
_WRITTEN = {*_OF_DEPTH, "frame.json", scene_file.FILE}
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

    The set that is written is like the one read: `depth.png` completed, `sigma.png` its expected
    error in the same steps where the method tells one, all else as it was but what tells of the old
    depth (`reason.png`, `frame.exr`, `depth_colour.png`). A colour image is another view: there
    depth, `rgb.png` and `truth.png` are brought into it, and nothing else is written.

    Args:
        captures: capture set, or one scene in it.
        method: as `methods.asked` takes it.
        out: folder to make.
        picture: the image that goes with the depth.
        force: replace what was completed before.
        track: wraps the loop over frames.

    Returns:
        `{"out", "method", "frames", "cannot", "holes_before", "holes_after", "seconds_a_frame",
        "seconds"}`; holes are mean shares of pixels.

    Raises:
        InputError: whatever is wrong with captures, method or folder; nothing is left.
    """
    begun = time.perf_counter()
    given = capture.open_set(captures)
    given.refuse_mixed()
    refuse_own_input(out, given.path)
    ready = methods.asked(method)
    before, after, spent, cannot = [], [], [], 0
    arguments = {"captures": captures, "method": method, "picture": picture}
    with OutputFolder(out, force=force) as folder:
        folder.write(capture_info.FILE, capture_info.dumps(_info(given.info, picture)))
        frames = [(scene, number) for scene in given.scenes for number in scene.frames]
        for scene, number in track(frames, "complete"):
            one = pair(scene, number, picture)
            started = time.perf_counter()
            found = complete(ready, one.image, one.depth_m, one.valid)
            spent.append(time.perf_counter() - started)
            cannot += not np.isfinite(found.depth_m).any()
            before.append(float(1 - one.valid.mean()))
            code = to_code(found.depth_m, given.info.depth_unit_m)
            after.append(float((code == 0).mean()))
            said = {"completed_by": method, "said": found.said}
            if picture == "rgb":
                _write_view(folder, one, given.info.depth_unit_m)
            else:
                said = {**_copied(folder, scene, number), **said}
            _write(folder, one, code, found.sigma_m, given.info.depth_unit_m, said)
        figures = {
            "method": method,
            "frames": len(spent),
            "cannot": cannot,
            "holes_before": float(np.mean(before)),
            "holes_after": float(np.mean(after)),
            "seconds_a_frame": float(np.median(spent)),
        }
        told = {"verb": "complete", "arguments": arguments, "versions": record.versions()}
        folder.write(RECORD, record.dumps({**told, "figures": figures}))
    return {"out": str(folder.path), **figures, "seconds": round(time.perf_counter() - begun, 3)}


def _info(info: CaptureInfo, picture: Picture) -> CaptureInfo:
    """The camera of the view that depth is completed in."""
    if picture != "rgb" or info.colour is None:
        return info
    view = info.colour
    return dataclasses.replace(
        info, **dataclasses.asdict(view), colour=view, colour_from_left=_SAME_VIEW
    )


def _write(
    folder: Folder,
    one: Pair,
    code: NDArray[np.uint16],
    sigma_m: Image,
    unit_m: float,
    said: Mapping[str, Any],
) -> None:
    at = f"{one.scene}/{one.number}"
    folder.write(f"{at}/depth.png", png.encode(code))
    if np.isfinite(sigma_m).any():
        least = np.maximum(sigma_m, np.float32(unit_m))  # 0 says that it is not known.
        folder.write(f"{at}/sigma.png", png.encode(to_code(least, unit_m)))
    folder.write(f"{at}/frame.json", record.dumps(said))


def _write_view(folder: Folder, one: Pair, unit_m: float) -> None:
    """What belongs to a frame in the colour camera's view."""
    encode = png.encode_colour if one.image.ndim == 3 else png.encode
    folder.write(f"{one.scene}/{one.number}/rgb.png", encode(one.image))
    folder.write(f"{one.scene}/room", one.room + "\n")
    if one.truth_m is not None:
        folder.write(f"{one.scene}/truth.png", png.encode(to_code(one.truth_m, unit_m)))


def _copied(folder: OutputFolder, scene: CapturedScene, number: int) -> dict[str, Any]:
    """Copy what does not tell of depth, and pass on the frame's record."""
    frame = scene.path / str(number)
    for path in (*scene.path.iterdir(), *frame.iterdir()):
        if path.is_file() and path.name not in _WRITTEN:
            name = path.relative_to(scene.path).as_posix()
            folder.write(f"{scene.name}/{name}", path.read_bytes())
    folder.write(f"{scene.name}/room", scene.room + "\n")
    seen = known_geometry.carried(scene, folder.path / scene.name)
    if seen is not None:
        folder.write(f"{scene.name}/{scene_file.FILE}", scene_file.dumps(seen))
    told = scene.record(number)
    return {name: value for name, value in told.items() if name != "reasons"}
