"""The command line with standard streams that are closed, full, broken or of few characters."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FULL = Path("/dev/full")
LOST = (
    "starling: standard output must take the result; got No space left on device. "
    "Free some space, or send it elsewhere.\n"
)


def shell(command: str, **environment: str) -> tuple[int, str, str]:
    """Run a line of bash; `starling` is the program. Return exit code, output and errors."""
    program = f'starling() {{ {shlex.quote(sys.executable)} -m starling "$@"; }}; {command}'
    run = subprocess.run(
        ["bash", "-c", program],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    return run.returncode, run.stdout, run.stderr


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full")
@pytest.mark.parametrize("verb", ["sensors", "simulate --help", "sensors show d435 --json"])
def test_a_full_output_is_refused_in_one_line(verb: str) -> None:
    assert shell(f"starling {verb} >/dev/full") == (1, "", LOST)


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full")
@pytest.mark.parametrize("stream", ["2>/dev/full", "2>&-", "2>/dev/null"])
def test_errors_that_nobody_takes_change_nothing_else(stream: str) -> None:
    assert shell(f"starling nonsense {stream}") == (2, "", "")
    assert shell(f"starling sensors >/dev/full {stream}") == (1, "", "")
    code, out, _ = shell(f"starling sensors --json {stream}")
    assert code == 0 and "d435" in json.loads(out)


def test_a_closed_output_is_silent() -> None:
    assert shell("starling sensors >&-") == (0, "", "")
    assert shell("starling sensors <&- >&- 2>&-") == (0, "", "")


def test_a_closed_pipe_is_no_error() -> None:
    assert shell("starling sensors | true; echo ${PIPESTATUS[0]}") == (0, "0\n", "")


def test_closed_streams_give_no_number_to_another_file(tmp_path: Path) -> None:
    """Otherwise a library that prints would write into that file."""
    code = (
        "from starling.sim.console import streams\n"
        "with streams.usable(), open('kept', 'w') as file:\n"
        "    assert file.fileno() > 2, file.fileno()\n"
    )
    command = (
        f"cd {shlex.quote(str(tmp_path))}; {shlex.quote(sys.executable)} -c {shlex.quote(code)}"
    )
    environment = {"PYTHONPATH": str(ROOT)}
    assert shell(f"({command}) <&- >&-", **environment) == (0, "", "")


@pytest.mark.parametrize(
    ("encoding", "text"),
    [("ascii", r"\xf6 \u2192 \udcff"), ("latin-1", r"ö \u2192 \udcff"), ("utf-8", r"ö → \udcff")],
)
def test_any_text_is_printed_in_any_encoding(encoding: str, text: str) -> None:
    """Also a file name that is no text; JSON has escapes of its own."""
    name = "\xf6 \u2192 \udcff"
    code = (
        "import sys, warnings; from starling.command_line import main\n"
        "from starling.sim.render import backend\n"
        f"backend.report = lambda: warnings.warn({name!a}) or {{'out': {name!a}}}\n"
        "sys.exit(main(['doctor', *sys.argv[1:]]))"
    )
    for flags in ([], ["--json"]):
        run = subprocess.run(
            [sys.executable, "-c", code, *flags],
            cwd=ROOT,
            env={**os.environ, "PYTHONIOENCODING": f"{encoding}:strict"},
            capture_output=True,
            check=False,
        )
        out, err = run.stdout.decode(encoding), run.stderr.decode(encoding)
        assert (run.returncode, err) == (0, f"starling: warning: {text}\n")
        assert json.loads(out) == {"out": name} if flags else out == f"out  {text}\n"


def test_pictures_need_no_backend_of_the_environment() -> None:
    """The name of an unknown one stops every import of matplotlib."""
    code = (
        "import sys; from starling.command_line import main\n"
        "from starling.sim.plotting import sheet\n"
        "from starling.sim.render import backend\n"
        "backend.report = lambda: len(sheet.encode(sheet.new_figure((1, 1), 50)))\n"
        "sys.exit(main(['doctor', '--json']))"
    )
    program = f"{shlex.quote(sys.executable)} -c {shlex.quote(code)}"
    exit_code, out, _ = shell(program, MPLBACKEND="no")
    assert exit_code == 0 and int(out) > 100
