"""The command line: termination of a process, and the files it leaves."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from starling import command_line
from starling.sim.render import backend

ROOT = Path(__file__).parents[2]
Capsys = pytest.CaptureFixture[str]


def test_warnings_are_one_line(capsys: Capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    def report() -> dict[str, int]:
        warnings.warn("slow", backend.ScalarFallbackWarning, stacklevel=1)
        return {"a": 1}

    monkeypatch.setattr(backend, "report", report)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        code = command_line.main(["doctor", "--json"])
    out, err = capsys.readouterr()
    assert (code, json.loads(out), err) == (0, {"a": 1}, "starling: warning: slow\n")


def test_closed_output_pipe_is_no_error() -> None:
    run = subprocess.run(
        [sys.executable, "-c", "import sys; from starling.command_line import main;"
         f"sys.stdout = open({os.devnull!r}, 'w');"
         "from starling.sim.console import shell;"
         "shell.say = lambda *_, **__: (_ for _ in ()).throw(BrokenPipeError());"
         "sys.exit(main(['sensors', 'show', 'd435']))"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (run.returncode, run.stderr) == (0, "")


def test_termination_leaves_nothing(tmp_path: Path) -> None:
    """A process terminated while it writes removes partial output, like one that fails."""
    code = (
        "import sys, time; from starling.command_line import main\n"
        "from starling.sim.console.output import OutputFolder\n"
        "from starling.sim.render import backend\n"
        "def report():\n"
        f"    with OutputFolder({str(tmp_path / 'out')!r}) as folder:\n"
        "        folder.write('a', 'x'); print('ready', flush=True); time.sleep(60)\n"
        "backend.report = report\n"
        "sys.exit(main(['doctor']))"
    )
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE) as run:
        assert run.stdout is not None
        run.stdout.readline()
        assert list(tmp_path.iterdir())
        run.send_signal(signal.SIGTERM)
        assert run.wait(10) == 143
    assert not list(tmp_path.iterdir())


def test_runs_in_a_thread_and_leaves_signals_alone(capsys: Capsys) -> None:
    before = signal.getsignal(signal.SIGTERM)
    with ThreadPoolExecutor() as pool:
        assert pool.submit(command_line.main, ["sensors", "show", "d435"]).result() == 0
    assert command_line.main(["sensors", "show", "d435"]) == 0
    assert signal.getsignal(signal.SIGTERM) is before
    assert capsys.readouterr().out.count('name = "d435"') == 2
