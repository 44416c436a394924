"""New camera: design a depth camera by its parameters.

Changes the baseline and the field of view of a D435. For each camera it prints the depth noise on a
wall, the noise predicted by z^2 / (f b), and the share of pixels without depth.

Usage:
    python examples/02_new_camera.py
    python examples/02_new_camera.py new_camera.png
"""

import sys
from pathlib import Path

from starling.sim.commands.sweep import picture as sweep_picture
from starling.sim.commands.sweep import sweep
from starling.sim.sensor import presets

AXES = {"baseline_m": [0.1], "focal_px": [800.0]}


def main(picture: str = "") -> None:
    """Print a line for each camera and distance; draw the curves if a file is named."""
    result = sweep.sweep(presets.load("d435"), AXES, distances_m=[1, 3])
    print(f"law: z^2 / (f b) times {result.sigma_d_px:.3f} px, the D435's own at 1 m\n")
    print(f"{'camera':20}{'z m':>5}{'noise mm':>10}{'law mm':>8}{'ratio':>7}{'holes':>7}")
    for camera in result.cameras:
        rows = zip(result.distances_m, result.figures_of(camera), result.law_m(camera), strict=True)
        for distance_m, measured, law_m in rows:
            noise_mm, law_mm = 1e3 * measured.noise_m, 1e3 * law_m
            print(
                f"{result.name(camera):20}{distance_m:5g}{noise_mm:10.2f}{law_mm:8.2f}"
                f"{noise_mm / law_mm:7.2f}{measured.hole_rate:7.1%}"
            )
    if picture:
        Path(picture).write_bytes(sweep_picture.draw(result))


if __name__ == "__main__":
    main(*sys.argv[1:])
