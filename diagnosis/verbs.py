"""Verbs of the diagnosis (see `sim.verbs`)."""

from __future__ import annotations

from pathlib import Path

from tyro.conf import Positional

from sim import shell
from sim.flags import Common, Edits, Shared


def diagnose(
    captures: Positional[str],
    *,
    sensor: str,
    out: Path,
    cache: Path | None = None,
    families: tuple[str, ...] = (),
    leave_out: tuple[str, ...] = (),
    edits: Edits = (),
    fix: bool = False,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Say where a simulation differs from real captures, which effect it is, and how far it closes.

    Example: starling diagnose captures/d415-faro --sensor my-d415.toml --out out/diagnosis --fix

    Args:
        captures: capture set with reference depth or known geometry, best with infrared pairs.
        sensor: preset (see `starling sensors`) or sensor file (.toml) that the captures' camera
            should be.
        out: folder for the report.
        cache: folder that keeps what is simulated, for other runs on the same scenes.
        families: of effects (see `starling effects`) that are tried; all where none is named.
        leave_out: families that are not tried.
        fix: write sensor.toml with the accepted effects in.
        force: drop what starling left in the folder.
    """
    from diagnosis import diagnose_captures as diagnosing
    from sim import asked_sensor, progress

    camera = asked_sensor.load(sensor, captures=captures, edits=edits)
    with progress.on_stderr() as tell:
        result = diagnosing.diagnose_captures(
            captures,
            camera,
            out,
            cache=cache,
            families=families,
            leave_out=leave_out,
            fix=fix,
            force=force,
            asked={"sensor": sensor, "set": edits},
            tell=tell,
        )
    shell.say(result, json=common.json, as_text=diagnosing.as_text)


VERBS = (diagnose,)
