"""A D435 at the wrist of an arm in MuJoCo: depth and its reasons, as a short video.

Writes `bin.avi`: infrared, depth, and the pixels without depth by reason.
Needs the extra `mujoco`.

Usage:
    python examples/10_mujoco.py
"""

# pyright: reportAttributeAccessIssue=false
# The types of MuJoCo are in its compiled modules.
from pathlib import Path

import cv2
import mujoco
import numpy as np

import starling.mujoco

MODEL = Path(__file__).with_name("bin.xml")
FRAMES, RATE_HZ = 12, 15
FARTHEST_M = 1.2


def picture(reading: starling.Reading) -> np.ndarray:
    """Draw a reading as (h, 3 w, 3) bytes: blue, green, red."""
    infrared = cv2.cvtColor(reading.ir_left.astype(np.uint8), cv2.COLOR_GRAY2BGR)
    level = np.nan_to_num(reading.depth_m) / FARTHEST_M
    depth = cv2.applyColorMap((255 * level.clip(0, 1)).astype(np.uint8), cv2.COLORMAP_TURBO)
    reasons = cv2.applyColorMap((17 * reading.reason).astype(np.uint8), cv2.COLORMAP_HSV)
    depth[reading.reason > 0] = 0
    reasons[reading.reason == 0] = 0
    return np.hstack([infrared, depth, reasons])


def main() -> None:
    """Let objects fall into the bin while the arm swings, and film it."""
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    data = mujoco.MjData(model)
    camera = starling.mujoco.DepthCamera(model, "wrist", "d435", by="trace")
    height, width = camera.sensor.height, camera.sensor.width
    size = (3 * width, height)
    film = cv2.VideoWriter("bin.avi", cv2.VideoWriter.fourcc(*"MJPG"), RATE_HZ, size)
    for frame in range(FRAMES):
        data.ctrl[:] = 0.15 * np.sin(frame / 4), 0.1, 0.05
        while data.time < frame / RATE_HZ:
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        reading = camera.read(data)
        film.write(picture(reading))
        print(f"{data.time:.2f} s: {np.isfinite(reading.depth_m).mean():.1%} with depth")
    film.release()


if __name__ == "__main__":
    main()
