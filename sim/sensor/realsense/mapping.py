"""Mapping of the device's controls to fields of a sensor, with a report.

The simulated matcher differs from the device's, and so do some units. The unchanged sensor
represents the device's default preset. Controls of a known unit (disparity, depth, time, power)
are converted. The other fields change relative to that default.
docs/design/device-controls.md gives the reason for each rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from starling.patterns import errors
from starling.sim.sensor import edits
from starling.sim.sensor.matcher import MOST_BITS, CensusSemiGlobal
from starling.sim.sensor.realsense.controls import (
    RANGES,
    WITHOUT_COUNTERPART,
    WORDS,
    Control,
    Controls,
    named_preset,
)
from starling.sim.sensor.sensor import Sensor

DEFAULT_POWER_W = 0.15  # Default laser power [W] (librealsense presets.cpp).
_LR_PER_PX = 32  # Units of the left-right threshold per pixel (DSAPITypes.h).
_SETPOINT_SCALE = 4096  # Full scale of the auto exposure set point, assumed to have 12 bits.
_UNITY_GAIN = 16  # Gain code of gain 1.
_TEXTURE_PIXELS = 49  # Pixels of the texture count's 7x7 neighbourhood (DSAPITypes.h).
_TEXTURE_SCALE = 4096  # Full scale of the texture difference, assumed to have 12 bits.
_EIGHT_BITS = 255  # Full scale of an 8-bit image [DN].
_LAST_CODE = 65_535  # Highest code of the 16-bit depth image.


@dataclass(frozen=True, kw_only=True, slots=True)
class Mapped:
    """A sensor field that controls have set."""

    controls: tuple[str, ...]
    field: str
    before: Any
    after: Any
    rule: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Unmapped:
    """A control without effect on the sensor."""

    control: str
    value: Control
    departs: bool  # The value differs from the default preset's, if that is known.
    reason: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Report:
    """Mapped, unmapped and missing controls."""

    mapped: tuple[Mapped, ...]
    unmapped: tuple[Unmapped, ...]
    missing: tuple[str, ...]  # Controls not given; the default or the sensor's value applies.

    def lines(self) -> list[str]:
        """List changed fields and unmapped controls that differ from the default."""
        lines = [
            f"{', '.join(item.controls)}: {item.field} {_short(item.before)} -> "
            f"{_short(item.after)} ({item.rule})"
            for item in self.mapped
            if item.after != item.before
        ]
        causes: dict[str, list[str]] = {}
        for item in self.unmapped:
            if item.departs:
                causes.setdefault(item.reason, []).append(item.control)
        lines += [f"no counterpart: {', '.join(names)} ({why})" for why, names in causes.items()]
        if self.missing:
            lines.append(f"not given, left as the sensor has it: {', '.join(self.missing)}")
        return lines


def apply(sensor: Sensor, controls: Controls) -> tuple[Sensor, Report]:
    """Set the sensor fields that the controls determine.

    Args:
        sensor: Sensor whose settings represent the device's default preset.
        controls: Values by the controls' canonical names (`controls.canonical`).

    Raises:
        InputError: if the sensor is not a stereo pair, has another engine than CensusSemiGlobal, or
            does not admit a value.
    """
    _refuse_other_devices(sensor)
    default = named_preset()
    mapping = _Mapping(sensor, {**default, **controls})
    for rule in (_thresholds, _costs, _depth_table, _exposure, _laser):
        rule(mapping)
    changed = [(item.field, item.after) for item in mapping.mapped if item.after != item.before]
    with errors.naming("device controls"):
        moved = edits.with_values(sensor, changed)
    unmapped = {
        name: WITHOUT_COUNTERPART[name] for name in controls if name in WITHOUT_COUNTERPART
    } | {name: why for name, why in mapping.idle.items() if name in controls}
    return moved, Report(
        mapped=tuple(mapping.mapped),
        unmapped=tuple(
            Unmapped(
                control=name,
                value=controls[name],
                departs=not _same(controls[name], default.get(name, controls[name])),
                reason=why,
            )
            for name, why in unmapped.items()
        ),
        missing=tuple(name for name in _MAPPED if name not in controls),
    )


def with_emitter(sensor: Sensor, state: Literal["on", "off"]) -> Sensor:
    """Switch the projector on, with its power or the default of 150 mW, or off.

    Raises:
        InputError: if the state is not `on` or `off`, or `on` for a camera without a projector.
    """
    errors.one_of("emitter", state, ("on", "off"))
    if state == "on" and sensor.projector.visible:
        rule, advice = "must be off where the camera has no projector", "Leave it out."
        raise errors.refuse("emitter", rule, f"on for {sensor.name}", advice)
    power_w = sensor.projector.power_w or DEFAULT_POWER_W
    return edits.with_values(sensor, [("projector.power_w", power_w if state == "on" else 0.0)])


# Controls that a rule below maps.
_MAPPED = tuple(name for name in (*RANGES, *WORDS) if name not in WITHOUT_COUNTERPART)


class _Mapping:
    """Fields set so far, and controls without effect in this combination."""

    def __init__(self, sensor: Sensor, values: Controls) -> None:
        assert isinstance(sensor.matcher.engine, CensusSemiGlobal)
        self.sensor, self.engine, self.values = sensor, sensor.matcher.engine, values
        self.mapped: list[Mapped] = []
        self.idle: dict[str, str] = {}

    def number(self, name: str) -> float | None:
        """Value of a numeric control; None if it is missing and has no default."""
        value = self.values.get(name)
        return value if isinstance(value, (int, float)) else None

    def engine_value(self, name: str) -> float:
        """Value of a control of the depth engine; all of these have a default."""
        return float(self.values[name])

    def over_default(self, name: str) -> float:
        """Difference of a control from the default preset, in the control's unit."""
        return self.engine_value(name) - float(named_preset()[name])

    def set(self, field: str, after: Any, rule: str, *controls: str) -> None:
        """Record a field's new value."""
        before: Any = self.sensor
        for part in field.replace("imager.", "left.", 1).split("."):
            before = getattr(before, part)
        self.mapped.append(
            Mapped(controls=controls, field=field, before=before, after=after, rule=rule)
        )


