"""From the device's controls to our sensor's fields, and a report of what was made of each.

Our matcher is not the device's, so units differ. The device's default preset stands for the sensor
as given; what has a known unit (disparity, depth, time, power) is converted, the rest moves
relative to that default. Every rule with its reason: docs/decisions/0013-device-controls.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from starling.patterns import errors
from starling.sim.sensor import edits
from starling.sim.sensor.matcher import MOST_BITS, CensusSemiGlobal
from starling.sim.sensor.realsense import presets
from starling.sim.sensor.realsense.controls import (
    RANGES,
    WITHOUT_COUNTERPART,
    WORDS,
    Control,
    Controls,
)
from starling.sim.sensor.sensor import Sensor

DEFAULT_POWER_W = 0.15  # Of the emitter: default laser power (presets.cpp).
_LR_PER_PX = 32  # Units of the left-right threshold in a pixel (DSAPITypes.h).
_SETPOINT_SCALE = 4096  # Auto exposure's mean intensity is read as of 12 bits.
_UNITY_GAIN = 16
_TEXTURE_PIXELS = 49  # Of the 7x7 neighbourhood that the texture count looks at (DSAPITypes.h).
_TEXTURE_SCALE = 4096  # Its difference is read as of 12 bits.
_EIGHT_BITS = 255
_LAST_CODE = 65_535  # Of the 16-bit depth image.


@dataclass(frozen=True, kw_only=True, slots=True)
class Mapped:
    """A field of the sensor that controls have set."""

    controls: tuple[str, ...]
    field: str
    before: Any
    after: Any
    rule: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Unmapped:
    """A control that changes nothing here."""

    control: str
    value: Control
    departs: bool  # From the default preset; unknown counts as no.
    reason: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Report:
    """What became of every control."""

    mapped: tuple[Mapped, ...]
    unmapped: tuple[Unmapped, ...]
    missing: tuple[str, ...]  # Controls that were not given: the default, or the sensor's own.

    def lines(self) -> list[str]:
        """Say in plain text what changed and what departs from the default without effect."""
        said = [
            f"{', '.join(item.controls)}: {item.field} {_short(item.before)} -> "
            f"{_short(item.after)} ({item.rule})"
            for item in self.mapped
            if item.after != item.before
        ]
        by_reason: dict[str, list[str]] = {}
        for item in self.unmapped:
            if item.departs:
                by_reason.setdefault(item.reason, []).append(item.control)
        said += [f"no counterpart: {', '.join(names)} ({why})" for why, names in by_reason.items()]
        if self.missing:
            said.append(f"not given, left as the sensor has it: {', '.join(self.missing)}")
        return said


def apply(sensor: Sensor, controls: Controls) -> tuple[Sensor, Report]:
    """Set the fields that controls move.

    Args:
        sensor: taken to stand at the device's default preset.
        controls: values by the controls' own names (`controls.canonical`).

    Raises:
        InputError: a sensor that is no stereo pair or has another engine than CensusSemiGlobal,
            or values that no sensor admits.
    """
    _refuse_other_devices(sensor)
    default = presets.named(presets.DEFAULT)
    moves = _Moves(sensor, {**default, **controls})
    for rule in (_thresholds, _costs, _depth_table, _exposure, _laser):
        rule(moves)
    changed = [(item.field, item.after) for item in moves.mapped if item.after != item.before]
    try:
        moved = edits.with_values(sensor, changed)
    except errors.InputError as error:
        raise errors.InputError(f"device controls: {error}") from error
    unmapped = {
        name: WITHOUT_COUNTERPART[name] for name in controls if name in WITHOUT_COUNTERPART
    } | {name: why for name, why in moves.idle.items() if name in controls}
    return moved, Report(
        mapped=tuple(moves.mapped),
        unmapped=tuple(
            Unmapped(
                control=name,
                value=controls[name],
                departs=not _same(controls[name], default.get(name, controls[name])),
                reason=why,
            )
            for name, why in unmapped.items()
        ),
        missing=tuple(name for name in _MOVING if name not in controls),
    )


def with_emitter(sensor: Sensor, state: Literal["on", "off"]) -> Sensor:
    """Switch the projector; on, it keeps its power or takes the device's default of 150 mW.

    Raises:
        InputError: another state.
    """
    errors.one_of("emitter", state, ("on", "off"))
    power_w = sensor.projector.power_w or DEFAULT_POWER_W
    return edits.with_values(sensor, [("projector.power_w", power_w if state == "on" else 0.0)])


_MOVING = tuple(
    name for name in (*RANGES, *WORDS) if name not in WITHOUT_COUNTERPART
)  # Controls with a rule below.


class _Moves:
    """The fields set so far, and the controls that had no effect in this combination."""

    def __init__(self, sensor: Sensor, values: Controls) -> None:
        assert isinstance(sensor.matcher.engine, CensusSemiGlobal)
        self.sensor, self.engine, self.values = sensor, sensor.matcher.engine, values
        self.mapped: list[Mapped] = []
        self.idle: dict[str, str] = {}

    def number(self, name: str) -> float | None:
        """The value of a control that holds a number, if it was given or has a default."""
        value = self.values.get(name)
        return value if isinstance(value, (int, float)) else None

    def given(self, name: str) -> float:
        """The value of a control of the depth engine: those all have a default."""
        return float(self.values[name])

    def over_default(self, name: str) -> float:
        """How far it stands from the default preset's, in its own unit."""
        return self.given(name) - float(presets.named(presets.DEFAULT)[name])

    def set(self, field: str, after: Any, rule: str, *controls: str) -> None:
        """Note a field's new value."""
        before: Any = self.sensor
        for part in field.replace("imager.", "left.", 1).split("."):
            before = getattr(before, part)
        self.mapped.append(
            Mapped(controls=controls, field=field, before=before, after=after, rule=rule)
        )


