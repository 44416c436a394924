"""Real depth in your simulator: a clean depth image becomes what a D435 would return.

The depth image here is a box before a wall, in place of your renderer's. The loop passes `history`
on, so that a temporal filter of the sensor would work.

Usage:
    python examples/09_your_simulator.py
"""

import numpy as np

import starling

CAMERA_MATRIX = np.array([[600.0, 0, 319.5], [0, 600.0, 239.5], [0, 0, 1]])


def rendered(frame: int) -> np.ndarray:
    """Return a depth image (h, w) [m] of a box that approaches."""
    depth_m = np.full((480, 640), 1.6, np.float32)
    depth_m[160:340, 220:420] = 1.0 - 0.02 * frame
    return depth_m


def main() -> None:
    """Corrupt three frames and print why depth is missing."""
    sensor = starling.load_sensor("d435", camera_matrix=CAMERA_MATRIX, size=(640, 480))
    camera = starling.Corruptor(sensor, CAMERA_MATRIX)
    camera.warm((480, 640))
    history = None
    for frame in range(3):
        reading = camera(rendered(frame), frame=frame, past=history)
        history = reading.history
        shares = {
            reason.name.lower(): float(np.mean(reading.reason == reason))
            for reason in starling.Reason
        }
        listed = ", ".join(f"{name} {share:.1%}" for name, share in shares.items() if share)
        print(f"frame {frame}: {listed}")


if __name__ == "__main__":
    main()
