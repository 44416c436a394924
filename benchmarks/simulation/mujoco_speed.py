"""Time a depth camera in a moving MuJoCo model of 30 objects, and compare its truth.

CPU time of this process for each frame, with physics, beside `corrupt` alone on the same images.
Example: python benchmarks/simulation/mujoco_speed.py --frames 30
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from mujoco_scenes import CAMERAS, Table

import starling.mujoco
from starling.sim.corrupt import Corruptor
from starling.sim.mujoco.library import mujoco

SIZE = (640, 480)
STEPS = 16  # Physics steps of 2 ms between frames at 30 Hz.
OBJECTS = 30
FOV_Y_DEG = 58.2
_EDGE = 0.02  # Relative depth jump of an edge, which is left out with two pixels around it.


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=30)
    frames = parser.parse_args().frames
    print("| camera | what | CPU [ms], median of frames |")
    print("|---|---|---|")
    for camera in CAMERAS:
        for name, milliseconds in _times(camera, frames).items():
            print(f"| {camera} | {name} | {milliseconds:.0f} |")
    print("\n| camera | within 1 mm, all pixels [%] | off edges [%] | pixels off edges [%] |")
    print("|---|---|---|---|")
    for camera in CAMERAS:
        print(f"| {camera} | " + " | ".join(f"{value:.4g}" for value in _truth(camera)) + " |")


def _camera(table: Table, name: str, **options: Any) -> starling.mujoco.DepthCamera:
    return starling.mujoco.DepthCamera(table.model, name, "d435", size=SIZE, **options)


def _times(name: str, frames: int) -> dict[str, float]:
    table = Table(FOV_Y_DEG, objects=OBJECTS)
    step = mujoco().mj_step
    cameras = {
        "loop, warp": _camera(table, name),
        "loop, warp, 3 views": _camera(table, name, views=3),
        "loop, trace, draft": _camera(table, name, by="trace"),
    }
    table.data.qvel[:] = 0.3 * np.random.default_rng(0).standard_normal(table.model.nv)

    def loop(camera: starling.mujoco.DepthCamera) -> Callable[[], object]:
        def run() -> object:
            for _ in range(STEPS):
                step(table.model, table.data)
            return camera.read(table.data)

        return run

    reading = cameras["loop, warp"].read(table.data)
    corruptor = Corruptor(cameras["loop, warp"].sensor, cameras["loop, warp"].camera_matrix)
    clean = reading.true_depth_m
    colours = np.full((*clean.shape, 3), 128, np.uint8)
    times = {
        "corrupt alone": _median(lambda: corruptor(clean, reflectance=colours), frames),
        "physics alone": _median(
            lambda: [step(table.model, table.data) for _ in range(STEPS)], frames
        ),
    }
    return times | {key: _median(loop(camera), frames) for key, camera in cameras.items()}


def _median(call: Callable[[], object], frames: int) -> float:
    """Median CPU time [ms] of a call, after one that compiles."""
    call()
    spent = []
    for _ in range(frames):
        begin = time.process_time()
        call()
        spent.append(time.process_time() - begin)
    return 1e3 * float(np.median(spent))


def _truth(name: str) -> tuple[float, float, float]:
    """Shares [%] of pixels whose traced truth is within 1 mm of MuJoCo's depth."""
    table = Table(FOV_Y_DEG, objects=OBJECTS)
    drawn = _camera(table, name).read(table.data).true_depth_m
    traced = _camera(table, name, by="trace").read(table.data).true_depth_m
    known = np.isfinite(drawn) & np.isfinite(traced)
    near = np.abs(drawn - traced) < 1e-3
    far = np.nan_to_num(traced, nan=99.0)
    kernel = np.ones((5, 5))
    flat = known & (cv2.dilate(far, kernel) - cv2.erode(far, kernel) < _EDGE * far)
    return 100 * near[known].mean(), 100 * near[flat].mean(), 100 * flat.mean()


if __name__ == "__main__":
    main()