def _thresholds(moves: _Moves) -> None:
    """What a match must pass."""
    lr = "param-leftrightthreshold"
    moves.set("matcher.checks.left_right_px", moves.given(lr) / _LR_PER_PX, "in 1/32 px", lr)
    # Scores are compared with the penalties inside the device, so they share one unit.
    bit = moves.engine.large_penalty / _penalties(presets.named(presets.DEFAULT))[1]
    for name, field in (
        ("param-secondpeakdelta", "second_peak"),
        ("param-neighborthresh", "neighbour_peak"),
    ):
        excess = bit * moves.over_default(name)
        after = max(0.0, getattr(moves.engine, field) + excess)
        rule = f"{bit:.3f} bit for every unit over the default, whose own we do not see"
        moves.set(f"matcher.engine.{field}", after, rule, name)
    _texture(moves)


def _texture(moves: _Moves) -> None:
    """Deviation of a window of which a share p differs from the rest by D: D sqrt(p (1 - p))."""
    count, difference = "param-texturecountthresh", "param-texturedifferencethresh"
    if not moves.given(count):
        moves.idle[difference] = (
            "the texture count is 0, which switches it off (librealsense issue 10608)"
        )
        moves.idle[count] = "0 switches the device's texture check off; ours keeps its floor"
        return
    share = min(moves.given(count) / _TEXTURE_PIXELS, 0.5)
    step_dn = moves.given(difference) * _EIGHT_BITS / _TEXTURE_SCALE
    least = max(moves.sensor.matcher.checks.texture_dn, step_dn * math.sqrt(share * (1 - share)))
    rule = "deviation of a window of which that count of 49 pixels differs by that much"
    moves.set("matcher.checks.texture_dn", least, rule, count, difference)


def _penalties(values: Controls) -> tuple[float, float]:
    """P1 and P2 in the device's unit; its second penalty comes on top of the first."""
    small = float(values["param-scanlinep1"])
    return small, small + float(values["param-scanlinep2"])


