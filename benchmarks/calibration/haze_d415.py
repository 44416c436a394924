"""Measure the projector light between the dots of a real D415, from emitter-on minus -off images.

For each object on the table, the script prints the mean of the projector's light and its 20th
percentile, which lies between dots. Usage:
    STARLING_CAPTURES=... python benchmarks/calibration/haze_d415.py
"""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np

from starling.sim.captures import capture

THINGS = {4: "can", 11: "cube", 12: "sharpener", 13: "bottle", 17: "table"}
INSIDE_PX = 9  # Side of the erosion window that excludes object edges.
NOISE_PX = 0.8  # Sigma of the smoothing; it reduces noise and keeps dots.


def main() -> None:
    """Print the mean light and the light between dots."""
    (scene,) = capture.open_set(Path(os.environ["STARLING_CAPTURES"]) / "d415-table").scenes
    read = scene.frame(0)
    on, off = (np.asarray(image, np.float32) for image in (read.ir_left, read.ir_left_off))
    light = cv2.GaussianBlur(on - off, (0, 0), NOISE_PX)
    labels = cv2.imread(str(scene.path / "label.png"), cv2.IMREAD_UNCHANGED)
    for label, name in THINGS.items():
        inside = cv2.erode((labels == label).astype(np.uint8), np.ones((INSIDE_PX, INSIDE_PX))) > 0
        mean, between = light[inside].mean(), np.percentile(light[inside], 20)
        print(f"{name:10s} mean {mean:5.2f} DN, between {between:5.2f} DN: {between / mean:.2f}")


if __name__ == "__main__":
    main()
