"""Programs that connect the validation to Starling, each in its own process.

    python -m starling.diagnosis.validation.adapters PROGRAM [--help] ...

Exit codes: 0 done, 1 refused (one line on standard error), 2 bad flags.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module

import tyro
from tyro.conf import FlagCreatePairsOff, PositionalMetavarFromFieldName

from starling.diagnosis.validation.camera.errors import WithheldError
from starling.patterns.errors import InputError

# Each program and the module whose function of the same name it calls.
PROGRAMS = {
    "batch": "batch",
    "captured_camera": "cameras",
    "cycles_light": "cycles_light",
    "detection": "detection",
    "families": "families",
    "light_sets": "light_sets",
    "own_depth": "own_depth",
}
_BAD_FLAGS = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one program and return the exit code."""
    name, *rest = (sys.argv[1:] if arguments is None else arguments) or ["--help"]
    if name not in PROGRAMS:
        print(f"{__doc__}\nPrograms: {', '.join(PROGRAMS)}.", file=sys.stderr)
        return 0 if name in ("-h", "--help") else _BAD_FLAGS
    package = "starling.diagnosis.validation.adapters"
    program = getattr(import_module(f"{package}.{PROGRAMS[name]}"), name)
    try:
        tyro.cli(
            program,
            prog=f"python -m {package} {name}",
            args=rest,
            config=(FlagCreatePairsOff, PositionalMetavarFromFieldName),
        )
    except (InputError, WithheldError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
