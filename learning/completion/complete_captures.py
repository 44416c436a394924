"""The work of `starling complete`: captures with holes in, captures with completed depth out."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

import numpy as np

from learning.completion import methods
from learning.completion.method import Completed, complete
from learning.completion.pairs import Pair, Picture, pairs
from sim import capture, capture_info, png, progress, record
from sim.capture_info import CaptureInfo
from sim.depth import to_code
from sim.output import RECORD, Folder, OutputFolder, refuse_own_input

_SAME_VIEW = ((1.0, 0, 0, 0), (0, 1.0, 0, 0), (0, 0, 1.0, 0), (0, 0, 0, 1.0))


def complete_captures(
    captures: str,
    method: str,
    out: Path,
    *,
    picture: Picture = "ir_left",
    force: bool = False,
    tell: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Complete every frame of a capture set, or of one scene.

    The set that is written is like the one read: `depth.png` completed, `sigma.png` its expected
    error in the same steps where the method tells one, the infrared image or `rgb.png` it went by,
    `truth.png` where there is one. Depth is in the view of that picture.

    Args:
        captures: capture set, or one scene in it.
        method: as `methods.asked` takes it.
        out: folder to make.
        picture: the image that goes with the depth.
        force: replace what was completed before.
        tell: wraps the loop over frames.

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
        for one in pairs(given, picture, tell=tell, label="complete"):
            started = time.perf_counter()
            found = complete(ready, one.image, one.depth_m, one.valid)
            spent.append(time.perf_counter() - started)
            cannot += not np.isfinite(found.depth_m).any()
            before.append(float(1 - one.valid.mean()))
            after.append(float(np.isnan(found.depth_m).mean()))
            _write(folder, one, found, picture, given.info.depth_unit_m, method)
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
    folder: Folder, one: Pair, found: Completed, picture: Picture, unit_m: float, method: str
) -> None:
    at = f"{one.scene}/{one.number}"
    folder.write(f"{at}/depth.png", png.encode(to_code(found.depth_m, unit_m)))
    if np.isfinite(found.sigma_m).any():
        folder.write(f"{at}/sigma.png", png.encode(to_code(found.sigma_m, unit_m)))
    encode = png.encode_colour if one.image.ndim == 3 else png.encode
    folder.write(f"{at}/{picture}.png", encode(one.image))
    folder.write(f"{at}/frame.json", record.dumps({"completed_by": method, "said": found.said}))
    folder.write(f"{one.scene}/room", one.room + "\n")
    if one.truth_m is not None:
        folder.write(f"{one.scene}/truth.png", png.encode(to_code(one.truth_m, unit_m)))
