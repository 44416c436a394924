"""The numbers of a sensor that a fit may free, in groups that are asked for by name."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from starling.patterns import errors
from starling.sim.sensor import edits as sensor_edits
from starling.sim.sensor.sensor import Sensor

FIELD = "projector.field"  # Tangent of the projector's half horizontal field.
DOT_BLUR = "projector.dot_blur_mrad"


@dataclass(frozen=True, kw_only=True, slots=True)
class Parameter:
    """One number that a fit may free."""

    name: str  # A dotted path in the sensor, but for `projector.field` and `scene.` paths.
    group: str  # What `--free` takes.
    unit: str
    tolerance: float  # Deviation of a unit from its data sheet, one sigma, before any capture.


def _row(name: str, group: str, unit: str, tolerance: float) -> Parameter:
    return Parameter(name=name, group=group, unit=unit, tolerance=tolerance)


# Tolerances are assumed where no source is given. They weigh what the captures leave open, and
# tell what is open; where captures determine a number they do not count.
TABLE = (
    _row("baseline_m", "baseline", "m", 3e-3),
    _row("right.alignment.offset_y_px", "alignment", "px", 2.0),
    _row("right.alignment.roll_deg", "alignment", "deg", 0.3),
    _row("right.alignment.pitch_deg", "alignment", "deg", 0.3),
    _row("right.alignment.yaw_deg", "alignment", "deg", 0.3),
    _row("fx_px", "focal", "px", 0.01),  # Times the focal length.
    _row("cx_px", "centre", "px", 10.0),
    _row("cy_px", "centre", "px", 10.0),
    *(_row(f"projector.position_m.{axis}", "projector", "m", 5e-3) for axis in "xyz"),
    *(_row(f"projector.rotation_deg.{axis}", "projector", "deg", 1.0) for axis in "xyz"),
    _row(FIELD, "field", "1", 0.02),  # Times the tangent.
    _row("projector.pattern_scale", "scale", "1", 3e-3),
    _row(DOT_BLUR, "dots", "mrad", 1.5),
    _row("projector.power_w", "photometry", "W", 0.1),
    _row("projector.haze", "photometry", "1", 0.3),
    _row("projector.falloff", "photometry", "1", 2.0),
    _row("scene.ambient.irradiance_w_m2", "photometry", "W m^-2", 1.0),
    _row("left.black_level_dn", "photometry", "DN", 4.0),
    _row("left.lens.vignetting", "photometry", "1", 2.0),
    _row("left.auto_exposure_level", "photometry", "1", 0.05),
    _row("left.full_well_e", "noise", "e", 5e3),
    _row("left.read_noise_e", "noise", "e", 5.0),
    _row("left.smoothing_px", "noise", "px", 0.5),
    _row("projector.speckle_contrast", "noise", "1", 0.2),
)
GROUPS = tuple(dict.fromkeys(row.group for row in TABLE))
GEOMETRY = ("baseline", "alignment", "focal", "centre", "projector", "field", "scale", "dots")
_RELATIVE = ("fx_px", FIELD)  # Their tolerance is a share of the value.


def free(groups: Iterable[str], sensor: Sensor) -> tuple[Parameter, ...]:
    """Return the geometry's parameters of some groups, tolerances in their units.

    Args:
        groups: names out of `GEOMETRY`.
        sensor: that they are freed of.

    Raises:
        InputError: an unknown group, none at all, or the field of a pattern that is generated
            anew for every field.
    """
    asked = tuple(groups)
    for group in asked:
        errors.one_of("free", group, GEOMETRY)
    if not asked:
        raise errors.refuse(
            "free", "must name a group", "none", f"There are: {', '.join(GEOMETRY)}."
        )
    if "field" in asked and not _is_image(sensor):
        raise errors.refuse(
            "free",
            "must not hold field where the pattern is generated to fill it",
            sensor.projector.pattern,
            "Free scale instead, or give the pattern as an image.",
        )
    rows = [row for row in TABLE if row.group in asked]
    return tuple(
        dataclasses.replace(row, tolerance=row.tolerance * value(sensor, row.name))
        if row.name in _RELATIVE
        else row
        for row in rows
    )


def value(sensor: Sensor, name: str) -> float:
    """Read a parameter off a sensor."""
    if name == FIELD:
        return math.tan(math.radians(sensor.projector.fov_x_deg / 2))
    here: object = sensor
    for part in name.split("."):
        here = here["xyz".index(part)] if isinstance(here, tuple) else getattr(here, part)
    assert isinstance(here, (int, float))
    return float(here)


def with_values(sensor: Sensor, values: Iterable[tuple[str, float]]) -> Sensor:
    """Set parameters; fx_px takes fy_px along, and the field's width its height.

    Raises:
        InputError: a value that no sensor can have.
    """
    edits: list[tuple[str, float]] = []
    for name, new in values:
        if name == "fx_px":
            edits += [("fx_px", new), ("fy_px", new * sensor.fy_px / sensor.fx_px)]
        elif name == FIELD:
            ratio = new / value(sensor, FIELD)
            for axis, degrees in (
                ("x", sensor.projector.fov_x_deg),
                ("y", sensor.projector.fov_y_deg),
            ):
                tangent = math.tan(math.radians(degrees / 2)) * ratio
                edits.append((f"projector.fov_{axis}_deg", 2 * math.degrees(math.atan(tangent))))
        else:
            edits.append((name, new))
    return sensor_edits.with_values(sensor, edits)


def _is_image(sensor: Sensor) -> bool:
    part = sensor.projector
    patterns = [emitter.pattern or part.pattern for emitter in part.emitters] or [part.pattern]
    return all(Path(pattern).suffix for pattern in patterns)
