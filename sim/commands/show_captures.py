"""`starling show`: draw every scene of a capture set, or of two sets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.captures import capture
from starling.sim.commands.compare import pair_scenes
from starling.sim.console import output, progress, record
from starling.sim.plotting import capture_picture

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
        output.write_file(out, capture_picture.picture(scene, frame, against=partner), force=force)
        return {"out": str(out), "files": 1}
    with output.OutputFolder(out, force=force) as folder:
        for scene, partner in track(pairs, "show"):
            folder.write(
                f"{scene.name}.png", capture_picture.picture(scene, frame, against=partner)
            )
        folder.write(
            output.RECORD,
            record.dumps(
                {
                    "verb": "show",
                    "arguments": {"captures": captures, "against": against, "frame": frame},
                    "versions": record.versions(),
                }
            ),
        )
    return {"out": str(folder.path), "files": len(pairs) + 1}
