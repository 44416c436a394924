"""The command line: `starling VERB`. Each package keeps its verbs; this module finds and runs them.

Exit codes: 0 done, 1 refused (one line on standard error), 2 bad flags, 129, 130 and 143 stopped by
a signal. Imports that take time stand in functions, as an interrupt of them is to be caught too.
"""

from __future__ import annotations

import difflib
import keyword
import os
import sys
import typing
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from importlib import import_module
from itertools import pairwise

# By group of the help: each verb and the module whose function of the same name it calls.
GROUPS: dict[str, dict[str, str]] = {
    "Simulate": {
        "simulate": "starling.sim.commands.verbs",
        "generate": "starling.sim.commands.data_verbs",
        "verify": "starling.sim.commands.data_verbs",
        "sweep": "starling.sim.commands.verbs",
    },
    "Captures": {
        "show": "starling.sim.commands.data_verbs",
        "match": "starling.sim.commands.verbs",
        "compare": "starling.learning.commands.verbs",
        "fuse": "starling.sim.commands.data_verbs",
        "import": "starling.sim.commands.recording_verbs",
        "export": "starling.sim.commands.data_verbs",
    },
    "Calibrate": {
        "calibrate": "starling.calibration.verbs",
    },
    "Learn": {
        "train": "starling.learning.commands.verbs",
        "evaluate": "starling.learning.commands.verbs",
        "complete": "starling.learning.commands.completion_verbs",
        "train completion": "starling.learning.commands.completion_verbs",
        "evaluate completion": "starling.learning.commands.completion_verbs",
    },
    "Diagnose": {
        "diagnose": "starling.diagnosis.verbs",
        "withheld": "starling.diagnosis.verbs",
    },
    "Tools": {
        "sensors": "starling.sim.commands.sensor_verbs",
        "sensors check": "starling.sim.commands.check_sensors.verbs",
        "effects": "starling.sim.commands.verbs",
        "atlas": "starling.sim.commands.verbs",
        "bench": "starling.sim.commands.verbs",
        "doctor": "starling.sim.commands.verbs",
    },
}
VERBS = {name: module for group in GROUPS.values() for name, module in group.items()}
_HELP = ("-h", "--help")
_BAD_FLAGS = 2
_INTERRUPTED = 130  # 128 and the number of SIGINT.


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    os.environ["MPLBACKEND"] = "agg"  # Pictures are files; another backend may not exist.
    try:
        from starling.sim.console import shell, streams

        with streams.usable() as output:
            try:
                code = _end(arguments, ends=argv is None)
            except KeyboardInterrupt:
                code = _report_stop(_INTERRUPTED)
            lost = output.loss()
            if lost is not None:
                print(shell.format_lost_output(lost), file=sys.stderr)
            return code if lost is None else code or 1
    except KeyboardInterrupt:
        return _INTERRUPTED


def _end(arguments: list[str], *, ends: bool) -> int:
    """Run one command and turn every way in which it ends into an exit code."""
    from starling.sim.console import shell

    try:
        with shell.stopped_by_signals(ends=ends), warnings.catch_warnings():
            warnings.showwarning = shell.warn
            return _run(arguments)
    except SystemExit as stop:
        if isinstance(stop.code, int) and stop.code in shell.TERMINATED:
            return _report_stop(stop.code)
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except Exception as error:
        if "--debug" in arguments:
            raise
        print(shell.format_error(error), file=sys.stderr)
        return 1


def _report_stop(code: int) -> int:
    print("interrupted; nothing half-written is left", file=sys.stderr)
    return code


def _run(arguments: list[str]) -> int:
    import tyro
    from tyro.conf import FlagCreatePairsOff, PositionalMetavarFromFieldName

    if not arguments:
        print(_overview(), file=sys.stderr)
        return _BAD_FLAGS
    if arguments[0] in _HELP:
        print(_overview())
        return 0
    name = " ".join(arguments[:2]) if " ".join(arguments[:2]) in VERBS else arguments[0]
    if name not in VERBS:
        print(_unknown(name), file=sys.stderr)
        return _BAD_FLAGS
    _refuse_lost_folder()
    _warn_of_repeated(arguments)
    _refuse_empty(_function(name), arguments)
    tyro.cli(
        _function(name),
        prog=f"starling {name}",
        args=arguments[len(name.split()) :],
        config=(FlagCreatePairsOff, PositionalMetavarFromFieldName),
    )
    return 0


def _warn_of_repeated(arguments: list[str]) -> None:
    """Warn of a flag that is given twice: the last one counts."""
    from starling.sim.console.flags import REPEATED

    flags = Counter(word.split("=")[0] for word in arguments if word.startswith("--"))
    for flag, count in flags.items():
        if count > 1 and flag not in REPEATED:
            warnings.warn(f"{flag} is given {count} times; the last one counts.", stacklevel=1)


def _refuse_empty(verb: Callable[..., None], arguments: list[str]) -> None:
    """Refuse a flag of a list without a value, which would count as a flag that is left out."""
    from starling.patterns.errors import refuse
    from starling.sim.console.flags import REPEATED

    lists = [name for name, hint in typing.get_type_hints(verb).items() if "..." in str(hint)]
    flags = {*REPEATED, *(f"--{name.replace('_', '-')}" for name in lists)}
    for word, following in pairwise([*arguments, "--"]):
        if word in flags and following.startswith("--"):
            raise refuse(word, "must have a value", "none", "Give one, or leave the flag out.")


def _refuse_lost_folder() -> None:
    """Refuse to run in a folder that was deleted; paths are relative to it."""
    from starling.patterns.errors import refuse

    try:
        os.getcwd()
    except OSError as error:
        advice = "Change to another folder."
        raise refuse("working directory", "must exist", error.strerror, advice) from error


def _function(name: str) -> Callable[..., None]:
    function = name.replace(" ", "_")
    if keyword.iskeyword(function):  # As `import`.
        function += "_"
    return getattr(import_module(VERBS[name]), function)


def _unknown(name: str) -> str:
    nearest = difflib.get_close_matches(name, VERBS, n=1, cutoff=0.0)[0]
    return f"verb must be one of `starling --help`; got {name!r}. Nearest: {nearest}."


def _overview() -> str:
    """Return the help of the whole program: every verb with the first line of its docstring."""
    width = max(map(len, VERBS)) + 2
    lines = [
        "usage: starling VERB [--help] ...",
        "",
        "Simulate active-stereo depth cameras from the light up.",
        "",
        "Example: starling simulate tabletop --sensor d435 --out out/tabletop",
    ]
    for group, verbs in GROUPS.items():
        lines += ["", f"{group}:"]
        for name in verbs:
            summary = (_function(name).__doc__ or "").split("\n")[0]
            lines.append(f"  {name:{width}}{summary}")
    return "\n".join([*lines, "", "`starling VERB --help` explains a verb and its flags."])
