"""The front door: `starling VERB`. The verbs stand beside what they call, package by package.

Exit codes: 0 done, 1 refused (one line on standard error), 2 bad flags.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence

import tyro
from tyro.conf import FlagCreatePairsOff, PositionalMetavarFromFieldName

from starling.calibration import verbs as calibration_verbs
from starling.diagnosis import verbs as diagnosis_verbs
from starling.learning.commands import completion_verbs
from starling.learning.commands import verbs as learning_verbs
from starling.sim.commands import data_verbs
from starling.sim.commands import verbs as sim_verbs
from starling.sim.console import shell

_app = tyro.extras.SubcommandApp()
for _verb in (
    *sim_verbs.VERBS,
    *data_verbs.VERBS,
    *calibration_verbs.VERBS,
    *learning_verbs.VERBS,
    *completion_verbs.VERBS,
    *diagnosis_verbs.VERBS,
):
    _app.command(_verb)

_OF_TWO_WORDS = {("train", "completion"), ("evaluate", "completion")}  # Each a verb of its own.


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if tuple(arguments[:2]) in _OF_TWO_WORDS:
        arguments[:2] = ["-".join(arguments[:2])]
    try:
        with shell.termination_as_exit(), warnings.catch_warnings():
            warnings.showwarning = shell.warn
            _app.cli(
                args=arguments,
                prog="starling",
                description=_DESCRIPTION,
                config=(FlagCreatePairsOff, PositionalMetavarFromFieldName),
            )
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except KeyboardInterrupt:
        print("interrupted; nothing half-written is left", file=sys.stderr)
        return 130
    except BrokenPipeError:  # The reader of our output has gone (`starling sensors | head -1`).
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - until the process ends
        return 0
    except Exception as error:
        if "--debug" in arguments:
            raise
        print(shell.line_of(error), file=sys.stderr)
        return 1
    return 0


_DESCRIPTION = """Starling simulates active-stereo depth cameras from the light up.

Example: starling simulate tabletop --sensor d435 --out out/tabletop"""
