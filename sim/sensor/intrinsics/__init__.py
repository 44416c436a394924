"""Calibrations of real devices: librealsense text, ROS camera_info, depthai JSON."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from starling.patterns import errors
from starling.sim import files
from starling.sim.sensor.intrinsics import camera_info, depthai_board, depthai_eeprom, librealsense
from starling.sim.sensor.intrinsics.calibration import DeviceCalibration as DeviceCalibration
from starling.sim.sensor.intrinsics.calibration import with_calibration as with_calibration
from starling.sim.sensor.intrinsics.calibration import with_keys as with_keys


def read(path: Path) -> DeviceCalibration:
    """Read the calibration of a device; the content decides on the format.

    Args:
        path: output of `rs-enumerate-devices -c`, a `camera_info` in YAML or JSON, or a board or
            calibration file of depthai in JSON.

    Raises:
        InputError: for an unreadable file, another format, or implausible numbers.
    """
    data = files.read_bytes(path)
    if path.suffix.lower() == ".json":
        table = files.parse_json(data, path)
        if camera_info.is_table(table):
            return camera_info.from_table(table, path)
        if isinstance(table, Mapping) and depthai_eeprom.CAMERAS in table:
            return depthai_eeprom.parse(table, path)
        return depthai_board.parse(table, path)
    text = files.decode(data, path)
    if librealsense.is_listing(text):
        return librealsense.parse(text, path)
    if camera_info.is_message(text):
        return camera_info.parse(text, path)
    raise errors.refuse(
        "camera_matrix",
        "must be output of rs-enumerate-devices -c, a camera_info or JSON of depthai",
        path,
        "Give such a file, or width, height, fx_px, fy_px, cx_px and cy_px.",
    )
