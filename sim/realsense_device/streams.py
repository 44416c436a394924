"""Streams of librealsense for the cameras of a sensor: intrinsics, extrinsics, formats."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.geometry import frames
from starling.sim.realsense_device.device_images import DeviceImages
from starling.sim.realsense_device.library import rs
from starling.sim.sensor.sensor import Colour, Sensor

FORMATS = {  # Pixel type to format and bytes of a pixel.
    "depth": (rs.format.z16, 2),
    "uint8": (rs.format.y8, 1),
    "uint16": (rs.format.y16, 2),
    "colour": (rs.format.rgb8, 3),
}


def add_streams(stereo: Any, colour: Any, images: DeviceImages, sensor: Sensor, fps: int) -> Any:
    """Add the streams that `images` has to the device's sensors, with their extrinsics.

    Depth is in the left imager's image, as in a D400.

    Args:
        stereo: the device's sensor of depth and infrared.
        colour: the device's sensor of colour; None without a colour image.
        images: the first images.
        sensor: their camera.
        fps: frames a second.

    Returns:
        Stream profiles by the name of the image in `DeviceImages`.
    """
    infrared = FORMATS[str(images.ir_left.dtype)][0]
    left_right = [("ir_left", rs.stream.infrared, 1, infrared)]
    if images.ir_right is not None:
        left_right.append(("ir_right", rs.stream.infrared, 2, infrared))
    profiles = {
        name: _add(stereo, kind, index, form, sensor, fps)
        for name, kind, index, form in [
            ("depth_u16", rs.stream.depth, 0, rs.format.z16),
            *left_right,
        ]
    }
    profiles["depth_u16"].register_extrinsics_to(profiles["ir_left"], _extrinsics(np.eye(4)))
    if "ir_right" in profiles:
        pose = np.linalg.inv(frames.right_of(np.eye(4), sensor.baseline_m))
        profiles["depth_u16"].register_extrinsics_to(profiles["ir_right"], _extrinsics(pose))
    if colour is not None and sensor.colour is not None:
        camera = sensor.colour
        stream = _add(colour, rs.stream.color, 0, rs.format.rgb8, camera, fps)
        pose = np.linalg.inv(frames.pose(camera.position_m, camera.rotation_deg))
        profiles["depth_u16"].register_extrinsics_to(stream, _extrinsics(pose))
        profiles["colour"] = stream
    return profiles


def _add(device: Any, kind: Any, index: int, form: Any, camera: Sensor | Colour, fps: int) -> Any:
    stream = rs.video_stream()
    stream.type, stream.index, stream.fmt, stream.fps = kind, index, form, fps
    stream.uid = 10 * int(kind) + index
    stream.width, stream.height = camera.width, camera.height
    stream.bpp = next(count for known, count in FORMATS.values() if known == form)
    stream.intrinsics = intrinsics(camera)
    return device.add_video_stream(stream, True).as_video_stream_profile()


def intrinsics(camera: Sensor | Colour) -> Any:
    """Return the intrinsics of a camera; both count pixels from the first pixel's centre."""
    values = rs.intrinsics()
    values.width, values.height = camera.width, camera.height
    values.fx, values.fy = camera.fx_px, camera.fy_px
    values.ppx, values.ppy = camera.cx_px, camera.cy_px
    values.model, values.coeffs = rs.distortion.brown_conrady, [0.0] * 5
    return values


def _extrinsics(pose: NDArray[np.floating]) -> Any:
    """Extrinsics of a pose (4, 4) that maps points of one camera to another."""
    values = rs.extrinsics()
    values.rotation = pose[:3, :3].T.ravel().tolist()  # librealsense stores columns.
    values.translation = pose[:3, 3].tolist()
    return values
