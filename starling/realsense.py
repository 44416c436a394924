"""Readings through librealsense, for programs that use `pyrealsense2`; needs `realsense`.

Examples:
    >>> import pyrealsense2 as rs, starling.realsense
    >>> with starling.realsense.virtual_device("d435", readings) as device:
    ...     pipeline = rs.pipeline(device.context)
    ...     profile = pipeline.start()
    ...     depth = pipeline.wait_for_frames().get_depth_frame()
    >>> depth.get_distance(320, 240)
    1.002
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from starling.sim.realsense_device.device_images import DeviceImages as DeviceImages
from starling.sim.realsense_device.virtual_device import VirtualDevice as VirtualDevice
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

__all__ = ["DeviceImages", "VirtualDevice", "virtual_device"]


def virtual_device(
    sensor: Sensor | Path | str, readings: Iterable[object], *, fps: int = 30
) -> VirtualDevice:
    """Serve readings as a software device of librealsense.

    Frames have intrinsics, extrinsics, times, numbers, exposure, gain and laser power. Filters,
    `align`, `pointcloud`, syncers, queues and the pipeline of `pyrealsense2` take them as those of
    a device. Options are read-only, because readings exist already.

    Args:
        sensor: camera of the readings, or its name as for `starling.load_sensor`.
        readings: `starling.Reading`, `starling.Shot` or `DeviceImages`, which can have colour. They
            are taken one by one, so a generator can simulate them.
        fps: frames a second of the streams and of their times.

    Raises:
        InputError: unknown sensor, no reading, or images that are not the sensor's. On import:
            `pyrealsense2` is not installed or cannot be loaded.
    """
    return VirtualDevice(presets.resolved(sensor), readings, fps)
