"""The parameters that a geometry fit may free, in named groups."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from starling.patterns import errors
from starling.sim.sensor import edits
from starling.sim.sensor.sensor import Sensor

FIELD = "projector.field"  # Tangent of the projector's half horizontal field.
DOT_BLUR = "projector.dot_blur_mrad"


@dataclass(frozen=True, kw_only=True, slots=True)
class CalibrationParameter:
    """One parameter that a geometry fit may free."""

    name: str  # A dotted path in the sensor, except `projector.field`.
    group: str  # Name of the group on the command line (`--free`).
    unit: str
    tolerance: float  # Prior standard deviation of a device from its data sheet.


# Tolerances without a source are assumptions. They regularise parameters that the captures do not
# determine, and mark them as unidentifiable. They do not affect well-determined parameters.
TABLE = tuple(
    CalibrationParameter(name=name, group=group, unit=unit, tolerance=tolerance)
    for name, group, unit, tolerance in (
        ("baseline_m", "baseline", "m", 3e-3),
        ("right.alignment.offset_y_px", "alignment", "px", 2.0),
        ("right.alignment.roll_deg", "alignment", "deg", 0.3),
        ("right.alignment.pitch_deg", "alignment", "deg", 0.3),
        ("right.alignment.yaw_deg", "alignment", "deg", 0.3),
        ("fx_px", "focal", "px", 0.01),  # Times the focal length.
        ("cx_px", "centre", "px", 10.0),
        ("cy_px", "centre", "px", 10.0),
        *((f"projector.position_m.{axis}", "projector", "m", 5e-3) for axis in "xyz"),
        *((f"projector.rotation_deg.{axis}", "projector", "deg", 1.0) for axis in "xyz"),
        (FIELD, "field", "1", 0.02),  # Times the tangent.
        ("projector.pattern_scale", "scale", "1", 3e-3),
        (DOT_BLUR, "dots", "mrad", 1.5),
    )
)
GEOMETRY = tuple(dict.fromkeys(row.group for row in TABLE))  # The groups.
_RELATIVE = ("fx_px", FIELD)  # Their tolerance is a share of the value.


def free(groups: Iterable[str], sensor: Sensor) -> tuple[CalibrationParameter, ...]:
    """Return the parameters of geometry groups, with tolerances in their units.

    Args:
        groups: names in `GEOMETRY`.
        sensor: sensor whose parameters are freed.

    Raises:
        InputError: if a group is unknown, no group is named, or `field` is named although the
            pattern is generated to fill the field.
    """
    names = tuple(groups)
    for group in names:
        errors.one_of("free", group, GEOMETRY)
    if not names:
        raise errors.refuse(
            "free", "must name a group", "none", f"There are: {', '.join(GEOMETRY)}."
        )
    if "field" in names and not _is_image(sensor):
        raise errors.refuse(
            "free",
            "must not hold field where the pattern is generated to fill it",
            sensor.projector.pattern,
            "Free scale instead, or give the pattern as an image.",
        )
    rows = [row for row in TABLE if row.group in names]
    return tuple(
        dataclasses.replace(row, tolerance=row.tolerance * value(sensor, row.name))
        if row.name in _RELATIVE
        else row
        for row in rows
    )


def value(sensor: Sensor, name: str) -> float:
    """Return the value of a parameter of a sensor."""
    if name == FIELD:
        return math.tan(math.radians(sensor.projector.fov_x_deg / 2))
    node: object = sensor
    for part in name.split("."):
        node = node["xyz".index(part)] if isinstance(node, tuple) else getattr(node, part)
    assert isinstance(node, (int, float))
    return float(node)


def with_values(sensor: Sensor, values: Iterable[tuple[str, float]]) -> Sensor:
    """Set parameters. fy_px keeps its ratio to fx_px, and the field's height to its width.

    Raises:
        InputError: if a value is outside its valid range.
    """
    changes: list[tuple[str, float]] = []
    for name, number in values:
        if name == "fx_px":
            changes += [("fx_px", number), ("fy_px", number * sensor.fy_px / sensor.fx_px)]
        elif name == FIELD:
            ratio = number / value(sensor, FIELD)
            for axis, degrees in (
                ("x", sensor.projector.fov_x_deg),
                ("y", sensor.projector.fov_y_deg),
            ):
                tangent = math.tan(math.radians(degrees / 2)) * ratio
                changes.append((f"projector.fov_{axis}_deg", 2 * math.degrees(math.atan(tangent))))
        else:
            changes.append((name, number))
    return edits.with_values(sensor, changes)


def _is_image(sensor: Sensor) -> bool:
    part = sensor.projector
    patterns = [emitter.pattern or part.pattern for emitter in part.emitters] or [part.pattern]
    return all(Path(pattern).suffix for pattern in patterns)
