"""Kill the generation of data sets repeatedly, and compare the results with an uninterrupted run.

    python benchmarks/data/kill_generate.py [--minutes 60] [--frames 300] [--disk FOLDER] [--no-ray]

Frames are small (320x180). Every few seconds, at random, SIGKILL ends the run with its workers, one
worker, or the Ray node; or a ballast file fills the disk for a while. `--disk` names a folder on a
small file system for that; without it the disk is never filled. An ended run is started again until
its set is complete. Then the next set begins.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from data_sets import GENERATE, SMALL, plan

PAUSE_S = (0.5, 40.0)  # Range of the time between interruptions [s]; starting takes about 3 s.
FULL_S = 4.0  # Time for which the disk stays full [s].
BLOCK = bytes(1 << 16)
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
PIPED = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
RUNS = {"local": ("--workers", "2"), "ray": ("--ray", "local")}


def main() -> None:
    """Print interruptions by kind, and frames that are missing, duplicate or different."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--disk", type=Path)
    parser.add_argument("--no-ray", action="store_true")
    options = parser.parse_args()
    modes = ["local"] if options.no_ray else list(RUNS)
    rng = random.Random(1)
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(dir=options.disk) as name:
        folder = Path(name)
        path = plan(folder, options.frames, SMALL)
        alone, killed = folder / "alone", folder / "killed"
        command = [*GENERATE, str(path), "--shard-frames", "4"]
        subprocess.run([*command, "--out", str(alone), *RUNS["local"]], check=True, **QUIET)
        expected = digests(alone)
        end = time.monotonic() + 60 * options.minutes
        while time.monotonic() < end:
            interrupt_until_complete([*command, "--out", str(killed)], modes, rng, counts, options)
            compare(expected, killed, counts)
            print(json.dumps(counts), flush=True)
            shutil.rmtree(killed)


def interrupt_until_complete(
    command: list[str],
    modes: list[str],
    rng: random.Random,
    counts: Counter[str],
    options: argparse.Namespace,
) -> None:
    """Start the command until it succeeds, and interrupt it at random times."""
    failures = 0  # Runs in a row that failed without an interruption.
    while failures < 3:
        mode = rng.choice(modes)
        with tempfile.TemporaryFile("w+") as messages:
            run = subprocess.Popen(
                [*command, *RUNS[mode]],
                start_new_session=True,
                stdout=subprocess.DEVNULL,
                stderr=messages,
            )
            counts["runs"] += 1
            failures += 1
            while not ends_within(run, rng.uniform(*PAUSE_S)):
                kinds = ["head", "worker"]
                kinds += ["ray node"] if mode == "ray" else []
                kinds += ["full disk"] if options.disk else []
                kind = rng.choice(kinds)
                counts[kind] += interrupt(run, kind, rng, options.disk)
                failures = 0
            end_leftovers(run)
            messages.seek(0)
            text = messages.read()
        counts["tracebacks"] += "Traceback" in text
        if run.returncode == 0:
            return
        if run.returncode > 0:
            refusals = [line for line in text.splitlines() if line.startswith("starling: ")]
            counts[refusals[-1].partition("; got")[0] if refusals else "no refusal"] += 1
    raise SystemExit("the run fails without an interruption")


def ends_within(run: subprocess.Popen[bytes], seconds: float) -> bool:
    """Wait for a process; return whether it ended."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        run.wait(seconds)
    return run.returncode is not None


def interrupt(
    run: subprocess.Popen[bytes], kind: str, rng: random.Random, disk: Path | None
) -> bool:
    """Interrupt a run; return whether there was something to kill or fill."""
    if kind == "full disk":
        assert disk is not None
        fill(disk)
        return True
    if kind == "head":
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        return True
    marks = ("raylet/raylet",) if kind == "ray node" else ("spawn_main", "ray::")
    processes = [pid for pid in session(run.pid) if any(m in command_line(pid) for m in marks)]
    if not processes:
        return False
    with contextlib.suppress(ProcessLookupError):
        os.kill(rng.choice(processes), signal.SIGKILL)
    return True


def fill(disk: Path) -> None:
    """Fill a file system, and free it after a while."""
    ballast = disk / "ballast"
    end = time.monotonic() + FULL_S
    with ballast.open("wb", buffering=0) as file:
        while time.monotonic() < end:
            try:
                file.write(BLOCK)
            except OSError:
                time.sleep(0.05)
    ballast.unlink()


def session(leader: int) -> list[int]:
    """Return descendants of a process, by their session or their parents."""
    parents: dict[int, int] = {}
    sessions: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = stat.read_text().rpartition(")")[2].split()
            pid = int(stat.parent.name)
            parents[pid], sessions[pid] = int(fields[1]), int(fields[3])

    def descends(pid: int) -> bool:
        while pid > 1:
            if pid == leader or sessions.get(pid) == leader:
                return True
            pid = parents.get(pid, 0)
        return False

    return [pid for pid in parents if pid != leader and descends(pid)]


def command_line(pid: int) -> str:
    """Return the command line of a process; empty if it has ended."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace")
    return ""


def end_leftovers(run: subprocess.Popen[bytes]) -> None:
    """Kill the remaining processes of a run's session."""
    for pid in session(run.pid):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def compare(expected: dict[str, str], killed: Path, counts: Counter[str]) -> None:
    """Count findings of `verify`, and files that differ from those expected."""
    verify = [sys.executable, "-m", "starling", "verify", str(killed), "--json"]
    result = json.loads(subprocess.run(verify, check=False, **PIPED).stdout)
    actual = digests(killed)
    counts["sets"] += 1
    for key in ("frames", "missing", "duplicate", "differing"):
        value = result.get(key, 0)
        counts[key] += value if isinstance(value, int) else len(value)
    counts["findings"] += len(result["findings"])
    counts["different files"] += sum(
        expected.get(file) != actual.get(file) for file in {*expected, *actual}
    )


def digests(folder: Path) -> dict[str, str]:
    """Return the checksum of each file of a set, by name, without hidden files."""
    return {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in folder.rglob("*")
        if file.is_file() and not file.name.startswith(".")
    }


if __name__ == "__main__":
    main()
