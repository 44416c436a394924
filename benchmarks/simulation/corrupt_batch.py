"""Measure a batch of corrupted depth images against one image at a time, on the processor.

CPU time is the sum of all threads; the batch has one. Memory is the growth of the largest resident
set with the number of environments. The bound of a GPU is estimated from the bytes that the kernels
move, not measured.

Usage:
    python benchmarks/simulation/corrupt_batch.py [--sizes 160x120x64 320x240x64 640x480x64]
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import starling
from starling.sim.batch import handoff
from starling.sim.sensor import edits

FOV_DEG = 58.2
REPEATS = 3
MORE = 3  # Environments added to measure their memory.
WARM = 1  # Environments that load all kernels before.
BANDWIDTH = 4.8e12  # Of one H200, by its data sheet [B/s].
VOLUME_PASSES = 26  # Reads and writes of a volume: cost 7, clearing 1, paths 15, winners 3.
COST_BYTES = 2  # Of an element of a volume.
IMAGE_BYTES = 600  # Read and written by the other kernels, for each pixel; counted by hand.


def main() -> None:
    """Print a row for each size."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    sizes = ["160x120x64", "320x240x64", "640x480x64", "640x480x128"]
    parser.add_argument("--sizes", nargs="+", default=sizes, help="width x height x disparities")
    options = parser.parse_args()
    print(
        "| size, disparities | batch, CPU [ms] | `Corruptor`, CPU [ms] | memory [MB] "
        "| moved [MB] | bound of one H200, estimated [frames/s] |\n|---|---|---|---|---|---|"
    )
    for size in options.sizes:
        with multiprocessing.get_context("spawn").Pool(1) as pool:  # The largest set only grows.
            print(pool.apply(row, (size,)), flush=True)


def row(size: str) -> str:
    """Return the row of a size."""
    width, height, search = (int(part) for part in size.split("x"))
    focal = height / 2 / np.tan(np.deg2rad(FOV_DEG) / 2)
    matrix = np.array([[focal, 0, width / 2 - 0.5], [0, focal, height / 2 - 0.5], [0, 0, 1]])
    sensor = starling.load_sensor("d435", camera_matrix=matrix, size=(width, height))
    camera = starling.Corruptor(edits.apply(sensor, [f"matcher.search_px={search}"]), matrix)
    depth = room(width, height)
    warp = handoff.import_warp()

    def batch(count: int) -> None:
        camera.batch(warp.array(np.repeat(depth[None], count, axis=0)))

    batch(WARM)
    before_mb = peak_mb()
    batch(WARM + MORE)
    memory_mb = (peak_mb() - before_mb) / MORE
    batch_ms = cpu_ms(lambda: batch(1))
    camera(depth)
    single_ms = cpu_ms(lambda: camera(depth))
    moved = width * height * (VOLUME_PASSES * COST_BYTES * search + IMAGE_BYTES)
    cells = (batch_ms, single_ms, memory_mb, moved / 1e6, BANDWIDTH / moved)
    return f"| {width}x{height}, {search} | {' | '.join(f'{cell:,.0f}' for cell in cells)} |"


def room(width: int, height: int) -> NDArray[np.float32]:
    """Return the depth (h, w) of a bent wall with a box [m]."""
    y, x = np.mgrid[:height, :width]
    depth = 1.5 + 0.3 * np.sin(6 * x / width) + 0.2 * y / height
    depth[height // 4 : height // 2, width // 3 : width // 2] = 0.7
    return depth.astype(np.float32)


def cpu_ms(run: Callable[[], object]) -> float:
    """Return the median CPU time of runs [ms]."""
    times = []
    for _ in range(REPEATS):
        started = time.process_time()
        run()
        times.append(1e3 * (time.process_time() - started))
    return float(np.median(times))


def peak_mb() -> float:
    """Return the largest resident set so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


if __name__ == "__main__":
    main()
