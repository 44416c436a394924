"""Validate the diagnosis on cases whose true effects it does not know.

    python -m starling.diagnosis.validation OUT [--tier 1] [--cases N] [--sets N] [--power]
    python -m starling.diagnosis.validation OUT --tier 4 --captures SET --sensor FILE
    python -m starling.diagnosis.validation OUT --tier 5 [--imperfect all]

OUT holds all files, so an interrupted run can continue. The program prints the scores as a table,
or as JSON with --json.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from starling.diagnosis.validation.camera.errors import WithheldError, refusal
from starling.diagnosis.validation.protocol import plan, score_table, seal
from starling.diagnosis.validation.protocol.check import Check
from starling.diagnosis.validation.protocol.tier import TIERS

INTERRUPTED = 130  # Exit code after SIGINT: 128 and its number.


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line. The exit code is 1 if an input is invalid, 130 after an interrupt."""
    parser = argparse.ArgumentParser(
        prog="python -m starling.diagnosis.validation", description=__doc__
    )
    flag = parser.add_argument
    flag("out", type=Path, help="folder of the run, new or of an interrupted run")
    tiers = "source of the captures: 1, 3, 5 Starling, 2 Cycles, 4 real pairs; 5 imperfect base"
    flag("--tier", type=int, choices=sorted(TIERS), default=1, help=tiers)
    cases = "number of single-effect cases; with --power, cases per effect and level"
    flag("--cases", type=int, help=cases)
    flag("--no-infrared", action="store_true", help="diagnose depth alone")
    flag("--power", action="store_true", help="measure power curves")
    flag("--sets", type=int, help="number of scene sets; default: all")
    flag("--jobs", type=int, default=2, help="number of parallel scene sets")
    blender = Path(".blender/bin/python")
    flag("--blender", type=Path, default=blender, help="Python interpreter with bpy, for tier 2")
    flag("--captures", type=Path, help="real capture set, for tier 4")
    flag("--sensor", help="preset or sensor file of the real camera, for tier 4")
    flag("--mode", default="", help="mode of that camera, WxH or WxH@FPS, for tier 4")
    imperfect = "imperfections of the base, for tier 5: all at once, each in turn, or a single one"
    flag("--imperfect", choices=plan.PLANS, help=f"{imperfect}; default: all")
    estimated = "estimate the scenes from captures and reference depth, for tier 5"
    flag("--estimated", action="store_true", help=estimated)
    flag("--effects", default="", help="effects of the singles, by comma; default: all")
    flag("--json", action="store_true", help="print the scores as JSON")
    flag("--debug", action="store_true", help="show the traceback of an error")
    options = parser.parse_args(arguments)
    started = time.perf_counter()
    try:
        check = Check(
            out=options.out,
            tier=TIERS[options.tier],
            blender=options.blender,
            captures=options.captures,
            sensor=options.sensor,
            mode=options.mode,
            infrared=not options.no_infrared,
            power=options.power,
            jobs=options.jobs,
            set_limit=options.sets,
            singles=options.cases,
            imperfect=options.imperfect,
            estimated=options.estimated,
            effects=tuple(filter(None, options.effects.split(","))),
        )
        sealed = check.prepare()
        print((check.folder / seal.SEAL).read_text(encoding="ascii").strip(), file=sys.stderr)
        check.diagnose(sealed)
        scores = check.score(sealed)
    except KeyboardInterrupt:
        return INTERRUPTED
    except Exception as error:
        if options.debug:
            raise
        print(_message(error), file=sys.stderr)
        return 1
    scores["wall_seconds"] = round(time.perf_counter() - started, 1)
    (check.folder / "scores.json").write_text(json.dumps(scores, indent=1), encoding="utf-8")
    table = score_table.power(scores["power"]) if options.power else score_table.text(scores)
    conditions = {key: scores[key] for key in ("opened", "code_as_sealed", "sets")}
    print(json.dumps(scores) if options.json else f"{table}\n{score_table.opening(**conditions)}")
    return 0


def _message(error: Exception) -> str:
    """Format an error as one line for standard error."""
    text = " ".join(str(error).split())
    if isinstance(error, WithheldError):
        return text
    if isinstance(error, OSError):
        return str(refusal("files", "must be readable and writable", text, "Check the paths."))
    return f"{type(error).__name__}: {text}. Run again with --debug and report the output."


if __name__ == "__main__":
    sys.exit(main())
