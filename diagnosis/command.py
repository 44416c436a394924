"""Implementation of `starling diagnose`: diagnose captures and write the report."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from starling.diagnosis.diagnosis import Diagnosis, diagnose
from starling.diagnosis.report import figures as numbers
from starling.diagnosis.report.page import page
from starling.diagnosis.report.sentences import FIX
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
    options: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
    note: progress.Note | None = None,
) -> dict[str, Any]:
    """Diagnose a capture set and write the report.

    Args:
        captures: capture set or one scene in it.
        sensor: the base, with the captures' geometry.
        out: folder for report.html, report.json, base.toml and the record of the run.
        against: capture set that is compared instead of simulated captures; none if empty.
        cache: folder that caches simulations for other runs.
        families: effect families to try; empty means all.
        leave_out: effect families not to try.
        fix: write the sensor with the accepted effects. It is not written if the effects exclude
            each other, or if all of them belong to the scene.
        residual: learn what physics misses, and report how much of the gap that closes.
        force: replace the output of an earlier run.
        options: further command-line options to record, as typed.
        track: wraps long loops to report progress.
        note: takes the sentences that are known before effects are tried.

    Returns:
        The figures (see `starling.diagnosis.report.figures`), and the paths of the written files.

    Raises:
        InputError: if captures or output are refused; then no output is left.
    """
    started = time.perf_counter()
    opened = capture.open_set(captures)
    refuse_own_input(out, opened.path)
    reference = capture.open_set(against) if against else None
    if reference is not None:
        refuse_own_input(out, reference.path)
    with OutputFolder(out, force=force) as folder:
        diagnosis = diagnose(
            opened,
            sensor,
            against=reference,
            cache=cache,
            families=_tried(families, leave_out),
            residual=residual,
            track=track,
            note=note,
        )
        figures = numbers.figures(diagnosis)
        folder.write("report.json", record.dumps(figures))
        folder.write(PAGE, page(diagnosis))
        folder.write(BASE, presets.dumps(sensor))
        better = fixed(diagnosis, sensor)
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
                        **(options or {}),
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
        "not_in_sensor": _scene_effects(diagnosis),
        "seconds": round(time.perf_counter() - started, 3),
    }


def _tried(families: Sequence[str], leave_out: Sequence[str]) -> list[str] | None:
    """Return the requested families without those left out; None if that is all of them."""
    table.refuse_unknown_families(leave_out)
    if not families and not leave_out:
        return None
    tried = [family for family in families or table.known() if family not in leave_out]
    if not tried:
        rule = "must leave at least one family to try"
        raise refuse("leave-out", rule, " ".join(leave_out), "Leave out fewer.")
    return tried


def fixed(diagnosis: Diagnosis, sensor: Sensor) -> Sensor:
    """Return the sensor with the reported effects applied, except effects of the scene.

    If the reported effects exclude each other, the sensor is returned unchanged.
    """
    return setting.on_sensor(sensor, diagnosis.settings) if diagnosis.compatible else sensor


def _scene_effects(diagnosis: Diagnosis) -> list[str]:
    """List reported effects that belong to the scene, so that no sensor file can hold them."""
    return [
        name
        for name in diagnosis.settings
        if diagnosis.compatible and setting.acts_on_scene_only(name)
    ]


def as_text(result: Mapping[str, Any]) -> str:
    """Write the result of `diagnose_captures` as text: the answer, and the paths."""
    step = result["next"]
    if result["fixed"] is not None and step == FIX:
        step = "Run this diagnosis again with the sensor file below."
    lines = [*result["says"], *result["notes"], f"Next: {step}"]
    lines.append(f"Report: {result['report']}")
    if result["fixed"] is not None:
        lines.append(f"Sensor: {result['fixed']}")
    if result["not_in_sensor"]:
        names = ", ".join(result["not_in_sensor"])
        lines.append(f"Effects of the scene, not written to a sensor file: {names}")
    return "\n".join(lines)
