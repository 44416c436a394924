"""Convert a recovered pattern to parameters of the sensor, with their uncertainty."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern import emission, emitter_model, pattern_sensor, room_equations
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.recovery import RecoveredPattern
from starling.calibration.solution import Estimate, Solution
from starling.sim.geometry import frames
from starling.sim.sensor.sensor import Sensor

SCALE_OPEN = (
    "fx_px and baseline_m cannot be separated with reference depth, which is in the view of the "
    "same lens; only their product is determined: capture a posed metric mesh (scene.toml)."
)
GAUGE_OPEN = (
    "The scale of the pattern and the mean of the scenes' pattern_scale cannot be separated: the "
    "mean is set to 1."
)
TURN_OPEN = (
    "projector.rotation_deg cannot be estimated for a pattern image, because the image rotates "
    "with the projector."
)


def rooms_open(count: int) -> str:
    """Describe the part of the uncertainty that too few rooms do not determine."""
    rooms = "1 room" if count == 1 else f"{count} rooms"
    return (
        f"The standard deviations of the pattern fit come from {rooms} and do not include the "
        "scatter of references between rooms, so they may be several times too small: capture "
        f"{room_equations.LEAST_ROOMS} rooms or more."
    )


def solution(recovered: RecoveredPattern, sensor: Sensor, *, metric: bool) -> Solution:
    """Convert a recovered pattern to estimates of a sensor's parameters.

    Args:
        recovered: pattern recovered from captures.
        sensor: initial sensor of the recovery.
        metric: whether the captures' surfaces are independent of the imager's intrinsics.
    """
    fitted = recovered.fitted
    rows = _rows(recovered, sensor)
    slopes = np.array([slope for _, _, _, _, slope in rows])
    covariance = slopes @ fitted.covariance @ slopes.T
    estimates = tuple(
        Estimate(name=name, value=value, sd=float(np.sqrt(variance)), unit=unit, start=start)
        for (name, value, unit, start, _), variance in zip(
            rows, np.diagonal(covariance), strict=True
        )
    )
    return Solution(
        estimates=estimates,
        covariance=covariance,
        undetermined=(
            *(() if metric else (SCALE_OPEN,)),
            GAUGE_OPEN,
            *(() if recovered.lattices else (TURN_OPEN,)),
            *((rooms_open(fitted.rooms),) if fitted.rooms < room_equations.LEAST_ROOMS else ()),
        ),
        cost=fitted.cost,
        sensor=pattern_sensor.with_alignment(sensor, fitted.model),
        derived=_derived(recovered, sensor),
    )


_Row = tuple[str, float, str, float, NDArray[np.float64]]  # Name, value, unit, start, slope.


def _rows(recovered: RecoveredPattern, sensor: Sensor) -> list[_Row]:
    model, part = recovered.model, sensor.projector
    count, axes = len(model.emitters), frames.rotation(model.rotation_deg)
    rows: list[_Row] = []

    def add(path: str, value: float, unit: str, start: float, weights: dict[str, float]) -> None:
        slope = np.array([weights.get(name, 0.0) for name in model.names])
        rows.append((path, float(value), unit, start, slope))

    def place(number: int, weights: NDArray[np.float64]) -> dict[str, float]:
        prefix = f"{emitter_model.emitter_prefix(number)}position."
        pairs = zip(emission.PLACE, weights, strict=True)
        return {prefix + axis: float(weight) for axis, weight in pairs}

    mean = np.mean([emitter.position_m for emitter in model.emitters], axis=0)
    for i, axis in enumerate("xyz"):
        weights = {k: v for n in range(count) for k, v in place(n, np.eye(3)[i] / count).items()}
        add(f"projector.position_m.{axis}", mean[i], "m", part.position_m[i], weights)
    for i, (axis, name) in enumerate(zip("xy", emission.TURN, strict=True)):
        if name in model.names:  # For small angles, the change of the vector is the angle by axis.
            path, weights = f"projector.rotation_deg.{axis}", {name: float(np.degrees(1))}
            add(path, model.rotation_deg[i], "deg", part.rotation_deg[i], weights)
    for number, emitter in enumerate(model.emitters if count > 1 else ()):
        offset = axes.T @ (emitter.position_m - mean)
        for i, axis in enumerate("xyz"):
            weights = {}
            for index in range(count):
                weights |= place(index, axes[:, i] * ((index == number) - 1 / count))
            initial = part.emitters[number].offset_m[i] if len(part.emitters) == count else 0.0
            add(f"projector.emitters.{number}.offset_m.{axis}", offset[i], "m", initial, weights)
    deg_per_px = -float(np.degrees(1 / sensor.fx_px))
    for field, name, unit, factor in (
        ("offset_y_px", "offset_y", "px", 1.0),
        ("offset_x_px", "offset_x", "px", 1.0),
        ("roll_deg", "roll", "deg", deg_per_px),
    ):
        initial = getattr(sensor.right.alignment, field)
        value = initial + factor * getattr(model.alignment, name)
        add(f"right.alignment.{field}", value, unit, initial, {f"right.{name}": factor})
    for scene, scale in model.scales.items():
        name = emitter_model.scene_scale_name(scene)
        add(f"projector.{name}", scale, "1", 1.0, {name: 1.0})
    return rows


def _derived(recovered: RecoveredPattern, sensor: Sensor) -> tuple[Estimate, ...]:
    """Return f * b, and the pitch, angle and dot width of lattices."""
    fitted, estimates = recovered.fitted, []

    def add(name: str, value: float, sd: float, unit: str, start: float = float("nan")) -> None:
        estimates.append(Estimate(name=name, value=value, sd=sd, unit=unit, start=start))

    initial = sensor.focal_baseline_px_m
    value = initial - fitted.model.alignment.focal_baseline
    sd = fitted.sd("right.focal_baseline")
    add("focal_baseline_px_m", value, sd, "px m", initial)
    for number, emitter in enumerate(fitted.model.emitters):
        if not isinstance(emitter.source, Lattice):
            continue
        prefix = emitter_model.emitter_prefix(number)
        for i in range(2):
            row = emitter.source.frequencies[i]
            indices = [fitted.model.names.index(f"{prefix}frequency.{i}{j}") for j in range(2)]
            length = float(np.linalg.norm(row))
            block = fitted.covariance[np.ix_(indices, indices)]
            along, across = row / length, np.array([-row[1], row[0]]) / length**2
            sd = float(np.sqrt(along @ block @ along))
            add(f"{prefix}lattice.{i}.cycles", length, sd, "1 / unit of direction cosine")
            angle_deg = float(np.degrees(np.arctan2(row[1], row[0])))
            sd = float(np.degrees(np.sqrt(across @ block @ across)))
            add(f"{prefix}lattice.{i}.angle_deg", angle_deg, sd, "deg")
        sd = 1e3 * fitted.sd(f"{prefix}sigma")
        width_mrad = 1e3 * emitter.source.sigma
        add(f"{prefix}dot_sigma_mrad", width_mrad, sd, "mrad, the imager's blur included")
    return tuple(estimates)
