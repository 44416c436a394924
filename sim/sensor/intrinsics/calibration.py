"""The calibration of a device, as its own program writes it, and a sensor with it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim import quantities
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.sensor import edits
from starling.sim.sensor.sensor import Sensor

# Largest factor between a device's number and that of the sensor it replaces. Devices differ less,
# and units of length by 10 and more.
_FACTOR = 5.0
_STRETCH = 1.25  # Largest ratio of the focal lengths of one camera; those of devices are near 1.
_ASIDE = 0.1  # Largest offset of a camera across the baseline, as a share of it.
_KEYS = ("width", "height", "fx_px", "fy_px", "cx_px", "cy_px")


@dataclass(frozen=True, kw_only=True, slots=True)
class DeviceCalibration:
    """Intrinsics of a rectified pair by image size or of its imager, and its baseline."""

    path: Path
    cameras: tuple[Pinhole, ...]  # One of each size.
    field_deg: float | None = None  # Full horizontal field of the imager, where sizes are unknown.
    imager: Pinhole | None = None  # All columns of the imager; other sizes follow from them.
    baseline_m: float | None = None

    def __post_init__(self) -> None:
        for camera in (*self.cameras, *filter(None, [self.imager])):
            _refuse_implausible(camera, self.path)
        if self.field_deg is not None:
            errors.in_interval(f"hfov in {self.path}", self.field_deg, 1.0, 179.0, "Give degrees.")
        if self.baseline_m is not None:
            quantities.check(f"baseline in {self.path} [m]", self.baseline_m, "baseline_m")

    @property
    def sizes(self) -> tuple[str, ...]:
        """Image sizes, as modes are named."""
        return tuple(f"{camera.width}x{camera.height}" for camera in self.cameras)

    def camera(self, width: int, height: int, *, cut: float = 1.0) -> Pinhole:
        """Return the intrinsics of an image size.

        Args:
            width: width of the image [px].
            height: height of the image [px].
            cut: columns of the whole imager over those of the image, in equal pixels.

        Raises:
            InputError: if the calibration has other sizes only.
        """
        if self.imager is not None:
            return _scaled(self.imager, width, height, width * cut / self.imager.width)
        if self.field_deg is not None:
            focal_px = width * cut / 2 / math.tan(math.radians(self.field_deg) / 2)
            centre = {"cx_px": (width - 1) / 2, "cy_px": (height - 1) / 2}
            return Pinhole(width=width, height=height, fx_px=focal_px, fy_px=focal_px, **centre)
        for camera in self.cameras:
            if (camera.width, camera.height) == (width, height):
                return camera
        rule = f"must have the image size {width}x{height}"
        advice = "Choose a mode of that size, or give width and height."
        raise errors.refuse(f"camera_matrix in {self.path}", rule, ", ".join(self.sizes), advice)


def _scaled(imager: Pinhole, width: int, height: int, ratio: float) -> Pinhole:
    """Return the middle of an image at `ratio` new pixels per pixel, as a mode shows it."""
    return Pinhole(
        width=width,
        height=height,
        fx_px=imager.fx_px * ratio,
        fy_px=imager.fy_px * ratio,
        cx_px=(width - 1) / 2 + ratio * (imager.cx_px - (imager.width - 1) / 2),
        cy_px=(height - 1) / 2 + ratio * (imager.cy_px - (imager.height - 1) / 2),
    )


def with_calibration(sensor: Sensor, calibration: DeviceCalibration, *, cut: float = 1.0) -> Sensor:
    """Return a sensor with a device's intrinsics at the sensor's image size, and its baseline.

    Args:
        sensor: sensor to change.
        calibration: calibration of the device.
        cut: as for `DeviceCalibration.camera`.

    Raises:
        InputError: if the calibration has no such size. Also if its numbers differ from the
            sensor's by more than a factor of 5, as numbers in other units do.
    """
    camera = calibration.camera(sensor.width, sensor.height, cut=cut)
    _refuse_far(f"focal length in {calibration.path} [px]", camera.fx_px, sensor.fx_px)
    values: dict[str, Any] = {key: getattr(camera, key) for key in _KEYS}
    if calibration.baseline_m is not None:
        name = f"baseline in {calibration.path} [m]"
        _refuse_far(name, calibration.baseline_m, sensor.baseline_m)
        values["baseline_m"] = calibration.baseline_m
        if sensor.kind == "structured_light":  # Its projector is at the end of the baseline.
            values["projector.position_m"] = [calibration.baseline_m, 0.0, 0.0]
    return edits.with_values(sensor, values.items())


def with_keys(calibration: DeviceCalibration, keys: Mapping[str, Any]) -> dict[str, Any]:
    """Add the intrinsics to the keys of a sensor file without a base; the file's own keys win.

    Raises:
        InputError: if the image size is unknown, or the calibration has others only.
    """
    sole = calibration.cameras[0] if len(calibration.cameras) == 1 else calibration.imager
    width = keys.get("width", sole.width if sole else None)
    height = keys.get("height", sole.height if sole else None)
    if type(width) is not int or type(height) is not int:  # A truth value is no number.
        got = ", ".join(calibration.sizes) or "no size"
        advice = "Give whole numbers of pixels."
        raise errors.refuse("width and height", "must be given with camera_matrix", got, advice)
    camera = calibration.camera(width, height)
    result = {key: getattr(camera, key) for key in _KEYS}
    if calibration.baseline_m is not None:
        result["baseline_m"] = calibration.baseline_m
    return {**result, **keys}


def baseline_of(right_m: tuple[float, float, float], name: str) -> float:
    """Return the baseline [m] of a rectified pair.

    Args:
        right_m: translation [m] that takes a point from the left camera's frame to the right one's:
            (-baseline, 0, 0).
        name: name of the numbers for messages.

    Raises:
        InputError: if the cameras do not lie side by side.
    """
    x, y, z = right_m
    if not math.hypot(y, z) <= _ASIDE * abs(x):
        rule, got = "must lie along x", f"{x:g}, {y:g}, {z:g} m"
        raise errors.refuse(name, rule, got, "Only horizontal pairs are modelled.")
    if x > 0:
        warnings.warn(
            f"{name}: the right camera lies left of the left one, by {x:g} m. Are they exchanged? "
            "The distance alone is used.",
            stacklevel=2,
        )
    return math.hypot(x, y, z)


def _refuse_implausible(camera: Pinhole, path: Path) -> None:
    """Refuse pixels that are not nearly square, and a principal point outside the image."""
    ratio, advice = camera.fy_px / camera.fx_px, "Is a number in the wrong place?"
    size = f"{camera.width}x{camera.height} in {path}"
    errors.in_interval(f"fy / fx of {size}", ratio, 1 / _STRETCH, _STRETCH, advice)
    for axis, place, side in (
        ("cx", camera.cx_px, camera.width),
        ("cy", camera.cy_px, camera.height),
    ):
        errors.in_interval(f"{axis} of {size}", place, 0.0, side - 1.0, advice)


def _refuse_far(name: str, value: float, usual: float) -> None:
    low, high = usual / _FACTOR, usual * _FACTOR
    if not low <= value <= high:
        rule = f"must be in [{low:.4g}, {high:.4g}], near the sensor's {usual:.4g}"
        raise errors.refuse(name, rule, f"{value:.6g}", "Is it of this camera, in these units?")
