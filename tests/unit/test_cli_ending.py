"""The command line: termination of a process, and the files it leaves."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from starling import command_line
from starling.sim.console import shell
from starling.sim.render import backend

ROOT = Path(__file__).parents[2]
Capsys = pytest.CaptureFixture[str]
# Children of a background shell or of nohup ignore interrupts and hang-ups.
INTERRUPTIBLE = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "signal.signal(signal.SIGHUP, signal.SIG_DFL)\n"
)


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


@pytest.mark.parametrize(
    ("number", "exit_code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130), (signal.SIGHUP, 129)]
)
def test_signal_leaves_nothing(tmp_path: Path, number: int, exit_code: int) -> None:
    """A process stopped while it writes removes partial output, however often it is told to."""
    code = INTERRUPTIBLE + (
        "import os, shutil, sys, time; from starling.command_line import main\n"
        "from starling.sim.console.output import OutputFolder\n"
        "from starling.sim.render import backend\n"
        "remove = shutil.rmtree\n"
        "def told_again(*arguments, **flags):\n"
        f"    os.kill(os.getpid(), {number})\n"
        "    remove(*arguments, **flags)\n"
        "shutil.rmtree = told_again\n"
        "def report():\n"
        f"    with OutputFolder({str(tmp_path / 'out')!r}) as folder:\n"
        "        folder.write('a', 'x'); print('ready', flush=True); time.sleep(60)\n"
        "backend.report = report\n"
        "sys.exit(main(['doctor']))"
    )
    command, pipe = [sys.executable, "-c", code], subprocess.PIPE
    with subprocess.Popen(command, cwd=ROOT, stdout=pipe, stderr=pipe, text=True) as run:
        assert run.stdout is not None and run.stderr is not None
        run.stdout.readline()
        assert list(tmp_path.iterdir())
        run.send_signal(number)
        assert run.wait(10) == exit_code
        assert run.stderr.read() == "interrupted; nothing half-written is left\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_during_an_import_that_catches_everything_is_not_lost(
    tmp_path: Path, number: int
) -> None:
    """As trimesh catches what its optional imports raise."""
    signals = "import os, time; os.kill(os.getpid(), {}); time.sleep(0.3)"
    (tmp_path / "signalled_import.py").write_text(
        f"try:\n    {signals.format(int(number))}\nexcept BaseException:\n    pass\n"
    )
    code = INTERRUPTIBLE + (
        f"import sys, time; sys.path.insert(0, {str(tmp_path)!r})\n"
        "from starling.command_line import main\n"
        "from starling.sim.render import backend\n"
        "def report():\n"
        "    import signalled_import\n"
        "    time.sleep(60)\n"
        "backend.report = report\n"
        "sys.exit(main(['doctor']))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stderr) == (
        128 + number,
        "interrupted; nothing half-written is left\n",
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_second_signal_while_the_process_ends_is_ignored(number: int) -> None:
    """At the end of Python it would print a traceback."""
    code = INTERRUPTIBLE + (
        "import atexit, os, sys\n"
        "from starling import command_line\n"
        "from starling.sim.render import backend\n"
        f"backend.report = lambda: os.kill(os.getpid(), {int(number)})\n"
        f"atexit.register(os.kill, os.getpid(), {int(number)})\n"
        "sys.argv[1:] = ['doctor']\n"
        "sys.exit(command_line.main())"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stderr) == (
        128 + number,
        "interrupted; nothing half-written is left\n",
    )


def test_ignored_signal_stays_ignored() -> None:
    """As those of a program that `nohup` or a script started in the background."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with shell.stopped_by_signals():
            assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_runs_in_a_thread_and_leaves_signals_alone(capsys: Capsys) -> None:
    before = signal.getsignal(signal.SIGTERM)
    with ThreadPoolExecutor() as pool:
        assert pool.submit(command_line.main, ["sensors", "show", "d435"]).result() == 0
    assert command_line.main(["sensors", "show", "d435"]) == 0
    assert signal.getsignal(signal.SIGTERM) is before
    assert capsys.readouterr().out.count('name = "d435"') == 2
