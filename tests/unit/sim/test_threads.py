"""Workers end with their parent process, however it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

POOL = """
import os, signal, sys, time
from starling.sim.console.threads import Workers

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # A background job ignores it.
    with Workers(1) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 120)
        time.sleep(120)
"""


def alive(pid: int) -> bool:
    """Return whether a process exists and is not a zombie."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8") as status:
            return status.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_workers_end_with_their_parent_process(tmp_path: Path, number: int):
    """Also in the middle of a job; an interrupt from the keyboard prints nothing in them."""
    script = tmp_path / "pool.py"
    script.write_text(POOL, encoding="utf-8")
    command, pipe = [sys.executable, script], subprocess.PIPE
    with subprocess.Popen(
        command, stdout=pipe, stderr=pipe, text=True, start_new_session=True
    ) as pool:
        assert pool.stdout is not None and pool.stderr is not None
        worker = int(pool.stdout.readline())
        assert alive(worker)
        send = os.killpg if number == signal.SIGINT else os.kill
        send(pool.pid, number)
        pool.wait(20)
        assert pool.stderr.read().count("Traceback") == (number == signal.SIGINT)
    until = time.monotonic() + 20
    while alive(worker) and time.monotonic() < until:
        time.sleep(0.05)
    assert not alive(worker)
