"""Laws that a depth camera obeys, measured on a simulated wall: bias, noise, and their growth.

Usage: python benchmarks/physics.py [--sensor d435]
"""

from __future__ import annotations

import argparse
import dataclasses

import numpy as np

from sim import render, sensors
from sim.depth import disparity_from_depth
from sim.layers import Layers
from sim.scenes import builtin
from sim.sensor import Sensor
from sim.simulate import expose
from sim.stage import Stage

DISTANCES_M = (0.5, 0.7, 1.0, 1.4, 2.0)
# Each distance stands for five around it: a matcher errs by the fraction of the disparity, and one
# fronto-parallel wall has one fraction only.
AROUND = (0.96, 0.98, 1.0, 1.02, 1.04)


def plane_rms_m(depth_m: np.ndarray) -> float:
    """RMS distance in z from the least-squares plane in disparity over the middle of the image.

    The plane is fitted to depth, as vendors do, on the central 40 % of columns and rows.
    """
    height, width = depth_m.shape
    rows, columns = np.mgrid[
        int(0.3 * height) : int(0.7 * height), int(0.3 * width) : int(0.7 * width)
    ]
    z = depth_m[rows, columns].ravel().astype(np.float64)
    known = np.isfinite(z)
    basis = np.stack([rows.ravel(), columns.ravel(), np.ones(z.size)], axis=1)[known]
    plane, *_ = np.linalg.lstsq(basis, z[known], rcond=None)
    return float(np.sqrt(np.mean((basis @ plane - z[known]) ** 2)))


def fixed(sensor: Sensor) -> Sensor:
    """The same sensor with auto exposure off."""
    left = dataclasses.replace(sensor.left, auto_exposure_level=0.0)
    right = dataclasses.replace(sensor.right, auto_exposure_level=0.0)
    return dataclasses.replace(sensor, left=left, right=right)


def exponent(values: dict[float, float]) -> float:
    """Slope of log(value) over log(distance)."""
    return float(np.polyfit(np.log(list(values)), np.log(list(values.values())), 1)[0])


def growth(sensor: Sensor, layers: dict[float, list[Layers]]) -> dict[float, float]:
    """Plane-fit RMS [m] by distance [m], over the walls around each distance."""
    return {
        distance: float(
            np.sqrt(np.mean([plane_rms_m(expose(one, sensor).depth.depth_m) ** 2 for one in seen]))
        )
        for distance, seen in layers.items()
    }


def bias_curve(sensor: Sensor, stage_of, steps: int = 16) -> dict[float, float]:
    """Mean disparity error [px] against the fraction of the true disparity, without noise."""
    curve = {}
    for step in range(steps):
        disparity = 20 + step / steps
        seen = render.layers(stage_of(sensor.focal_baseline_px_m / disparity), sensor)
        depth = expose(seen, sensor).depth
        truth = disparity_from_depth(
            seen.truth.depth_m, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m
        )
        curve[step / steps] = float(np.nanmean((depth.disparity_px - truth)[60:-60, 100:-100]))
    return curve


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sensor", default="d435")
    sensor = sensors.load(parser.parse_args().sensor)
    layers = {
        z: [render.layers(Stage(builtin.wall(z * near)), sensor) for near in AROUND]
        for z in DISTANCES_M
    }
    for name, chosen in (("auto exposure", sensor), ("fixed exposure", fixed(sensor))):
        rms = growth(chosen, layers)
        listed = ", ".join(f"{z:g} m {1e3 * value:.2f} mm" for z, value in rms.items())
        print(f"plane-fit RMS, {name}: {listed}; exponent {exponent(rms):.2f}")
    curve = bias_curve(sensor, lambda z: Stage(builtin.wall(z)))
    worst = max(curve.values(), key=abs)
    print("bias [px] by fraction of disparity:", {k: round(v, 4) for k, v in curve.items()})
    print(f"mean bias {np.mean(list(curve.values())):+.4f} px, largest {worst:+.4f} px")


if __name__ == "__main__":
    main()
