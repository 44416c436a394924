"""The work of `starling diagnose`: captures and a sensor in, a report out."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from starling.diagnosis.diagnosis import Diagnosis, diagnose
from starling.diagnosis.report import figures as numbers
from starling.diagnosis.report.page import page
from starling.diagnosis.validation.adapters import families as table
from starling.patterns.errors import refuse
from starling.sim.captures import capture
from starling.sim.console import progress, record
from starling.sim.console.output import RECORD, OutputFolder, refuse_own_input
from starling.sim.effects import setting as setting
from starling.sim.render import backend
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

BASE = "base.toml"
FIXED = "sensor.toml"
PAGE = "report.html"


def diagnose_captures(
    captures: str,
    sensor: Sensor,
    out: Path,
    *,
    against: str = "",
    cache: Path | None = None,
    families: Sequence[str] = (),
    leave_out: Sequence[str] = (),
    fix: bool = False,
    residual: bool = False,
    force: bool = False,
    asked: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Diagnose a capture set and write the report.

    Args:
        captures: capture set or one scene in it.
        sensor: the base, with the captures' geometry.
        out: folder for report.html, report.json, the base as base.toml and how they were made;
            all seeds are fixed.
        against: capture set that is compared in place of simulated captures; none if empty.
        cache: folder that keeps what is simulated, for other runs.
        families: of effects that are tried; all if none.
        leave_out: families that are not.
        fix: write the sensor with the accepted effects in; none where they exclude each other, or
            are all of the scene.
        residual: learn what physics misses, and tell how far that reaches.
        force: replace what was written before.
        asked: more arguments for the record.
        track: wraps loops that take long.

    Returns:
        The figures (see `starling.diagnosis.report.figures`), and where the report is.

    Raises:
        InputError: whatever is wrong with captures or output; nothing is left.
    """
    begun = time.perf_counter()
    opened = capture.open_set(captures)
    refuse_own_input(out, opened.path)
    other = capture.open_set(against) if against else None
    if other is not None:
        refuse_own_input(out, other.path)
    with OutputFolder(out, force=force) as folder:
        found = diagnose(
            opened,
            sensor,
            against=other,
            cache=cache,
            families=_tried(families, leave_out),
            residual=residual,
            track=track,
        )
        figures = numbers.figures(found)
        folder.write("report.json", record.dumps(figures))
        folder.write(PAGE, page(found))
        folder.write(BASE, presets.dumps(sensor))
        better = fixed(found, sensor)
        fixable = fix and better != sensor
        if fixable:
            folder.write(FIXED, presets.dumps(better))
        folder.write(
            RECORD,
            record.dumps(
                {
                    "verb": "diagnose",
                    "arguments": {
                        "captures": captures,
                        "against": against,
                        "families": list(families),
                        "leave_out": list(leave_out),
                        "fix": fix,
                        "residual": residual,
                        **(asked or {}),
                    },
                    "versions": record.versions(),
                    "renderer": backend.renderer(),
                    "figures": {"verdict": figures["verdict"], "effects": figures["effects"]},
                }
            ),
        )
    return {
        **figures,
        "out": str(out),
        "report": str(out / PAGE),
        "fixed": str(out / FIXED) if fixable else None,
        "not_in_sensor": _of_scenes(found),
        "seconds": round(time.perf_counter() - begun, 3),
    }


def _tried(families: Sequence[str], leave_out: Sequence[str]) -> list[str] | None:
    """Families that are asked for and not left out; None where that is all of them."""
    table.refuse_others(leave_out)
    if not families and not leave_out:
        return None
    tried = [family for family in families or table.known() if family not in leave_out]
    if not tried:
        rule = "must leave a family to try"
        raise refuse("leave-out", rule, " ".join(leave_out), "Leave out fewer.")
    return tried


def fixed(found: Diagnosis, sensor: Sensor) -> Sensor:
    """The sensor with the accepted effects in, as it was where they exclude each other; what the
    scene has stays out.
    """
    return setting.on_sensor(sensor, found.settings) if found.together else sensor


def _of_scenes(found: Diagnosis) -> list[str]:
    """Accepted effects that no sensor file has, as they are the scene's."""
    return [name for name in found.settings if found.together and setting.is_scenes(name)]


def as_text(told: Mapping[str, Any]) -> str:
    """Say what `diagnose_captures` returned: the answer, and where the report is."""
    lines = [*told["says"], f"Report: {told['report']}"]
    if told["fixed"] is not None:
        standing_in = any(one["stand_in"] for one in told["effects"])
        lines.append(f"Sensor: {told['fixed']}" + (", with stand-ins in it" if standing_in else ""))
    if told["not_in_sensor"]:
        lines.append(f"Of the scene, not of a sensor: {', '.join(told['not_in_sensor'])}")
    return "\n".join(lines)
