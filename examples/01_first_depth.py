"""First depth: one scene, one sensor, and the reason of every pixel without depth.

The quality of a simulated camera is in its holes. This example prints the share of pixels with
depth, the depth error, and the reasons of missing depth.

Usage:
    python examples/01_first_depth.py
    python examples/01_first_depth.py clutter d415
"""

import sys

import numpy as np

from starling.sim import simulate
from starling.sim.reason import LABELS, Reason
from starling.sim.scene import sources
from starling.sim.sensor import presets


def main(scene_name: str = "tabletop", sensor_name: str = "d435") -> None:
    """Simulate one shot and print its depth statistics."""
    sensor = presets.load(sensor_name)
    scene = sources.load(scene_name, sensor)
    shot = simulate.simulate(scene, sensor, seed=0)

    depth = shot.depth
    print(f"{scene_name} as a {sensor_name} sees it, {sensor.width} x {sensor.height} pixels")
    print(f"  exposure {1e3 * shot.exposure_s:.1f} ms, mean level {shot.ir_left.mean():.0f} DN")

    error_m = (depth.depth_m - shot.layers.truth.depth_m)[depth.valid]
    print(f"  {depth.valid.mean():6.1%} have depth, median error {np.nanmedian(error_m):+.4f} m")
    for reason in Reason:
        share = float(np.mean(depth.reason == reason))
        if reason is not Reason.VALID and share > 0:
            print(f"  {share:6.1%} {LABELS[reason]}")


if __name__ == "__main__":
    main(*sys.argv[1:])
