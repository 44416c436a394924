"""Convert a recovered pattern to parameters of the sensor, with their uncertainty."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern import emission, emitter_model, pattern_sensor, room_equations
from starling.calibration.pattern.emission import RightAlignment
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
    model, names = recovered.fitted.model, recovered.fitted.model.names
    part, count = sensor.projector, len(recovered.fitted.model.emitters)
    axes = frames.rotation(model.rotation_deg)

    def slope(weights: dict[str, float]) -> NDArray[np.float64]:
        return np.array([weights.get(name, 0.0) for name in names])

    def place(number: int, weights: NDArray[np.float64]) -> dict[str, float]:
        start = emitter_model.emitter_prefix(number)
        return {
            f"{start}position.{axis}": float(w)
            for axis, w in zip(emission.PLACE, weights, strict=True)
        }

    mean = np.mean([emitter.position_m for emitter in model.emitters], axis=0)
    rows: list[_Row] = []
    for i, axis in enumerate("xyz"):
        weights = {k: v for n in range(count) for k, v in place(n, np.eye(3)[i] / count).items()}
        path = f"projector.position_m.{axis}"
        rows.append((path, float(mean[i]), "m", part.position_m[i], slope(weights)))
    for i, (axis, name) in enumerate(zip("xy", emission.TURN, strict=True)):
        if name in names:  # For small angles, the change of the vector is the angle by axis.
            value, initial = model.rotation_deg[i], part.rotation_deg[i]
            weights = {name: float(np.degrees(1))}
            rows.append((f"projector.rotation_deg.{axis}", value, "deg", initial, slope(weights)))
    for number, emitter in enumerate(model.emitters if count > 1 else ()):
        offset = axes.T @ (emitter.position_m - mean)
        for i, axis in enumerate("xyz"):
            weights = {}
            for index in range(count):
                weights |= place(index, axes[:, i] * ((index == number) - 1 / count))
            path = f"projector.emitters.{number}.offset_m.{axis}"
            initial = part.emitters[number].offset_m[i] if len(part.emitters) == count else 0.0
            rows.append((path, float(offset[i]), "m", initial, slope(weights)))
    alignment, old = model.alignment, sensor.right.alignment
    deg_per_px = -float(np.degrees(1 / sensor.fx_px))
    rows += [
        (
            "right.alignment.offset_y_px",
            old.offset_y_px + alignment.offset_y,
            "px",
            old.offset_y_px,
            slope({"right.offset_y": 1.0}),
        ),
        (
            "right.alignment.offset_x_px",
            old.offset_x_px + alignment.offset_x,
            "px",
            old.offset_x_px,
            slope({"right.offset_x": 1.0}),
        ),
        (
            "right.alignment.roll_deg",
            old.roll_deg + deg_per_px * alignment.roll,
            "deg",
            old.roll_deg,
            slope({"right.roll": deg_per_px}),
        ),
    ]
    for scene, scale in model.scales.items():
        name = emitter_model.scene_scale_name(scene)
        rows.append((f"projector.{name}", scale, "1", 1.0, slope({name: 1.0})))
    return rows


def _derived(recovered: RecoveredPattern, sensor: Sensor) -> tuple[Estimate, ...]:
    """Return f * b, and the pitch, angle and dot width of lattices."""
    fitted = recovered.fitted
    alignment: RightAlignment = fitted.model.alignment
    initial = sensor.focal_baseline_px_m
    estimates = [
        Estimate(
            name="focal_baseline_px_m",
            value=initial - alignment.focal_baseline,
            sd=fitted.sd("right.focal_baseline"),
            unit="px m",
            start=initial,
        )
    ]
    for number, emitter in enumerate(fitted.model.emitters):
        if not isinstance(emitter.source, Lattice):
            continue
        start = emitter_model.emitter_prefix(number)
        for i in range(2):
            row = emitter.source.frequencies[i]
            names = [f"{start}frequency.{i}{j}" for j in range(2)]
            indices = [fitted.model.names.index(name) for name in names]
            length = float(np.linalg.norm(row))
            block = fitted.covariance[np.ix_(indices, indices)]
            along, across = row / length, np.array([-row[1], row[0]]) / length**2
            estimates += [
                Estimate(
                    name=f"{start}lattice.{i}.cycles",
                    value=length,
                    sd=float(np.sqrt(along @ block @ along)),
                    unit="1 / unit of direction cosine",
                    start=float("nan"),
                ),
                Estimate(
                    name=f"{start}lattice.{i}.angle_deg",
                    value=float(np.degrees(np.arctan2(row[1], row[0]))),
                    sd=float(np.degrees(np.sqrt(across @ block @ across))),
                    unit="deg",
                    start=float("nan"),
                ),
            ]
        estimates.append(
            Estimate(
                name=f"{start}dot_sigma_mrad",
                value=1e3 * emitter.source.sigma,
                sd=1e3 * fitted.sd(f"{start}sigma"),
                unit="mrad, the imager's blur included",
                start=float("nan"),
            )
        )
    return tuple(estimates)