def _thresholds(mapping: _Mapping) -> None:
    """Thresholds of the matcher's checks."""
    lr = "param-leftrightthreshold"
    mapping.set(
        "matcher.checks.left_right_px", mapping.engine_value(lr) / _LR_PER_PX, "in 1/32 px", lr
    )
    # The device compares scores with penalties, so both have one unit.
    bit = mapping.engine.large_penalty / _penalties(named_preset())[1]
    for name, field in (
        ("param-secondpeakdelta", "second_peak"),
        ("param-neighborthresh", "neighbour_peak"),
    ):
        excess = bit * mapping.over_default(name)
        after = max(0.0, getattr(mapping.engine, field) + excess)
        rule = f"{bit:.3f} bit for every unit over the default, whose own we do not see"
        mapping.set(f"matcher.engine.{field}", after, rule, name)
    _support(mapping)
    _texture(mapping)


def _support(mapping: _Mapping) -> None:
    """Region support map: the least share of neighbours with a similar disparity."""
    use, share, step = "param-usersm", "param-rsmremovethreshold", "param-rsmdiffthreshold"
    if not mapping.sensor.matcher.checks.support_share:
        mapping.idle |= dict.fromkeys((use, share, step), "the sensor's matcher has no such check")
        return
    ours = mapping.sensor.matcher.checks.support_share
    usual, theirs = float(named_preset()[share]), mapping.engine_value(share)
    ends = ([0.0, usual, 1.0], [0.0, ours, 1.0])
    least = float(np.interp(theirs, *ends)) if mapping.engine_value(use) else 0.0
    rule = "share of 168 neighbours: none, ours at the default, all; linear between"
    mapping.set("matcher.checks.support_share", least, rule, share, use)
    mapping.set("matcher.checks.support_step_px", mapping.engine_value(step), "in px", step)


def _texture(mapping: _Mapping) -> None:
    """Texture threshold.

    If a share p of a window differs by D, the standard deviation is D sqrt(p (1 - p)).
    """
    count, difference = "param-texturecountthresh", "param-texturedifferencethresh"
    if not mapping.engine_value(count):
        mapping.idle[difference] = (
            "the texture count is 0, which switches it off (librealsense issue 10608)"
        )
        mapping.idle[count] = "0 switches the device's texture check off; ours keeps its floor"
        return
    share = min(mapping.engine_value(count) / _TEXTURE_PIXELS, 0.5)
    step_dn = mapping.engine_value(difference) * _EIGHT_BITS / _TEXTURE_SCALE
    least = max(mapping.sensor.matcher.checks.texture_dn, step_dn * math.sqrt(share * (1 - share)))
    rule = "deviation of a window of which that count of 49 pixels differs by that much"
    mapping.set("matcher.checks.texture_dn", least, rule, count, difference)


def _penalties(values: Controls) -> tuple[float, float]:
    """P1 and P2 in the device's unit. The device adds its second penalty to the first."""
    small = float(values["param-scanlinep1"])
    return small, small + float(values["param-scanlinep2"])


def _costs(mapping: _Mapping) -> None:
    """Census size, weight of the absolute difference, and penalties."""
    engine, default = mapping.engine, named_preset()
    u, v = "param-censususize", "param-censusvsize"
    side = math.sqrt(mapping.engine_value(u) * mapping.engine_value(v))
    odd = 2 * math.floor(side / 2) + 1
    mapping.set("matcher.engine.census_px", odd, "odd side of the square of like area", u, v)

    ad, census, off = "param-lambdaad", "param-lambdacensus", "ignoreSAD"
    mix = mapping.engine_value(census) / mapping.engine_value(ad)
    usual = float(default[census]) / float(default[ad])
    weight = 0.0 if mapping.engine_value(off) else engine.difference_weight * (mix / usual)
    rule = "each cost is 1 - exp(-c / lambda), so their weights are as 1 / lambda"
    mapping.set("matcher.engine.difference_weight", weight, rule, ad, census, off)

    p1, p2 = "param-scanlinep1", "param-scanlinep2"
    small, large = _penalties(mapping.values)
    usual_small, usual_large = _penalties(default)
    ours = engine.small_penalty * (small / usual_small)
    jump = (large - small) / (usual_large - usual_small)
    theirs = ours + (engine.large_penalty - engine.small_penalty) * jump
    mapping.set("matcher.engine.small_penalty", min(ours, MOST_BITS), "as over the default", p1)
    rule = "P1 + K2, K2 as over the default"
    mapping.set("matcher.engine.large_penalty", min(theirs, MOST_BITS), rule, p1, p2)


