"""Workers end with their killed parent process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

POOL = """
import multiprocessing, os, sys, time
from concurrent.futures import ProcessPoolExecutor
from starling.sim.console.threads import begin_worker

if __name__ == "__main__":
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context, initializer=begin_worker) as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        time.sleep(120)
"""


def alive(pid: int) -> bool:
    """Return whether a process exists and is not a zombie."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8") as status:
            return status.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_worker_ends_with_its_parent_process(tmp_path):
    script = tmp_path / "pool.py"
    script.write_text(POOL, encoding="utf-8")
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) as pool:
        assert pool.stdout is not None
        worker = int(pool.stdout.readline())
        assert alive(worker)
        os.kill(pool.pid, signal.SIGKILL)
    until = time.monotonic() + 20
    while alive(worker) and time.monotonic() < until:
        time.sleep(0.05)
    assert not alive(worker)
