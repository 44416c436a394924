"""Command-line verbs of calibration (see `starling.sim.commands.verbs`)."""

from __future__ import annotations

from pathlib import Path

from tyro.conf import Positional

from starling.calibration import MOST_SCENES
from starling.sim.console import shell
from starling.sim.console.flags import Common, Edits, ModeName, Shared


def calibrate(
    captures: Positional[str],
    *,
    sensor: str,
    mode: ModeName = "",
    out: Path,
    free: tuple[str, ...],
    heldout: tuple[str, ...] | None = None,
    most_scenes: int = MOST_SCENES,
    edits: Edits = (),
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Fit a sensor model to captures of known surfaces; write a sensor file and a report.

    Example: starling calibrate out/mine --sensor d415 --free pattern --out out/my-d415.toml

    Args:
        captures: capture set or one of its scenes, with infrared images or with depth only.
        sensor: preset (see `starling sensors`) or sensor file (.toml) to start from.
        out: sensor file to write, NAME.toml. The folder NAME/ gets the pattern, the dots,
            report.html and report.json.
        free: parameter groups to fit, separated by commas: baseline, alignment, focal, centre,
            projector, field, scale, dots, pattern, photometry, noise, warp. Captures with depth
            only support baseline, offset, noise, thresholds.
        heldout: rooms to exclude from the fit and to score it on. Default: every fourth room.
        most_scenes: largest number of scenes to fit, and of held-out scenes to score.
        force: overwrite existing output.
    """
    from starling.calibration import calibrate_captures
    from starling.sim.console import progress
    from starling.sim.sensor import resolve

    camera = resolve.load(
        sensor, mode=mode, captures=captures, edits=edits, note=progress.note_on_stderr
    )
    with progress.on_stderr() as track:
        result = calibrate_captures.calibrate_captures(
            captures,
            camera,
            out,
            free=[group for word in free for group in word.split(",") if group],
            heldout=heldout,
            most_scenes=most_scenes,
            force=force,
            options={"sensor": sensor, "mode": mode, "set": edits},
            track=track,
        )
    shell.say(result, json=common.json)
