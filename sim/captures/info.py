"""`capture.toml` of a capture set: device, geometry and origin."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import files, quantities
from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.sensor import scaling, structure
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import disparity_from_depth

FILE = "capture.toml"
OWN = "camera.toml"  # Same keys, for a single scene; it stands in the scene's folder.
_Row = tuple[float, float, float, float]

# Largest relative difference of focal lengths and baseline between calibrations of one device.
_SAME_LENGTH = 0.02
_ROUNDING = 1e-3  # Tolerance of the rotation of `colour_from_left`, which devices give rounded.
_SAME_CENTRE = 0.005  # Largest difference of the principal points, relative to the width.


@dataclass(frozen=True, kw_only=True, slots=True)
class CaptureInfo:
    """Geometry and origin of a capture set; the rectified pair shares one pinhole."""

    sensor: str  # Name of the device's preset: `d415`.
    width: int  # [px]
    height: int  # [px]
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    baseline_m: float
    depth_unit_m: float  # Step of the 16-bit depth images [m].
    source: str
    licence: str
    notes: str
    preset: str | None = None  # Name of the device's own settings: `High Accuracy`.
    projector: str | None = None  # State of the projector: `on`, its power, its pattern.
    black_level_dn: float | None = None  # Pedestal of the infrared images [DN].
    distortion: tuple[float, float, float, float, float] | None = None  # k1 k2 p1 p2 k3 (OpenCV)
    colour: Pinhole | None = None
    colour_from_left: tuple[_Row, _Row, _Row, _Row] | None = None  # Rigid transform [m].
    extra: Mapping[str, Any] = field(default_factory=dict)  # Other keys, preserved as they are.

    def __post_init__(self) -> None:
        Pinhole.from_camera(self)  # Validates the intrinsics.
        quantities.check("baseline_m", self.baseline_m, "baseline_m")
        quantities.check("depth_unit_m", self.depth_unit_m, "depth_unit_m")
        if self.black_level_dn is not None:
            errors.in_interval("black_level_dn", self.black_level_dn, 0.0, 65535.0)
        if self.colour_from_left is not None:
            pose = np.array(self.colour_from_left)
            frames.refuse_not_rigid("colour_from_left", pose, rounding=_ROUNDING)

    @property
    def shape(self) -> tuple[int, int]:
        """(h, w) of every image in the left infrared view."""
        return self.height, self.width

    @property
    def focal_baseline_px_m(self) -> float:
        """f b [px m]: disparity [px] times depth [m]."""
        return self.fx_px * self.baseline_m

    def disparity_px(self, depth_m: NDArray[np.floating]) -> NDArray[np.float32]:
        """Convert depth [m] in the left view to disparity [px], any shape; NaN where unknown."""
        return disparity_from_depth(depth_m, focal_px=self.fx_px, baseline_m=self.baseline_m)

    def are_of(self, camera: Sensor | CaptureInfo) -> bool:
        """Return whether a camera can be this one: equal size and nearly equal geometry."""
        centre = max(abs(self.cx_px - camera.cx_px), abs(self.cy_px - camera.cy_px))
        lengths = ("fx_px", "fy_px", "baseline_m")
        ratios = [getattr(camera, name) / getattr(self, name) for name in lengths]
        return (
            (camera.width, camera.height) == (self.width, self.height)
            and centre <= _SAME_CENTRE * self.width
            and all(abs(ratio - 1) <= _SAME_LENGTH for ratio in ratios)
        )

    def geometry_into(self, sensor: Sensor) -> Sensor:
        """Return a sensor with the image size, intrinsics and baseline of these captures.

        Images of another size show the middle of the imager in larger or smaller pixels. All that
        depends on the pixels follows, the nearest depth too (`starling.sim.sensor.scaling`).
        """
        if (sensor.width, sensor.height) != (self.width, self.height):
            ratio = self.fx_px / sensor.fx_px
            sensor = scaling.scaled(sensor, ratio, self.width, self.height)
        changes: dict[str, Any] = dataclasses.asdict(Pinhole.from_camera(self))
        changes["baseline_m"] = self.baseline_m
        if sensor.kind == "structured_light":  # Its projector is at the end of the baseline.
            place = (self.baseline_m, 0.0, 0.0)
            changes["projector"] = dataclasses.replace(sensor.projector, position_m=place)
        return dataclasses.replace(sensor, **changes)


def read(path: Path) -> CaptureInfo:
    """Read `capture.toml`.

    Raises:
        InputError: if the file is missing or no TOML, lacks a required key, or has an invalid
            value. Unknown keys are preserved in `extra`.
    """
    return files.read_toml(path, from_table)


def from_table(table: Mapping[str, Any]) -> CaptureInfo:
    """Build the info from a table; unknown keys go to `extra`."""
    known = {item.name for item in dataclasses.fields(CaptureInfo)} - {"extra"}
    info = structure.from_table(
        CaptureInfo, {key: value for key, value in table.items() if key in known}
    )
    extra = {key: value for key, value in table.items() if key not in known}
    return dataclasses.replace(info, extra=extra)


def dumps(info: CaptureInfo) -> str:
    """Format the info as TOML text that `read` reads without loss."""
    table = structure.to_table(info)
    extra = table.pop("extra", {})
    return tomli_w.dumps({**table, **extra})
