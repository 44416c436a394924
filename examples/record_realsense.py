"""Record repeated frames of a static scene with a RealSense, as a capture set.

Needs a camera and `pip install pyrealsense2`. Exposure and gain keep their settings. Host filters
are not applied. Reference depth (`truth.png`) must come from another source.

Usage:
    python examples/record_realsense.py OUT SCENE ROOM
"""

# pyright: reportAttributeAccessIssue=false
# The types of pyrealsense2 are in its compiled module.
import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pyrealsense2 as rs  # pyright: ignore[reportMissingImports]

WIDTH, HEIGHT, FPS, REPEATS, SETTLE = 1280, 720, 15, 8, 15


def main(out: str, scene: str, room: str) -> None:
    """Record frames with the projector on and off, and write them."""
    pipeline, config = rs.pipeline(), rs.config()
    for side in (1, 2):
        config.enable_stream(rs.stream.infrared, side, WIDTH, HEIGHT, rs.format.y8, FPS)
    config.enable_stream(rs.stream.depth, WIDTH, HEIGHT, rs.format.z16, FPS)
    profile = pipeline.start(config)
    sensor = profile.get_device().first_depth_sensor()
    sensor.set_option(rs.option.enable_auto_exposure, 0)
    folder = Path(out, scene)
    folder.mkdir(parents=True)
    (folder / "room").write_text(room + "\n")
    (folder.parent / "capture.toml").write_text(geometry(profile, sensor.get_depth_scale()))
    for suffix, emitter in (("", 1), ("_off", 0)):
        sensor.set_option(rs.option.emitter_enabled, emitter)
        for number in range(-SETTLE, REPEATS):
            frames = pipeline.wait_for_frames()
            if number < 0:
                continue
            place = folder / str(number)
            place.mkdir(exist_ok=True)
            for side, name in ((1, "left"), (2, "right")):
                image = np.asarray(frames.get_infrared_frame(side).get_data())
                cv2.imwrite(str(place / f"ir_{name}{suffix}.png"), image)
            if emitter:
                depth = np.asarray(frames.get_depth_frame().get_data())
                cv2.imwrite(str(place / "depth.png"), depth)
                (place / "frame.json").write_text(json.dumps(settings(sensor)))
    pipeline.stop()


def settings(sensor: rs.sensor) -> dict[str, float]:
    """Return exposure, gain (16 of the device is 1) and laser power."""
    option, get = rs.option, sensor.get_option
    exposure_s, gain = get(option.exposure) / 1e6, get(option.gain) / 16
    return {"exposure_s": exposure_s, "gain": gain, "laser_power": get(option.laser_power)}


def geometry(profile: rs.pipeline_profile, unit_m: float) -> str:
    """Return `capture.toml` of the rectified infrared pair, with RealSense's pixel coordinates."""
    left, right = (profile.get_stream(rs.stream.infrared, side) for side in (1, 2))
    pinhole = left.as_video_stream_profile().get_intrinsics()
    name = profile.get_device().get_info(rs.camera_info.name).split()[-1].lower()
    numbers = {
        **{"width": WIDTH, "height": HEIGHT, "fx_px": pinhole.fx, "fy_px": pinhole.fy},
        **{"cx_px": pinhole.ppx, "cy_px": pinhole.ppy, "depth_unit_m": unit_m},
        "baseline_m": abs(left.get_extrinsics_to(right).translation[0]),
    }
    words = {"sensor": name, "source": "own", "licence": "private", "notes": ""}
    lines = [f"{key} = {json.dumps(value)}" for key, value in (words | numbers).items()]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main(*sys.argv[1:])
