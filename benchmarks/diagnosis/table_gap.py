"""Compare the real table of objects with its simulation: holes, dots, mirror ball.

Usage: python benchmarks/diagnosis/table_gap.py $STARLING_CAPTURES/d415-table
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import cv2
import numpy as np

from starling.sim.captures import capture
from starling.sim.commands.compare import dot_contrast
from starling.sim.metrics import hole_overlap, reached_pixels
from starling.sim.scene import sources
from starling.sim.sensor import resolve
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import simulate
from starling.sim.stereo.depth import disparity_from_depth
from starling.sim.stereo.measurement import measure

BALL = 7  # Label of the mirror ball.


def hole_rate(depth_m: np.ndarray, where: np.ndarray) -> float:
    """Return the share of pixels without depth."""
    return float(np.isnan(depth_m[where]).mean())


def bounds(depth_m: np.ndarray) -> np.ndarray:
    """Return a mask (h, w) of the rows and columns that are mostly filled."""
    known = np.isfinite(depth_m)
    rows, columns = known.mean(axis=1) > 0.5, known.mean(axis=0) > 0.5
    return rows[:, None] & columns[None, :]


def report(name: str, real: np.ndarray, sim: np.ndarray, where: np.ndarray) -> None:
    """Print the hole rates of real and simulated depth, and their overlap."""
    overlap = hole_overlap(real, sim, where)
    print(
        f"{name}: no depth {hole_rate(real, where):.2%} real, "
        f"{hole_rate(sim, where):.2%} simulated, IoU {overlap:.3f}"
    )


def ball(name: str, depth_m: np.ndarray, truth_m: np.ndarray, where: np.ndarray) -> None:
    """Print the filled share of the ball and its median depth error."""
    error_mm = 1e3 * (depth_m - truth_m)[where]
    print(
        f"  {name}: ball filled to {1 - hole_rate(depth_m, where):.1%}, median "
        f"{np.nanmedian(error_mm):+.1f} mm"
    )


def infrared(name: str, real: np.ndarray, sim: np.ndarray, black_dn: float) -> None:
    """Print mean level and dot contrast of real and simulated images."""
    print(
        f"  {name}: mean {real.mean():.1f} real, {sim.mean():.1f} DN simulated; dot contrast "
        f"{dot_contrast(real, black_dn):.3f} real, {dot_contrast(sim, black_dn):.3f} simulated"
    )


def without_projector(sensor: Sensor) -> Sensor:
    """Return the same sensor with its projector off."""
    return dataclasses.replace(sensor, projector=dataclasses.replace(sensor.projector, power_w=0.0))


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", type=Path)
    folder = parser.parse_args().captures
    sensor = resolve.load("d415", captures=str(folder))
    real = capture.open_set(folder).scenes[0]
    frame, truth = real.frame(0), real.truth_m()
    label = cv2.imread(str(real.path / "label.png"), cv2.IMREAD_UNCHANGED)
    disparity = disparity_from_depth(truth, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m)
    # The border of the device's depth is empty in the data set.
    where, on_ball = reached_pixels(disparity) & bounds(frame.depth_m), label == BALL
    scene = sources.load(str(real.path), sensor)
    black = sensor.left.black_level_dn

    shot = simulate(scene, sensor)
    report("projector on", frame.depth_m, shot.depth.depth_m, where)
    infrared("infrared", frame.ir_left, shot.ir_left, black)
    ball("device", frame.depth_m, truth, on_ball)
    ball("simulated", shot.depth.depth_m, truth, on_ball)

    dark = without_projector(sensor)
    seen = measure(frame.ir_left_off, frame.ir_right_off, dark, causes={})
    shot = simulate(scene, dark)
    report("projector off, our matcher on both", seen.depth_m, shot.depth.depth_m, where)
    infrared("infrared", frame.ir_left_off, shot.ir_left, black)


if __name__ == "__main__":
    main()
