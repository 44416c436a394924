"""Command-line verbs of the diagnosis (see `starling.sim.commands.verbs`)."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from starling.sim.console import shell
from starling.sim.console.flags import Common, Edits, ModeName, Shared

Imperfect = Literal[
    "all",
    "each",
    "occluded_sky",
    "disc_spot",
    "tailed_spot",
    "texture",
    "exposure",
    "other_matcher",
]


def diagnose(
    captures: Positional[str],
    *,
    sensor: str,
    mode: ModeName = "",
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
    """Find where simulation differs from real captures, and which effects explain the gap.

    Example: starling diagnose captures/other-rooms --sensor my-d415.toml --out out/diagnosis --fix

    Args:
        captures: capture set with reference depth or known geometry. Infrared pairs improve the
            diagnosis.
        sensor: preset (see `starling sensors`) or sensor file (.toml) of the captures' camera;
            with --against, of the other capture set's camera.
        out: folder for the report.
        against: capture set of the same scenes to compare with instead of simulated captures.
        cache: folder that caches simulations for other runs on the same scenes.
        families: effect families to try (see `starling effects`); default: all.
        leave_out: effect families not to try.
        emitter: off: diagnose the pairs captured without the projector.
        fix: write sensor.toml, the sensor with the accepted effects.
        residual: train a network on holes that physics misses. The report then shows how much any
            model could close, and how much of that the accepted effects absorb. Takes minutes.
        force: replace the output of an earlier run.
    """
    from starling.diagnosis import command as diagnosing
    from starling.sim.console import progress
    from starling.sim.sensor import resolve

    camera = resolve.load(
        sensor,
        mode=mode,
        captures=captures,
        emitter=emitter,
        edits=edits,
        note=progress.note_on_stderr,
    )
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
            options={"sensor": sensor, "mode": mode, "emitter": emitter, "set": edits},
            track=track,
            note=progress.note_on_stderr,
        )
    shell.say(result, json=common.json, as_text=diagnosing.as_text)


def withheld(
    *,
    out: Path,
    tier: Literal[1, 2, 3, 4, 5] = 1,
    cases: int | None = None,
    no_infrared: bool = False,
    power: bool = False,
    sets: int | None = None,
    jobs: int = 2,
    blender: Path = Path(".blender/bin/python"),
    captures: Path | None = None,
    sensor: str | None = None,
    mode: ModeName = "",
    imperfect: Imperfect | None = None,
    estimated: bool = False,
    effects: str = "",
    common: Shared = Common(),
) -> None:
    """Validate the diagnosis on effects that are withheld from it.

    A second implementation of the camera applies the effects; the diagnosis has to identify them.

    Example: starling withheld --tier 1 --out out/withheld

    A stopped run continues where it stopped.

    Args:
        out: folder of a new or earlier run.
        tier: 1: scenes by Starling's renderer; 2: scenes by Blender's Cycles, and another matcher;
            3: effects outside the effect table; 4: effects applied to real infrared pairs;
            5: captures of a world that the base does not describe completely.
        cases: number of cases with a single effect; other kinds follow in proportion. Default: the
            number of the tier.
        no_infrared: give the diagnosis depth only (tiers 1 and 3).
        power: measure instead how strong six effects must be to be detected; --cases is then the
            number of cases at each of six strengths.
        sets: number of scene sets to run and score, from the first on; a later call can add more.
            Default: all.
        jobs: scene sets run in parallel, one core each; tier 4 first computes its detection limits
            on all cores.
        blender: Python with bpy, for tier 2 (see tools/blender.sh).
        captures: capture set of a real camera with at least eight scenes, for tier 4.
        sensor: preset or sensor file of that camera, for tier 4.
        imperfect: what the base of tier 5 lacks: all at once, each in turn, or a single one.
            These are occluded ambient light, a lens spot of another shape, texture of surfaces,
            exposure by scene, and the matcher of the device. Default: all.
        estimated: give tier 5 reference depth in place of described scenes. Reflectance and light
            are then estimated for each case, which takes minutes.
        effects: effects of the singles, separated by commas; there are then no pairs and no unknown
            effects. Default: all effects of the tier.
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
        *(["--mode", mode] if mode else []),
        *(["--imperfect", imperfect] if imperfect is not None else []),
        *(["--estimated"] if estimated else []),
        *(["--effects", effects] if effects else []),
        *(["--json"] if common.json else []),
        *(["--debug"] if common.debug else []),
    ]
    # A separate process keeps its knowledge of the cases from the diagnosis.
    command = [sys.executable, "-m", "starling.diagnosis.validation", str(out), "--tier", str(tier)]
    tools = ["--jobs", str(jobs), "--blender", str(blender)]
    finished = subprocess.run([*command, *tools, *flags], check=False)
    if finished.returncode:
        sys.exit(finished.returncode)
