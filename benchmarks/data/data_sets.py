"""Cost of a data set: frame rate, workers, Ray, memory and start-up time.

Each rate is the difference of a long and a short run, so that start-up does not count. Runs of a
round that are compared follow each other. Usage, on an otherwise idle machine:

    python benchmarks/data/data_sets.py [--rounds 3] [--frames 64] [--memory-frames 2000] [--no-ray]

With `--rounds 0` only memory and bytes are measured.
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
SHORT = 8  # Frames of the short run.
LARGE = {"width": 1280, "height": 720, "fx_px": 640, "fy_px": 640, "cx_px": 639.5, "cy_px": 359.5}
SMALL = {"width": 320, "height": 180, "fx_px": 160, "fy_px": 160, "cx_px": 159.5, "cy_px": 89.5}
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def plan(folder: Path, views: int, size: dict[str, float], layers: str = '"infrared"') -> Path:
    """Write a plan of one clutter scene, seen from many places by many units."""
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
    """Return a function that pins its process to a number of cores."""
    allowed = sorted(os.sched_getaffinity(0))[:cores]
    return lambda: os.sched_setaffinity(0, allowed)


def generated(path: Path, out: Path, *flags: str, cores: int = 2) -> tuple[dict[str, float], float]:
    """Generate a set; return the result of the verb and the wall time [s]."""
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
    """Return the frame rate of a long run less a short one [1/s]."""
    seconds = []
    for count in (SHORT, SHORT + frames):
        out = Path(tempfile.mkdtemp(dir=folder))
        seconds.append(generated(plan(folder, count, size), out, *flags, cores=cores)[1])
    return frames / (seconds[1] - seconds[0])


def bare(path: Path, frames: int) -> float:
    """Return the time per frame of the pipeline alone [s], on one thread, without writing files."""
    from starling.sim import simulate
    from starling.sim.console.threads import single_threaded
    from starling.sim.datasets import plan as plans
    from starling.sim.datasets import render_view
    from starling.sim.datasets.plan import view

    single_threaded()
    options = plans.read(path)
    seconds = []
    for number in range(SHORT + frames):
        drawn_view = view(options, number)
        stage = render_view.posed(
            render_view.load_scene(drawn_view.setting, drawn_view.preset).stage,
            drawn_view,
            samples=options.samples,
        )
        sensor = render_view.camera(drawn_view)
        started = time.perf_counter()
        simulate.simulate(stage, sensor, seed=drawn_view.seed)
        seconds.append(time.perf_counter() - started)
    return float(np.mean(seconds[SHORT:]))


def bare_apart(path: Path, frames: int) -> float:
    """Run `bare` in its own process, pinned to a core."""
    done = subprocess.run(
        [sys.executable, __file__, "--bare", str(path), "--frames", str(frames)],
        check=True,
        stdout=subprocess.PIPE,
        preexec_fn=pinned(1),
        env={**os.environ, **dict.fromkeys(ONE_THREAD, "1")},
    )
    return float(done.stdout)


def memory(folder: Path, frames: int, size: dict[str, float]) -> dict[str, object]:
    """Measure the resident memory of the workers during a run, and the time of the first frame."""
    path, out = plan(folder, frames, size), folder / f"memory-{frames}"
    started = time.perf_counter()
    run = subprocess.Popen(
        [*GENERATE, str(path), "--out", str(out), "--workers", "2", "--shard-frames", "1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    first, peaks = None, []
    while run.poll() is None:
        if first is None and list((out / ".parts").glob("*.json")):
            first = time.perf_counter() - started
        gib = workers_gib(run.pid)
        if first is not None and gib:
            peaks.append(max(gib))
        time.sleep(0.2)
    tenth = max(1, len(peaks) // 10)
    return {
        "frames": frames,
        "start_s": first,
        "worker_gib_first_tenth": float(np.median(peaks[:tenth])),
        "worker_gib_last_tenth": float(np.median(peaks[-tenth:])),
        "worker_gib_peak": float(np.max(peaks)),
    }


def workers_gib(parent: int) -> list[float]:
    """Return the resident memory [GiB] of a process's spawned workers."""
    sizes = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            status = (path / "status").read_text()
            words = (path / "cmdline").read_text()
        except OSError:
            continue  # The process has ended.
        facts = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
        if int(facts["PPid"]) == parent and "spawn_main" in words and "VmRSS" in facts:
            sizes.append(int(facts["VmRSS"].split()[0]) / 2**20)
    return sizes


def main() -> None:
    """Measure, and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--frames", type=int, default=64)
    parser.add_argument("--memory-frames", type=int, default=2000)
    parser.add_argument("--no-ray", action="store_true")
    parser.add_argument("--bare", type=Path)
    options = parser.parse_args()
    if options.bare:
        print(bare(options.bare, options.frames))
        return
    rounds = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for _ in range(options.rounds):
            rates = {
                "bare_fps": 1
                / bare_apart(plan(folder, SHORT + options.frames, LARGE), options.frames),
                "one_worker_fps": rate(folder, options.frames, LARGE, "--workers", "1", cores=1),
                "two_workers_fps": rate(folder, 2 * options.frames, LARGE, "--workers", "2"),
            }
            if not options.no_ray:
                rates["ray_fps"] = rate(folder, 2 * options.frames, LARGE, "--ray", "local")
            rounds.append(rates)
            print(json.dumps(rates), file=sys.stderr, flush=True)
        sizes = {
            layers: generated(plan(folder, SHORT, LARGE, layers), folder / f"set-{number}")[0]
            for number, layers in enumerate(['"infrared"', '"infrared", "truth"', '"exr"'])
        }
        memories = [memory(folder, 16, LARGE), memory(folder, options.memory_frames, SMALL)]
    ratios = {
        "overhead": [rates["bare_fps"] / rates["one_worker_fps"] - 1 for rates in rounds],
        "second_worker": [rates["two_workers_fps"] / rates["one_worker_fps"] for rates in rounds],
    }
    if not options.no_ray:
        ratios["ray"] = [rates["ray_fps"] / rates["two_workers_fps"] for rates in rounds]
    report = {
        "rounds": rounds,
        "ratios": {name: float(np.median(values)) for name, values in ratios.items() if values},
        "bytes_per_frame": {layers: size["bytes_per_frame"] for layers, size in sizes.items()},
        "memory": memories,
    }
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
