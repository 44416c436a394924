"""Programs of `adapters`, which the check runs in separate processes. They exchange only files."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections import deque
from collections.abc import Mapping
from pathlib import Path

from starling.diagnosis.validation.camera.errors import refusal

_ADAPTERS = "starling.diagnosis.validation.adapters"
_LAST_LINES = 3  # Lines of standard error in the message of a failed program.
_PROGRESS = re.compile(r" \d+/\d+$")
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
SENSOR = "sensor.toml"


def run(
    program: str, path: Path, *words: object, flags: Mapping[str, object] | None = None
) -> None:
    """Run a program and report its progress on standard error.

    Args:
        program: Name of a module of `adapters`.
        path: First positional argument. Its parent names the progress.
        words: Further positional arguments.
        flags: Values by flag. A tuple gives a flag several values, `None` omits it.

    Raises:
        WithheldError: if the program fails.
    """
    arguments = [str(word) for word in (path, *words)]
    for flag, value in (flags or {}).items():
        if value is not None:
            arguments += [flag, *map(str, value if isinstance(value, tuple) else (value,))]
    _run(program, arguments)


def diagnose(
    cases: Path,
    out: Path,
    sensor: Path,
    cache: Path,
    *,
    against: Path | None = None,
    without: Mapping[str, str] | None = None,
) -> None:
    """Diagnose a folder of capture sets.

    Args:
        cases: Folder of the capture sets.
        out: Folder of verdicts. With `without`, the parent of `without family` and `without twins`.
        sensor: Sensor file of the nominal camera.
        cache: Folder of cached simulations.
        against: Reference capture set; None compares with the simulation.
        without: Effect to leave out, by capture set. One verdict leaves out the family of the
            effect, a second one also the families of its confusable effects.

    Raises:
        WithheldError: if the program fails.
    """
    without_file = None if without is None else out / ".without"
    flags = {"--sensor": sensor, "--cache": cache, "--against": against, "--without": without_file}
    if without_file is not None:
        out.mkdir(parents=True, exist_ok=True)
        without_file.write_text(json.dumps(without), encoding="utf-8")
    try:
        run("batch", cases, out, flags=flags)
    finally:
        if without_file is not None:
            without_file.unlink()  # The file reveals the true effects.


def _run(program: str, arguments: list[str]) -> None:
    last: deque[str] = deque(maxlen=_LAST_LINES)
    set_name = Path(arguments[0]).parent.name
    with subprocess.Popen(
        [sys.executable, "-m", _ADAPTERS, program, *arguments],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **_ONE_THREAD},
    ) as running:
        assert running.stderr is not None
        for line in map(str.strip, running.stderr):
            if _PROGRESS.search(line):
                print(f"{set_name}: {line}", file=sys.stderr, flush=True)
            elif line:
                last.append(line)
    if running.returncode:
        name = f"{_ADAPTERS}.{program}"
        raise refusal(name, "must succeed", f"exit {running.returncode}", " / ".join(last))
