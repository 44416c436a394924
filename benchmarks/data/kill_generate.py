"""Kill a data set's run again and again, and compare what it ends in with a run left alone.

    python benchmarks/data/kill_generate.py [--kills 20] [--frames 300]

Small frames (320x180); each run and its workers are ended by SIGKILL at a moment drawn by lot.
"""

import argparse
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from data_sets import GENERATE, SMALL, plan

MOMENTS_S = (0.5, 9.0)  # Of kills, from the start of a run; starting takes some 3 s.


def main() -> None:
    """Print how many kills struck, and frames that are missing, there twice, or differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--frames", type=int, default=300)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        path = plan(Path(name), asked.frames, SMALL)
        alone, killed = Path(name) / "alone", Path(name) / "killed"
        flags = ["--workers", "2", "--shard-frames", "4"]
        subprocess.run([*GENERATE, str(path), "--out", str(alone), *flags], check=True, **QUIET)
        rng, struck, whole = random.Random(1), 0, []
        while struck < asked.kills:
            run = subprocess.Popen(
                [*GENERATE, str(path), "--out", str(killed), *flags],
                start_new_session=True,
                **QUIET,
            )
            time.sleep(rng.uniform(*MOMENTS_S))
            if run.poll() is not None:
                break
            os.killpg(run.pid, signal.SIGKILL)
            run.wait()
            struck += 1
            whole.append(len(list((killed / ".parts").glob("[0-9]*.json"))))
        subprocess.run([*GENERATE, str(path), "--out", str(killed), *flags], check=True, **QUIET)
        verify = [sys.executable, "-m", "starling", "verify", str(killed), "--json"]
        told = json.loads(subprocess.run(verify, check=True, stdout=subprocess.PIPE).stdout)
        one, other = digests(alone), digests(killed)
        unlike = sum(one.get(file) != other.get(file) for file in {*one, *other})
        print(json.dumps({"kills": struck, "tasks_whole_at_kills": whole, **told}))
        print(f"{len(one)} files of the run left alone; {unlike} differ or are in one alone")


QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


def digests(folder: Path) -> dict[str, str]:
    """Checksum of each file of a set, by name; locks and what else is hidden are no part of it."""
    return {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in folder.rglob("*")
        if file.is_file() and not file.name.startswith(".")
    }


if __name__ == "__main__":
    main()
