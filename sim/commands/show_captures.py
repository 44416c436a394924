"""`starling show`: draw every scene of a capture set, or of two sets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures import capture, frame_reason
from starling.sim.captures.capture import CapturedScene, Frame
from starling.sim.commands.compare import pair_scenes
from starling.sim.console import output, progress, record
from starling.sim.plotting import panels, sheet
from starling.sim.plotting.sheet import Panel

_OTHER_PICTURES = (
    *(".jpg", ".jpeg", ".jpe", ".jp2", ".gif", ".bmp", ".tif", ".tiff", ".webp", ".avif"),
    *(".heic", ".svg", ".pdf", ".eps", ".ps", ".exr", ".hdr", ".pgm", ".ppm", ".pnm"),
)


def show_captures(
    captures: str,
    out: Path,
    *,
    against: str | None = None,
    frame: int = 0,
    force: bool = False,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Draw one scene into a PNG file, or several scenes into a folder of PNG files.

    Args:
        captures: a capture set or one scene in it.
        out: `NAME.png` for one scene, a folder for several.
        against: second set, usually simulated, drawn next to the first scene by scene.
        frame: number of the frame.
        force: replace earlier pictures.
        track: wraps the loop over scenes.

    Returns:
        `{"out", "files"}`.

    Raises:
        InputError: if captures cannot be read, or the sets have no scene in common. Also if the
            output path cannot be written, lies in the captures or is no PNG.
    """
    if out.suffix.lower() in _OTHER_PICTURES:  # It would become a folder of that name.
        raise errors.refuse(
            "out", "must be NAME.png or a folder", out, "Pictures are written as PNG."
        )
    first = capture.open_set(captures)
    output.refuse_own_input(out, first.path)
    if against is None:
        pairs = [(scene, None) for scene in first.scenes]
    else:
        second = capture.open_set(against)
        output.refuse_own_input(out, second.path)
        pairs = list(pair_scenes(first, second))
    if out.suffix.lower() == ".png":
        if len(pairs) > 1:
            raise errors.refuse(
                "out", f"must be a folder for {len(pairs)} scenes", out, "Or name one scene."
            )
        scene, partner = pairs[0]
        output.write_file(out, draw_picture(scene, frame, against=partner), force=force)
        return {"out": str(out), "files": 1}
    with output.OutputFolder(out, force=force) as folder:
        for scene, partner in track(pairs, "show"):
            folder.write(f"{scene.name}.png", draw_picture(scene, frame, against=partner))
        arguments = {"captures": captures, "against": against, "frame": frame}
        folder.write(output.RECORD, record.of_run("show", arguments))
    return {"out": str(folder.path), "files": len(pairs) + 1}


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _FramePanels:
    """Content of the panels of one frame, each image (h, w)."""

    heading: str
    frame: Frame
    truth_m: NDArray[np.float32] | None
    reason: NDArray[np.uint32] | None
    error_px: NDArray[np.float32] | None


def draw_picture(
    scene: CapturedScene, frame: int = 0, *, against: CapturedScene | None = None
) -> bytes:
    """Draw one frame, or frames of two scenes side by side.

    Args:
        scene: Captured scene.
        frame: Number of the frame.
        against: Second scene, such as a simulation, drawn on the right on the same depth scale.

    Returns:
        Bytes of a PNG file.

    Raises:
        InputError: if a scene cannot be read or the two differ in size.
    """
    if against is None:
        return sheet.draw(_single_layout(_view(scene, frame)), scene.info.shape)
    if scene.info.shape != against.info.shape:
        raise errors.refuse(
            "the two captures",
            "must have one image size",
            f"{scene.info.shape} and {against.info.shape}",
            "Show them one by one.",
        )
    return sheet.draw(_pair_layout(_view(scene, frame), _view(against, frame)), scene.info.shape)


def _view(scene: CapturedScene, number: int) -> _FramePanels:
    frame, truth_m = scene.frame(number), scene.truth_m()
    error_px = None
    if frame.depth_m is not None and truth_m is not None:
        measured, true = (scene.info.disparity_px(z) for z in (frame.depth_m, truth_m))
        error_px = measured - true
    return _FramePanels(
        heading=f"{scene.path.parent.name}/{scene.name}/{number}",
        frame=frame,
        truth_m=truth_m,
        reason=frame_reason.read(scene, frame),
        error_px=error_px,
    )


def _single_layout(view: _FramePanels) -> list[list[Panel]]:
    """Arrange the panels of one frame in rows of two."""
    limits = panels.depth_limits(view.frame.depth_m, view.truth_m)
    drawn = [
        *_infrared(view, "left"),
        *_infrared(view, "right"),
        *_depth(view, limits),
        *_truth(view, limits),
        *_reasons(view),
        *_error(view),
    ]
    return [drawn[start : start + 2] for start in range(0, len(drawn), 2)]


def _pair_layout(left: _FramePanels, right: _FramePanels) -> list[list[Panel]]:
    """Arrange two frames in columns, with rows for the panels that both have."""
    limits = panels.depth_limits(left.frame.depth_m, right.frame.depth_m)
    columns = [
        (_infrared(view, "left"), _depth(view, limits), _reasons(view), _error(view))
        for view in (left, right)
    ]
    rows = [a + b for a, b in zip(*columns, strict=True) if a and b]
    if not rows:
        raise errors.refuse(
            "the two captures",
            "must have an image in common",
            left.heading,
            "Show them one by one.",
        )
    return rows


def _infrared(view: _FramePanels, side: str) -> list[Panel]:
    image = view.frame.ir_left if side == "left" else view.frame.ir_right
    if image is None or view.frame.ir_left is None:
        return []
    limits = panels.infrared_limits(view.frame.ir_left)
    title = f"{view.heading}: infrared {side}"
    return [Panel(draw=partial(panels.infrared, image=image, limits=limits, title=title))]


def _depth(view: _FramePanels, limits: tuple[float, float]) -> list[Panel]:
    if view.frame.depth_m is None:
        return []
    title = f"{view.heading}: depth"
    draw = partial(panels.depth, depth_m=view.frame.depth_m, limits=limits, title=title)
    return [Panel(draw=draw, below_in=panels.BAR_IN)]


def _truth(view: _FramePanels, limits: tuple[float, float]) -> list[Panel]:
    if view.truth_m is None:
        return []
    draw = partial(panels.depth, depth_m=view.truth_m, limits=limits, title="truth")
    return [Panel(draw=draw, below_in=panels.BAR_IN)]


def _reasons(view: _FramePanels) -> list[Panel]:
    if view.reason is None:
        return []
    draw = partial(panels.reasons, reason=view.reason, title="why depth is missing")
    return [Panel(draw=draw, below_in=panels.legend_in(view.reason))]


def _error(view: _FramePanels) -> list[Panel]:
    if view.error_px is None:
        return []
    draw = partial(panels.error, error_px=view.error_px, title="error against truth")
    return [Panel(draw=draw, below_in=panels.BAR_IN)]
