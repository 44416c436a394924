"""Verbs of calibration (see `starling.sim.commands.verbs`)."""

from __future__ import annotations

from pathlib import Path

from tyro.conf import Positional

from starling.sim.console import shell
from starling.sim.console.flags import Common, Edits, Shared


def calibrate(
    captures: Positional[str],
    *,
    sensor: str,
    out: Path,
    free: tuple[str, ...],
    heldout: tuple[str, ...] | None = None,
    edits: Edits = (),
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Fit a sensor to captures of known surfaces; writes a sensor file and a report beside it.

    Example: starling calibrate out/mine --sensor d415 --free pattern --out out/my-d415.toml

    Args:
        captures: capture set or one scene in it, with infrared, or with depth alone.
        sensor: preset (see `starling sensors`) or sensor file (.toml) to start from.
        out: sensor file to write, NAME.toml; NAME/ holds pattern, dots, report.html, report.json.
        free: groups to fit, separated by commas: baseline, alignment, focal, centre, projector,
            field, scale, dots, pattern, photometry, noise, warp; of depth alone: baseline, offset,
            noise, thresholds.
        heldout: rooms to keep out of the fit and score it on; every fourth where none is named.
        force: replace what was written before.
    """
    from starling.calibration import calibrate_captures
    from starling.sim.console import progress
    from starling.sim.sensor import resolve

    camera = resolve.load(sensor, captures=captures, edits=edits)
    with progress.on_stderr() as track:
        result = calibrate_captures.calibrate_captures(
            captures,
            camera,
            out,
            free=[group for word in free for group in word.split(",") if group],
            heldout=heldout,
            force=force,
            asked={"sensor": sensor, "set": edits},
            track=track,
        )
    shell.say(result, json=common.json)


VERBS = (calibrate,)
