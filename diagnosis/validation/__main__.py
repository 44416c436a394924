"""Check what the diagnosis finds of effects that are withheld from it.

    python -m starling.diagnosis.validation OUT [--tier 1] [--cases N] [--sets N] [--no-infrared] [--power]
    python -m starling.diagnosis.validation OUT --tier 4 --captures SET --sensor FILE [--cases N]

Everything is kept in OUT: a run that was stopped goes on where it was. The last line that is
printed is the scores as JSON where asked for, else a table.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from starling.diagnosis.validation.camera.errors import WithheldError, refusal
from starling.diagnosis.validation.protocol import score_table, seal
from starling.diagnosis.validation.protocol.check import Check
from starling.diagnosis.validation.protocol.tier import TIERS


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 1 where something is refused."""
    parser = argparse.ArgumentParser(
        prog="python -m starling.diagnosis.validation", description=__doc__
    )
    parser.add_argument("out", type=Path, help="folder of the run, new or begun before")
    parser.add_argument("--tier", type=int, choices=sorted(TIERS), default=1)
    parser.add_argument("--cases", type=int, help="singles, or of a level of power")
    parser.add_argument("--no-infrared", action="store_true", help="captures of depth alone")
    parser.add_argument("--power", action="store_true", help="how strong effects have to be")
    parser.add_argument("--sets", type=int, help="how many sets of scenes are asked; else all")
    parser.add_argument("--jobs", type=int, default=2, help="sets of scenes at once")
    parser.add_argument("--blender", type=Path, default=Path(".blender/bin/python"))
    parser.add_argument("--captures", type=Path, help="real capture set, for tier 4")
    parser.add_argument("--sensor", help="preset or sensor file of its camera, for tier 4")
    parser.add_argument("--json", action="store_true", help="print the scores as JSON")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    asked = parser.parse_args(arguments)
    begun = time.perf_counter()
    try:
        check = Check(
            out=asked.out,
            tier=TIERS[asked.tier],
            blender=asked.blender,
            captures=asked.captures,
            sensor=asked.sensor,
            infrared=not asked.no_infrared,
            power=asked.power,
            jobs=asked.jobs,
            count=asked.sets,
        )
        cases = check.prepared(asked.cases)
        print((check.place / seal.SEAL).read_text(encoding="ascii").strip(), file=sys.stderr)
        check.diagnosed(cases, asked.cases)
        scores = check.scored(cases, asked.cases)
    except Exception as error:
        if asked.debug:
            raise
        print(_line_of(error), file=sys.stderr)
        return 1
    scores["wall_seconds"] = round(time.perf_counter() - begun, 1)
    (check.place / "scores.json").write_text(json.dumps(scores, indent=1), encoding="utf-8")
    table = score_table.power(scores["power"]) if asked.power else score_table.text(scores)
    rest = {key: scores[key] for key in ("opened", "code_as_sealed", "sets")}
    print(json.dumps(scores) if asked.json else f"{table}\n{score_table.opening(**rest)}")
    return 0


def _line_of(error: Exception) -> str:
    """One line for standard error."""
    said = " ".join(str(error).split())
    if isinstance(error, WithheldError):
        return said
    if isinstance(error, OSError):
        return str(refusal("files", "must be there to be read and written", said, "See to that."))
    return f"{type(error).__name__}: {said}. Run again with --debug and report what it prints."


if __name__ == "__main__":
    sys.exit(main())
