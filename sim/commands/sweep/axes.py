"""Parameters that a sweep varies, and the resulting cameras."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from starling.patterns import errors
from starling.sim.render import emission
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True)
class Axis:
    """One parameter of a camera's design."""

    word: str  # Short name.
    label: str  # Title in the picture.
    unit: str  # Displayed unit.
    scale: float  # Displayed value over the value in SI units.
    read: Callable[[Sensor], float]  # Value of a sensor.
    write: Callable[[Sensor, float], Sensor]  # Sensor with another value.
    defaults: Callable[[Sensor], tuple[float, ...]]  # Values to sweep if none are given.

    def shown(self, value: float) -> str:
        """Format a value in the displayed unit."""
        return f"{self.scale * value:.4g} {self.unit}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Camera:
    """One camera of a sweep."""

    values: Mapping[str, float]  # Value of every axis in SI units, by its name in `AXES`.
    sensor: Sensor


def with_focal(sensor: Sensor, focal_px: float) -> Sensor:
    """Change the field of view at the same image size, f-number and pixel pitch.

    Both focal lengths [px] scale by the same ratio; the principal point and the projector's field
    of view stay. An imager's defocus scales with the focal length squared (thin lens,
    f^2 / (4 N pitch)).
    """
    ratio = focal_px / sensor.fx_px
    edits = [("fx_px", focal_px), ("fy_px", ratio * sensor.fy_px)]
    for side in ("left", "right"):
        defocus = getattr(sensor, side).lens.defocus_px_m
        edits.append((f"{side}.lens.defocus_px_m", ratio**2 * defocus))
    return with_values(sensor, edits)


AXES: dict[str, Axis] = {
    "baseline_m": Axis(
        word="baseline",
        label="Baseline",
        unit="mm",
        scale=1e3,
        read=lambda sensor: sensor.baseline_m,
        write=lambda sensor, value: dataclasses.replace(sensor, baseline_m=value),
        defaults=lambda _: (0.02, 0.035, 0.1, 0.15),
    ),
    "focal_px": Axis(
        word="focal length",
        label="Focal length at one image size",
        unit="px",
        scale=1.0,
        read=lambda sensor: sensor.fx_px,
        write=with_focal,
        defaults=lambda sensor: (0.7 * sensor.fx_px, 1.4 * sensor.fx_px, 2 * sensor.fx_px),
    ),
    "projector_x_m": Axis(
        word="projector x",
        label="Projector, to the right of the left imager",
        unit="mm",
        scale=1e3,
        read=lambda sensor: sensor.projector.position_m[0],
        write=lambda sensor, value: with_values(sensor, [("projector.position_m.x", value)]),
        defaults=lambda _: (-0.05, 0.0, 0.1),
    ),
    "dot_density": Axis(
        word="dots",
        label="Dot density over the pattern's own",
        unit="x",
        scale=1.0,
        read=lambda sensor: sensor.projector.dot_density,
        write=lambda sensor, value: with_values(sensor, [("projector.dot_density", value)]),
        # A pattern that is read from an image has a fixed number of dots.
        defaults=lambda sensor: (0.25, 0.5, 2.0, 4.0) if _is_generated(sensor) else (),
    ),
}


def _is_generated(sensor: Sensor) -> bool:
    emitters = emission.emitters(sensor.projector)
    return all(emitter.pattern in emission.GENERATORS for emitter in emitters)


def chosen(base: Sensor, requested: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, ...]]:
    """Return the values of every swept axis: the requested ones, or the defaults of all axes.

    Raises:
        InputError: if an axis is unknown.
    """
    for name in requested:
        errors.one_of("axis", name, AXES)
    named = {name: tuple(map(float, values)) for name, values in requested.items() if len(values)}
    return named or {name: axis.defaults(base) for name, axis in AXES.items()}


def cameras(
    base: Sensor, axes: Mapping[str, Sequence[float]], *, full: bool = False
) -> list[Camera]:
    """Return the cameras of a sweep around a base camera; the base comes first.

    Args:
        base: a stereo camera.
        axes: values of each axis in addition to the base's value, by name in `AXES`.
        full: all combinations (full factorial); otherwise at most one axis differs from the base.

    Raises:
        InputError: if the base uses structured light, an axis is unknown or a value is invalid.
    """
    if base.kind != "stereo":
        raise errors.refuse(
            "sensor",
            "must be a stereo camera: with structured light the projector is at the baseline",
            base.name,
            "Sweep a stereo camera, such as d435.",
        )
    for name in axes:
        errors.one_of("axis", name, AXES)
    base_values = {name: axis.read(base) for name, axis in AXES.items()}
    levels = [dict.fromkeys((base_values[name], *axes.get(name, ()))) for name in AXES]
    swept = []
    for combination in itertools.product(*levels):
        values = dict(zip(AXES, combination, strict=True))
        moved = _moved(values, base_values)
        if not full and len(moved) > 1:
            continue
        sensor = base
        for name in moved:
            sensor = AXES[name].write(sensor, values[name])
        swept.append(Camera(values=values, sensor=sensor))
    order = list(AXES)
    return sorted(
        swept, key=lambda camera: [order.index(name) for name in _moved(camera.values, base_values)]
    )


def _moved(values: Mapping[str, float], base_values: Mapping[str, float]) -> list[str]:
    """Return the axes in which a camera differs from the base."""
    return [name for name in AXES if values[name] != base_values[name]]


def name_of(camera: Camera, base: Camera) -> str:
    """Name a camera by its differences from the base: "baseline 100 mm"."""
    differences = [
        f"{AXES[name].word} {AXES[name].shown(camera.values[name])}"
        for name in _moved(camera.values, base.values)
    ]
    return ", ".join(differences) or "base"


def along(name: str, swept: Sequence[Camera]) -> list[Camera]:
    """Return the base and the cameras that differ from it in one axis only, sorted by value."""
    base = swept[0].values
    held = [camera for camera in swept if {**camera.values, name: base[name]} == dict(base)]
    return sorted(held, key=lambda camera: camera.values[name])
