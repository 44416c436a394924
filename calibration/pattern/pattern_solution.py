"""A recovered pattern's parameters in the sensor's own terms, with their uncertainty."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.calibration.pattern import emission, emitter_model, pattern_sensor, room_equations
from starling.calibration.pattern.emission import Alignment
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.recovery import Recovered
from starling.calibration.solution import Estimate, Solution
from starling.sim.geometry import frames
from starling.sim.sensor.sensor import Sensor

SCALE_OPEN = (
    "fx_px and baseline_m cannot be told apart by reference depth, which is seen through the same "
    "lens; only their product can: capture a posed metric mesh (scene.toml)."
)
GAUGE_OPEN = (
    "The pattern's own scale and the mean of the scenes' pattern_scale cannot be told apart: the "
    "mean is set to 1."
)
TURN_OPEN = (
    "projector.rotation_deg cannot be told from a pattern that is an image: it turns with it."
)


def rooms_open(count: int) -> str:
    """Say what too few rooms leave out of every deviation of a pattern's fit."""
    seen = "1 room says" if count == 1 else f"{count} rooms say"
    return (
        f"How far references differ from room to room is in no deviation of the pattern's fit, of "
        f"which {seen} nothing, and deviations may be several times too small: capture "
        f"{room_equations.LEAST_ROOMS} rooms or more."
    )


def solution(recovered: Recovered, sensor: Sensor, *, metric: bool) -> Solution:
    """Say what was recovered as estimates of a sensor's parameters.

    Args:
        recovered: from captures.
        sensor: that the recovery began from.
        metric: whether the captures' surfaces are known without the imager's intrinsics.
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
        sensor=pattern_sensor.aligned(sensor, fitted.model),
        derived=_derived(recovered, sensor),
    )


_Row = tuple[str, float, str, float, NDArray[np.float64]]  # Name, value, unit, start, slope.


def _rows(recovered: Recovered, sensor: Sensor) -> list[_Row]:
    model, names = recovered.fitted.model, recovered.fitted.model.names
    part, count = sensor.projector, len(recovered.fitted.model.emitters)
    axes = frames.rotation(model.rotation_deg)

    def slope(weights: dict[str, float]) -> NDArray[np.float64]:
        return np.array([weights.get(name, 0.0) for name in names])

    def place(number: int, weights: NDArray[np.float64]) -> dict[str, float]:
        start = emitter_model.of_emitter(number)
        return {
            f"{start}position.{axis}": float(w)
            for axis, w in zip(emission.PLACE, weights, strict=True)
        }

    mean = np.mean([one.position_m for one in model.emitters], axis=0)
    rows: list[_Row] = []
    for i, axis in enumerate("xyz"):
        weights = {k: v for n in range(count) for k, v in place(n, np.eye(3)[i] / count).items()}
        at = f"projector.position_m.{axis}"
        rows.append((at, float(mean[i]), "m", part.position_m[i], slope(weights)))
    for i, (axis, name) in enumerate(zip("xy", emission.TURN, strict=True)):
        if name in names:  # Turns are small: the vector's change is the turn about each axis.
            value, begun = model.rotation_deg[i], part.rotation_deg[i]
            weights = {name: float(np.degrees(1))}
            rows.append((f"projector.rotation_deg.{axis}", value, "deg", begun, slope(weights)))
    for number, one in enumerate(model.emitters if count > 1 else ()):
        offset = axes.T @ (one.position_m - mean)
        for i, axis in enumerate("xyz"):
            weights = {}
            for other in range(count):
                weights |= place(other, axes[:, i] * ((other == number) - 1 / count))
            at = f"projector.emitters.{number}.offset_m.{axis}"
            begun = part.emitters[number].offset_m[i] if len(part.emitters) == count else 0.0
            rows.append((at, float(offset[i]), "m", begun, slope(weights)))
    rest, old = model.alignment, sensor.right.alignment
    turned = -float(np.degrees(1 / sensor.fx_px))
    rows += [
        (
            "right.alignment.offset_y_px",
            old.offset_y_px + rest.offset_y,
            "px",
            old.offset_y_px,
            slope({"right.offset_y": 1.0}),
        ),
        (
            "right.alignment.offset_x_px",
            old.offset_x_px + rest.offset_x,
            "px",
            old.offset_x_px,
            slope({"right.offset_x": 1.0}),
        ),
        (
            "right.alignment.roll_deg",
            old.roll_deg + turned * rest.roll,
            "deg",
            old.roll_deg,
            slope({"right.roll": turned}),
        ),
    ]
    for scene, scale in model.scales.items():
        name = emitter_model.of_scene(scene)
        rows.append((f"projector.{name}", scale, "1", 1.0, slope({name: 1.0})))
    return rows


def _derived(recovered: Recovered, sensor: Sensor) -> tuple[Estimate, ...]:
    """f b, and of lattices pitch, angle and the dots' own width."""
    fitted = recovered.fitted
    rest: Alignment = fitted.model.alignment
    begun = sensor.focal_baseline_px_m
    out = [
        Estimate(
            name="focal_baseline_px_m",
            value=begun - rest.focal_baseline,
            sd=fitted.sd("right.focal_baseline"),
            unit="px m",
            start=begun,
        )
    ]
    for number, one in enumerate(fitted.model.emitters):
        if not isinstance(one.source, Lattice):
            continue
        start = emitter_model.of_emitter(number)
        for i in range(2):
            row = one.source.frequencies[i]
            names = [f"{start}frequency.{i}{j}" for j in range(2)]
            at = [fitted.model.names.index(name) for name in names]
            length = float(np.linalg.norm(row))
            block = fitted.covariance[np.ix_(at, at)]
            along, across = row / length, np.array([-row[1], row[0]]) / length**2
            out += [
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
        out.append(
            Estimate(
                name=f"{start}dot_sigma_mrad",
                value=1e3 * one.source.sigma,
                sd=1e3 * fitted.sd(f"{start}sigma"),
                unit="mrad, the imager's blur included",
                start=float("nan"),
            )
        )
    return tuple(out)
