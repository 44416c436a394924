"""Mutated files of every format are read or refused; nothing else comes out of the readers.

A reader may return a result or raise the refusal of its package. It may not raise another error,
let a library warn or print, run for seconds, or allocate 100 MB. Each mutation depends on the name
of its format and its number only. The messages hold the compressed bytes of the mutated file.
"""

from __future__ import annotations

import base64
import collections
import dataclasses
import json
import os
import random
import signal
import subprocess
import sys
import traceback
import warnings
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest

from starling.diagnosis.validation.camera.errors import WithheldError
from starling.patterns.errors import InputError
from tests.system.fuzzed_formats import FORMATS
from tests.system.fuzzed_parts import Format
from tests.system.mutations import mutate

pytestmark = pytest.mark.slow

_LONGEST_S = 5.0  # Processor time of one read.
_MOST_BYTES = 100e6  # Growth of the resident memory during one read.
_ROOT = "fuzzed-files"  # Folder of the files, and so a part of the program's own warnings.
_SHOWN = 8  # Failures in a message.
_FEW = 200  # Mutations of each format in the quick test.
_FEW_SLOW = 50  # Mutations of each slow format in the quick test.


class _TooLongError(BaseException):
    """A read takes too long; readers that catch every `Exception` do not catch it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Failure:
    """A mutation that the reader does not survive."""

    name: str  # Of the format.
    number: int
    cause: str
    data: str  # Bytes of the file: zlib, then base 85.


@contextmanager
def _limited() -> Iterator[None]:
    """Raise `_TooLongError` after `_LONGEST_S`."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise _TooLongError

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, _LONGEST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def _memory(name: str) -> float:
    """Return `VmRSS` or its peak `VmHWM` [byte]; 0 where /proc is missing."""
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return 0.0
    return 1024 * float(status.partition(f"{name}:")[2].split()[0])


def _reset_peak() -> None:
    if os.path.exists("/proc/self/clear_refs"):
        with open("/proc/self/clear_refs", "w") as file:
            file.write("5")


def _cause(form: Format, path: Path) -> str | None:
    """Read a file and return why the read fails, or None."""
    _reset_peak()
    before = _memory("VmRSS")
    try:
        with warnings.catch_warnings(record=True) as caught, _limited():
            warnings.simplefilter("always")
            form.read(path)
    except (InputError, WithheldError) as error:
        if not str(error) or "\n" in str(error):
            return f"a refusal of several lines: {str(error)!r}"
    except _TooLongError:
        return f"more than {_LONGEST_S:g} s: {traceback.format_exc(limit=-3)}"
    except BaseException as error:
        return f"{type(error).__name__}: {error} {_place(error)}"[-700:]
    grown = _memory("VmHWM") - before
    if grown > _MOST_BYTES:
        return f"{grown / 1e6:.0f} MB of memory"
    for warning in caught:  # The program's own warnings name the file.
        own = warning.category is UserWarning and _ROOT in str(warning.message)
        if not own:
            return f"warning: {warning.category.__name__}: {warning.message}"[:300]
    return None


def _place(error: BaseException) -> str:
    steps = traceback.extract_tb(error.__traceback__)
    return " <- ".join(f"{Path(step.filename).name}:{step.lineno}" for step in steps[:-5:-1])


def _overwrite(path: Path, data: bytes) -> None:
    """Replace the content; file systems flush a file that is emptied first."""
    with path.open("r+b") as file:
        file.write(data)
        file.truncate()


def fuzz(name: str, folder: Path, count: int) -> list[Failure]:
    """Read mutations 0 to `count` of a format, and return the failures.

    The number and the bytes of the present mutation stand in `folder`, in case the process dies.
    """
    form = FORMATS[name]
    (folder / _ROOT).mkdir()
    path = form.write(folder / _ROOT)
    valid = path.read_bytes()
    form.read(path)  # It imports libraries, which takes memory.
    cause = _cause(form, path)
    assert cause is None, f"the valid file of {name}: {cause}"
    failures = []
    (folder / "number").touch()
    for number in range(count):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            data = mutate(valid, form.mutator, random.Random(f"{name} {number}"))
        _overwrite(path, data)
        _overwrite(folder / "number", str(number).encode())
        cause = _cause(form, path)
        if cause is not None:
            packed = base64.b85encode(zlib.compress(data)).decode()
            failures.append(Failure(name=name, number=number, cause=cause, data=packed))
    return failures


def _in_own_process(names: Sequence[str], folder: Path, count: int) -> list[Failure]:
    """Call `fuzz` for several formats in a new process; its death is a failure."""
    module = "tests.system.test_fuzz_formats"
    command = [sys.executable, "-m", module, str(folder), str(count), *names]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    if done.returncode == 0 and not done.stderr:
        return [Failure(**failure) for failure in json.loads(done.stdout)]
    last = max((path for path in folder.glob("*/number")), key=lambda path: int(path.parent.name))
    name, number = names[int(last.parent.name)], int(last.read_text())
    data = mutate(_valid(name, folder), FORMATS[name].mutator, random.Random(f"{name} {number}"))
    cause = f"exit code {done.returncode}, {done.stderr[-1500:]}"
    packed = base64.b85encode(zlib.compress(data)).decode()
    return [Failure(name=name, number=number, cause=cause, data=packed)]


def _each(names: Sequence[str], folder: Path, count: int) -> list[Failure]:
    """Call `fuzz` for several formats, each in a folder named after its place."""
    failures = []
    for place, name in enumerate(names):
        (folder / str(place)).mkdir()
        few = FORMATS[name].slow and count == _FEW
        failures += fuzz(name, folder / str(place), _FEW_SLOW if few else count)
    return failures


def _valid(name: str, folder: Path) -> bytes:
    (folder / "again").mkdir()
    return FORMATS[name].write(folder / "again").read_bytes()


def _check(
    names: Sequence[str], folder: Path, count: int, capfd: pytest.CaptureFixture[str]
) -> None:
    native = any(FORMATS[name].native for name in names)
    failures = (_in_own_process if native else _each)(names, folder, count)
    printed = "".join(capfd.readouterr())
    assert not printed, f"{names}: a library printed {printed[:1000]}"
    causes = collections.Counter(failure.cause for failure in failures)
    shown = [
        f"{failure.name} {failure.number}: {failure.cause}\n  {failure.data}"
        for failure in failures[:_SHOWN]
    ]
    assert not failures, "\n".join([f"{len(failures)} failures of {len(causes)} causes", *shown])


@pytest.mark.parametrize("name", [name for name, form in FORMATS.items() if not form.native])
def test_mutated_files(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    _check([name], tmp_path, _FEW, capfd)


def test_mutated_files_of_native_formats(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """One process reads them all, as it takes seconds to start."""
    _check([name for name, form in FORMATS.items() if form.native], tmp_path, _FEW, capfd)


@pytest.mark.long
@pytest.mark.parametrize("name", FORMATS)
def test_many_mutated_files(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    _check([name], tmp_path, 10_000, capfd)


if __name__ == "__main__":
    _, _folder, _count, *_names = sys.argv
    _failures = _each(_names, Path(_folder), int(_count))
    print(json.dumps([dataclasses.asdict(failure) for failure in _failures]))