def _depth_table(mapping: _Mapping) -> None:
    """Disparity shift, depth unit and clamps."""
    sensor, post = mapping.sensor, mapping.sensor.post
    near_m = post.near_m
    shift = mapping.number("param-disparityshift")
    if shift is not None:
        whole, name = math.floor(shift + 0.5), "param-disparityshift"
        mapping.set("matcher.min_disparity_px", whole, "in px", name)
        if near_m:
            # The end of the search range sets the nearest depth, and the shift mapping it.
            reach = sensor.focal_baseline_px_m / near_m - sensor.matcher.min_disparity_px
            near_m = sensor.focal_baseline_px_m / (reach + whole)
    unit_m = mapping.number("param-depthunits")
    if unit_m is not None:
        unit_m *= 1e-6
        mapping.set("post.depth_unit_m", unit_m, "in um", "param-depthunits")
    step_m = post.depth_unit_m if unit_m is None else unit_m
    least, most = mapping.number("param-depthclampmin"), mapping.number("param-depthclampmax")
    mapping.set(
        "post.near_m",
        max(near_m, (least or 0.0) * step_m),
        "f b / (reach of the search + shift), or the clamp in depth units",
        "param-disparityshift",
        "param-depthclampmin",
    )
    if most is not None:
        far_m = min(post.far_m, min(most, _LAST_CODE) * step_m)
        mapping.set("post.far_m", far_m, "in depth units", "param-depthclampmax")


def _exposure(mapping: _Mapping) -> None:
    """Auto exposure, or manual exposure and gain."""
    auto, level = mapping.values.get("controls-autoexposure-auto"), "param-autoexposure-setpoint"
    manual = ("controls-autoexposure-manual", "controls-depth-gain")
    setpoint = mapping.number(level)
    if auto == "true" or (auto is None and mapping.sensor.left.auto_exposure_level > 0):
        if setpoint is not None:
            rule = "mean level of 4096"
            mapping.set("imager.auto_exposure_level", setpoint / _SETPOINT_SCALE, rule, level)
        elif not mapping.sensor.left.auto_exposure_level:
            raise errors.refuse(
                level, "must be given to switch auto exposure on", "nothing", "400 on a D415."
            )
        mapping.idle |= dict.fromkeys(manual, "auto exposure is on")
        return
    mapping.set("imager.auto_exposure_level", 0.0, "off", "controls-autoexposure-auto")
    mapping.idle[level] = "auto exposure is off"
    exposure_us, gain = (mapping.number(name) for name in manual)
    if exposure_us is not None:
        mapping.set("imager.exposure_s", exposure_us * 1e-6, "in us", manual[0])
    if gain is not None:
        mapping.set("imager.gain", gain / _UNITY_GAIN, "16 is unity", manual[1])


def _laser(mapping: _Mapping) -> None:
    """Power of the emitter, or its switch."""
    if mapping.sensor.projector.visible:
        for name in ("controls-laserstate", "controls-laserpower"):
            mapping.idle[name] = "the camera has no projector"
        return
    state, power = mapping.values.get("controls-laserstate"), mapping.number("controls-laserpower")
    power_w = mapping.sensor.projector.power_w if power is None else power * 1e-3
    if state == "off":
        power_w = 0.0
    elif state in ("on", "auto") and power is None:
        power_w = power_w or DEFAULT_POWER_W
    mapping.set(
        "projector.power_w",
        power_w,
        "in mW; off is 0",
        "controls-laserpower",
        "controls-laserstate",
    )


def _refuse_other_devices(sensor: Sensor) -> None:
    if sensor.kind != "stereo":
        raise errors.refuse(
            "sensor",
            "must be a stereo pair to take RealSense controls",
            f"{sensor.name}, {sensor.kind}",
            "Take d415, d435 or d455.",
        )
    if not isinstance(sensor.matcher.engine, CensusSemiGlobal):
        raise errors.refuse(
            "matcher.engine",
            "must be CensusSemiGlobal to take RealSense controls",
            type(sensor.matcher.engine).__name__,
            "Set matcher.setting=d4xx.",
        )


def _same(value: Control, usual: Control) -> bool:
    if isinstance(value, str) or isinstance(usual, str):
        return value == usual
    return math.isclose(value, usual, rel_tol=1e-3, abs_tol=1e-9)


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
