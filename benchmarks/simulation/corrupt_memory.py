"""Measure the memory of one `Corruptor` over thousands of frames.

A box moves before a wall, so every frame has another depth image and range of disparities. The
growth of the process's resident memory is counted from the first mark on.

Usage:
    python benchmarks/simulation/corrupt_memory.py [--frames 5000] [--from 500]
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import starling

WIDTH, HEIGHT = 160, 120
FOCAL_PX = 108.0
MATRIX = np.array([[FOCAL_PX, 0, WIDTH / 2 - 0.5], [0, FOCAL_PX, HEIGHT / 2 - 0.5], [0, 0, 1]])
TARGET_PCT = 1.0
MARKS = 10  # Rows printed.


def main() -> None:
    """Print resident memory by frame, and its growth."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--frames", type=int, default=5000)
    parser.add_argument("--from", dest="first", type=int, default=500)
    options = parser.parse_args()
    sensor = starling.load_sensor("d435", camera_matrix=MATRIX, size=(WIDTH, HEIGHT))
    camera = starling.Corruptor(sensor, MATRIX)
    memory_mb = {}
    print("| frame | resident memory [MB] |\n|---|---|")
    for frame in range(1, options.frames + 1):
        camera(depth(frame), frame=frame)
        if frame == options.first or frame % (options.frames // MARKS) == 0:
            memory_mb[frame] = resident_mb()
            print(f"| {frame} | {memory_mb[frame]:.1f} |", flush=True)
    first, last = memory_mb[options.first], memory_mb[options.frames]
    growth_pct = 100 * (last / first - 1)
    verdict = "reached" if growth_pct <= TARGET_PCT else "missed"
    print(f"growth {growth_pct:.2f} % (target <= {TARGET_PCT:g} %: {verdict})")


def depth(frame: int) -> NDArray[np.float32]:
    """Depth (h, w) of a wall and a box that moves [m]."""
    image = np.full((HEIGHT, WIDTH), 2.0, np.float32)
    top, left = frame % (HEIGHT // 2), 7 * frame % (WIDTH // 2)
    image[top : top + HEIGHT // 2, left : left + WIDTH // 3] = 0.6 + 0.5 * (frame % 97) / 97
    return image


def resident_mb() -> float:
    """Resident memory of this process [MB] (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


if __name__ == "__main__":
    main()
