"""Kill the generation of a data set repeatedly, and compare the result with an uninterrupted run.

    python benchmarks/data/kill_generate.py [--kills 20] [--frames 300]

Frames are small (320x180). Each run and its workers are ended by SIGKILL at a random time.
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

MOMENTS_S = (0.5, 9.0)  # Range of the time of a kill after the start [s]; starting takes about 3 s.


def main() -> None:
    """Print the number of kills, and of frames that are missing, duplicate or different."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--frames", type=int, default=300)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        path = plan(Path(name), options.frames, SMALL)
        alone, killed = Path(name) / "alone", Path(name) / "killed"
        flags = ["--workers", "2", "--shard-frames", "4"]
        subprocess.run([*GENERATE, str(path), "--out", str(alone), *flags], check=True, **QUIET)
        rng, kills, whole = random.Random(1), 0, []
        while kills < options.kills:
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
            kills += 1
            whole.append(len(list((killed / ".parts").glob("[0-9]*.json"))))
        subprocess.run([*GENERATE, str(path), "--out", str(killed), *flags], check=True, **QUIET)
        verify = [sys.executable, "-m", "starling", "verify", str(killed), "--json"]
        result = json.loads(subprocess.run(verify, check=True, stdout=subprocess.PIPE).stdout)
        expected, actual = digests(alone), digests(killed)
        different = sum(expected.get(file) != actual.get(file) for file in {*expected, *actual})
        print(json.dumps({"kills": kills, "tasks_whole_at_kills": whole, **result}))
        print(f"{len(expected)} files of the uninterrupted run; {different} differ or are missing")


QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


def digests(folder: Path) -> dict[str, str]:
    """Return the checksum of each file of a set, by name, without hidden files."""
    return {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in folder.rglob("*")
        if file.is_file() and not file.name.startswith(".")
    }


if __name__ == "__main__":
    main()
