"""What a data set costs: frames a second beside the bare pipeline, workers, Ray, memory, start.

Every rate is that of a long run less a short one, so that starting up does not count; both of a
round and what they are compared with run one after the other. Usage, on a machine that does nothing
else:

    python benchmarks/data/data_sets.py [--rounds 3] [--frames 64] [--memory-frames 2000] [--no-ray]

Without rounds memory and bytes are measured alone.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

GENERATE = (sys.executable, "-m", "starling", "generate", "--json")
SHORT = 8
LARGE = {"width": 1280, "height": 720, "fx_px": 640, "fy_px": 640, "cx_px": 639.5, "cy_px": 359.5}
SMALL = {"width": 320, "height": 180, "fx_px": 160, "fy_px": 160, "cx_px": 159.5, "cy_px": 89.5}
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def plan(folder: Path, views: int, size: dict[str, float], layers: str = '"infrared"') -> Path:
    """One scene of clutter, seen from many places by many units."""
    fields = "\n".join(f"{name} = {value}" for name, value in size.items())
    path = folder / f"plan-{views}-{size['width']}-{len(layers)}.toml"
    path.write_text(
        f"""seed = 1
scenes = 1
views = {views}
layers = [{layers}]
[[source]]
kind = "builtin"
scene = "clutter"
number = 0
[[sensor]]
preset = "d435"
[sensor.set]
{fields}
[pose]
shift_m = [{{ low = -0.1, high = 0.1 }}, 0, 0]
turn_deg = [0, {{ low = -5, high = 5 }}, 0]
"""
    )
    return path


def pinned(cores: int) -> Callable[[], None]:
    """What a process does to itself to have so many cores."""
    mine = sorted(os.sched_getaffinity(0))[:cores]
    return lambda: os.sched_setaffinity(0, mine)


def generated(path: Path, out: Path, *flags: str, cores: int = 2) -> tuple[dict[str, float], float]:
    """Make a set; what the verb says, and the seconds from outside."""
    started = time.perf_counter()
    done = subprocess.run(
        [*GENERATE, str(path), "--out", str(out), "--shard-frames", "4", *flags],
        check=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        preexec_fn=pinned(cores),
    )
    return json.loads(done.stdout), time.perf_counter() - started


def rate(folder: Path, frames: int, size: dict[str, float], *flags: str, cores: int = 2) -> float:
    """Frames a second of a long run less a short one."""
    seconds = []
    for count in (SHORT, SHORT + frames):
        out = Path(tempfile.mkdtemp(dir=folder))
        seconds.append(generated(plan(folder, count, size), out, *flags, cores=cores)[1])
    return frames / (seconds[1] - seconds[0])


def bare(path: Path, frames: int) -> float:
    """Seconds a frame of the pipeline alone, on one thread of one core; nothing is written."""
    from starling.sim import simulate
    from starling.sim.console.threads import single_threaded
    from starling.sim.datasets import plan as plans
    from starling.sim.datasets import render_view, stages
    from starling.sim.datasets.view import view

    single_threaded()
    asked = plans.read(path)
    seconds = []
    for number in range(SHORT + frames):
        one = view(asked, number)
        stage = render_view.posed(
            stages.of(one.setting, one.preset).stage, one, samples=asked.samples
        )
        sensor = render_view.camera(one)
        started = time.perf_counter()
        simulate.simulate(stage, sensor, seed=one.seed)
        seconds.append(time.perf_counter() - started)
    return float(np.mean(seconds[SHORT:]))


def bare_apart(path: Path, frames: int) -> float:
    """`bare` in a process of its own, pinned to a core."""
    done = subprocess.run(
        [sys.executable, __file__, "--bare", str(path), "--frames", str(frames)],
        check=True,
        stdout=subprocess.PIPE,
        preexec_fn=pinned(1),
        env={**os.environ, **dict.fromkeys(ONE_THREAD, "1")},
    )
    return float(done.stdout)


def memory(folder: Path, frames: int, size: dict[str, float]) -> dict[str, object]:
    """Resident memory of the workers over a run, and when the first frame stood on the disk."""
    path, out = plan(folder, frames, size), folder / f"memory-{frames}"
    started = time.perf_counter()
    run = subprocess.Popen(
        [*GENERATE, str(path), "--out", str(out), "--workers", "2", "--shard-frames", "1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    first, seen = None, []
    while run.poll() is None:
        if first is None and list((out / ".parts").glob("*.json")):
            first = time.perf_counter() - started
        gib = workers_gib(run.pid)
        if first is not None and gib:
            seen.append(max(gib))
        time.sleep(0.2)
    tenth = max(1, len(seen) // 10)
    return {
        "frames": frames,
        "start_s": first,
        "worker_gib_first_tenth": float(np.median(seen[:tenth])),
        "worker_gib_last_tenth": float(np.median(seen[-tenth:])),
        "worker_gib_peak": float(np.max(seen)),
    }


def workers_gib(parent: int) -> list[float]:
    """Resident memory [GiB] of a process's spawned workers."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            status = (path / "status").read_text()
            words = (path / "cmdline").read_text()
        except OSError:
            continue  # It has ended.
        facts = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
        if int(facts["PPid"]) == parent and "spawn_main" in words and "VmRSS" in facts:
            found.append(int(facts["VmRSS"].split()[0]) / 2**20)
    return found


def main() -> None:
    """Measure, and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--frames", type=int, default=64)
    parser.add_argument("--memory-frames", type=int, default=2000)
    parser.add_argument("--no-ray", action="store_true")
    parser.add_argument("--bare", type=Path)
    asked = parser.parse_args()
    if asked.bare:
        print(bare(asked.bare, asked.frames))
        return
    rounds = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for _ in range(asked.rounds):
            found = {
                "bare_fps": 1 / bare_apart(plan(folder, SHORT + asked.frames, LARGE), asked.frames),
                "one_worker_fps": rate(folder, asked.frames, LARGE, "--workers", "1", cores=1),
                "two_workers_fps": rate(folder, 2 * asked.frames, LARGE, "--workers", "2"),
            }
            if not asked.no_ray:
                found["ray_fps"] = rate(folder, 2 * asked.frames, LARGE, "--ray", "local")
            rounds.append(found)
            print(json.dumps(found), file=sys.stderr, flush=True)
        sizes = {
            layers: generated(plan(folder, SHORT, LARGE, layers), folder / f"set-{number}")[0]
            for number, layers in enumerate(['"infrared"', '"infrared", "truth"', '"exr"'])
        }
        remembered = [memory(folder, 16, LARGE), memory(folder, asked.memory_frames, SMALL)]
    ratios = {
        "overhead": [one["bare_fps"] / one["one_worker_fps"] - 1 for one in rounds],
        "second_worker": [one["two_workers_fps"] / one["one_worker_fps"] for one in rounds],
    }
    if not asked.no_ray:
        ratios["ray"] = [one["ray_fps"] / one["two_workers_fps"] for one in rounds]
    told = {
        "rounds": rounds,
        "ratios": {name: float(np.median(values)) for name, values in ratios.items() if values},
        "bytes_per_frame": {layers: one["bytes_per_frame"] for layers, one in sizes.items()},
        "memory": remembered,
    }
    print(json.dumps(told, indent=1))


if __name__ == "__main__":
    main()