def _costs(moves: _Moves) -> None:
    """Census, its mix with the absolute difference, and the penalties."""
    engine, default = moves.engine, presets.named(presets.DEFAULT)
    u, v = "param-censususize", "param-censusvsize"
    side = math.sqrt(moves.given(u) * moves.given(v))
    odd = 2 * math.floor(side / 2) + 1
    moves.set("matcher.engine.census_px", odd, "odd side of the square of like area", u, v)

    ad, census, off = "param-lambdaad", "param-lambdacensus", "ignoreSAD"
    mix = moves.given(census) / moves.given(ad)
    usual = float(default[census]) / float(default[ad])
    weight = 0.0 if moves.given(off) else engine.difference_weight * (mix / usual)
    rule = "each cost is 1 - exp(-c / lambda), so their weights are as 1 / lambda"
    moves.set("matcher.engine.difference_weight", weight, rule, ad, census, off)

    p1, p2 = "param-scanlinep1", "param-scanlinep2"
    small, large = _penalties(moves.values)
    usual_small, usual_large = _penalties(default)
    ours = engine.small_penalty * (small / usual_small)
    jump = (large - small) / (usual_large - usual_small)
    theirs = ours + (engine.large_penalty - engine.small_penalty) * jump
    moves.set("matcher.engine.small_penalty", min(ours, MOST_BITS), "as over the default", p1)
    rule = "P1 + K2, K2 as over the default"
    moves.set("matcher.engine.large_penalty", min(theirs, MOST_BITS), rule, p1, p2)


def _depth_table(moves: _Moves) -> None:
    """Disparity shift, depth unit and clamps."""
    sensor, post = moves.sensor, moves.sensor.post
    near_m = post.near_m
    shift = moves.number("param-disparityshift")
    if shift is not None:
        whole, name = math.floor(shift + 0.5), "param-disparityshift"
        moves.set("matcher.min_disparity_px", whole, "in px", name)
        if near_m:
            # The nearest depth is that of the search's end, and the search moves.
            reach = sensor.focal_baseline_px_m / near_m - sensor.matcher.min_disparity_px
            near_m = sensor.focal_baseline_px_m / (reach + whole)
    unit_m = moves.number("param-depthunits")
    if unit_m is not None:
        unit_m *= 1e-6
        moves.set("post.depth_unit_m", unit_m, "in um", "param-depthunits")
    step_m = post.depth_unit_m if unit_m is None else unit_m
    least, most = moves.number("param-depthclampmin"), moves.number("param-depthclampmax")
    moves.set(
        "post.near_m",
        max(near_m, (least or 0.0) * step_m),
        "f b / (reach of the search + shift), or the clamp in depth units",
        "param-disparityshift",
        "param-depthclampmin",
    )
    if most is not None:
        far_m = min(post.far_m, min(most, _LAST_CODE) * step_m)
        moves.set("post.far_m", far_m, "in depth units", "param-depthclampmax")


def _exposure(moves: _Moves) -> None:
    """Auto exposure and what it leaves to be set by hand."""
    auto, level = moves.values.get("controls-autoexposure-auto"), "param-autoexposure-setpoint"
    by_hand = ("controls-autoexposure-manual", "controls-depth-gain")
    setpoint = moves.number(level)
    if auto == "true" or (auto is None and moves.sensor.left.auto_exposure_level > 0):
        if setpoint is not None:
            rule = "mean level of 4096"
            moves.set("imager.auto_exposure_level", setpoint / _SETPOINT_SCALE, rule, level)
        elif not moves.sensor.left.auto_exposure_level:
            raise errors.refuse(
                level, "must be given to switch auto exposure on", "nothing", "400 on a D415."
            )
        moves.idle |= dict.fromkeys(by_hand, "auto exposure is on")
        return
    moves.set("imager.auto_exposure_level", 0.0, "off", "controls-autoexposure-auto")
    moves.idle[level] = "auto exposure is off"
    exposure_us, gain = (moves.number(name) for name in by_hand)
    if exposure_us is not None:
        moves.set("imager.exposure_s", exposure_us * 1e-6, "in us", by_hand[0])
    if gain is not None:
        moves.set("imager.gain", gain / _UNITY_GAIN, "16 is unity", by_hand[1])


def _laser(moves: _Moves) -> None:
    """The emitter's power, or its switch."""
    state, power = moves.values.get("controls-laserstate"), moves.number("controls-laserpower")
    power_w = moves.sensor.projector.power_w if power is None else power * 1e-3
    if state == "off":
        power_w = 0.0
    elif state in ("on", "auto") and power is None:
        power_w = power_w or DEFAULT_POWER_W
    moves.set(
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
