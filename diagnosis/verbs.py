"""Verbs of the diagnosis (see `starling.sim.commands.verbs`)."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from starling.sim.console import shell
from starling.sim.console.flags import Common, Edits, Shared


def diagnose(
    captures: Positional[str],
    *,
    sensor: str,
    out: Path,
    against: str = "",
    cache: Path | None = None,
    families: tuple[str, ...] = (),
    leave_out: tuple[str, ...] = (),
    emitter: Literal["on", "off"] | None = None,
    edits: Edits = (),
    fix: bool = False,
    residual: bool = False,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Say where a simulation differs from real captures, what that is consistent with, and how far
    the gap closes.

    Example: starling diagnose captures/other-rooms --sensor my-d415.toml --out out/diagnosis --fix

    Args:
        captures: capture set with reference depth or known geometry, best with infrared pairs.
        sensor: preset (see `starling sensors`) or sensor file (.toml) that the captures' camera
            should be; with --against, the camera of those.
        out: folder for the report.
        against: capture set of the same scenes that is compared in place of simulated captures.
        cache: folder that keeps what is simulated, for other runs on the same scenes.
        families: of effects (see `starling effects`) that are tried; all where none is named.
        leave_out: families that are not tried.
        emitter: off diagnoses the pairs that were captured without the projector.
        fix: write sensor.toml with the accepted effects in.
        residual: train a network on what physics misses, to tell how much any explanation can close
            and how much of it the named effects take over; minutes.
        force: drop what starling left in the folder.
    """
    from starling.diagnosis import command as diagnosing
    from starling.sim.console import progress
    from starling.sim.sensor import resolve

    camera = resolve.load(sensor, captures=captures, emitter=emitter, edits=edits)
    with progress.on_stderr() as track:
        result = diagnosing.diagnose_captures(
            captures,
            camera,
            out,
            against=against,
            cache=cache,
            families=families,
            leave_out=leave_out,
            fix=fix,
            residual=residual,
            force=force,
            asked={"sensor": sensor, "emitter": emitter, "set": edits},
            track=track,
        )
    shell.say(result, json=common.json, as_text=diagnosing.as_text)


def withheld(
    *,
    out: Path,
    tier: Literal[1, 2, 3, 4] = 1,
    cases: int | None = None,
    no_infrared: bool = False,
    power: bool = False,
    sets: int | None = None,
    jobs: int = 2,
    blender: Path = Path(".blender/bin/python"),
    captures: Path | None = None,
    sensor: str | None = None,
    common: Shared = Common(),
) -> None:
    """Check the diagnosis: effects made by a second implementation, withheld from it, to be named.

    Example: starling withheld --tier 1 --out out/withheld

    A run that was stopped goes on where it was.

    Args:
        out: folder of the run, new or begun before.
        tier: 1: scenes by Starling's renderer; 2: by Blender's Cycles, with another matcher; 3:
            effects outside the table; 4: effects put into real infrared pairs.
        cases: with a single effect, the other cases in proportion; else the tier's own number.
        no_infrared: give the diagnosis depth alone (tiers 1 and 3).
        power: ask instead how strong six effects have to be; cases: of each of six levels.
        sets: of scenes, each with its share of the cases, that are asked and scored: the first
            so many, and more by a later call; else all.
        jobs: sets of scenes at once, a core each; tier 4 first finds its detection limits on all
            cores.
        blender: Python with bpy (see tools/blender.sh), for tier 2.
        captures: capture set of a real camera, of eight scenes or more, for tier 4.
        sensor: preset or sensor file of that camera, for tier 4.
    """
    import subprocess
    import sys

    flags = [
        *(["--cases", str(cases)] if cases is not None else []),
        *(["--no-infrared"] if no_infrared else []),
        *(["--power"] if power else []),
        *(["--sets", str(sets)] if sets is not None else []),
        *(["--captures", str(captures)] if captures is not None else []),
        *(["--sensor", sensor] if sensor is not None else []),
        *(["--json"] if common.json else []),
        *(["--debug"] if common.debug else []),
    ]
    # A process of its own: what it knows of its cases, the diagnosis must not.
    command = [sys.executable, "-m", "starling.diagnosis.validation", str(out), "--tier", str(tier)]
    places = ["--jobs", str(jobs), "--blender", str(blender)]
    done = subprocess.run([*command, *places, *flags], check=False)
    if done.returncode:
        sys.exit(done.returncode)


VERBS = (diagnose, withheld)
