"""What a sweep varies of a depth camera, and the cameras that come of it."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from starling.patterns import errors
from starling.sim.render import emission
from starling.sim.sensor import edits as sensor_edits
from starling.sim.sensor.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True)
class Axis:
    """One parameter of a camera's design."""

    word: str  # What it is, in short.
    label: str  # And at length.
    unit: str  # That a reader sees; `scale` times the value.
    scale: float
    of: Callable[[Sensor], float]
    into: Callable[[Sensor, float], Sensor]
    usual: Callable[[Sensor], tuple[float, ...]]  # What is swept where no values are given.

    def shown(self, value: float) -> str:
        """The value in the unit that a reader sees."""
        return f"{self.scale * value:.4g} {self.unit}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Camera:
    """One camera of a sweep."""

    values: Mapping[str, float]  # Of every axis, in SI units, by its name in `AXES`.
    sensor: Sensor


def with_focal(sensor: Sensor, focal_px: float) -> Sensor:
    """Change the field of view at the same image size, f-number and pixel pitch.

    Both focal lengths [px] grow alike and the principal point stays; an imager's defocus grows
    with the focal length squared (thin lens, f^2 / (4 N pitch)). The projector's field stays.
    """
    ratio = focal_px / sensor.fx_px
    edits = [("fx_px", focal_px), ("fy_px", ratio * sensor.fy_px)]
    for side in ("left", "right"):
        defocus = getattr(sensor, side).lens.defocus_px_m
        edits.append((f"{side}.lens.defocus_px_m", ratio**2 * defocus))
    return sensor_edits.with_values(sensor, edits)


AXES: dict[str, Axis] = {
    "baseline_m": Axis(
        word="baseline",
        label="Baseline",
        unit="mm",
        scale=1e3,
        of=lambda sensor: sensor.baseline_m,
        into=lambda sensor, value: dataclasses.replace(sensor, baseline_m=value),
        usual=lambda _: (0.02, 0.035, 0.1, 0.15),
    ),
    "focal_px": Axis(
        word="focal length",
        label="Focal length at one image size",
        unit="px",
        scale=1.0,
        of=lambda sensor: sensor.fx_px,
        into=with_focal,
        usual=lambda sensor: (0.7 * sensor.fx_px, 1.4 * sensor.fx_px, 2 * sensor.fx_px),
    ),
    "projector_x_m": Axis(
        word="projector x",
        label="Projector, to the right of the left imager",
        unit="mm",
        scale=1e3,
        of=lambda sensor: sensor.projector.position_m[0],
        into=lambda sensor, value: sensor_edits.with_values(
            sensor, [("projector.position_m.x", value)]
        ),
        usual=lambda _: (-0.05, 0.0, 0.1),
    ),
    "dot_density": Axis(
        word="dots",
        label="Dot density over the pattern's own",
        unit="x",
        scale=1.0,
        of=lambda sensor: sensor.projector.dot_density,
        into=lambda sensor, value: sensor_edits.with_values(
            sensor, [("projector.dot_density", value)]
        ),
        # An image has the dots it has.
        usual=lambda sensor: (0.25, 0.5, 2.0, 4.0) if _is_drawn(sensor) else (),
    ),
}


def _is_drawn(sensor: Sensor) -> bool:
    emitters = emission.emitters(sensor.projector)
    return all(one.pattern in emission.GENERATORS for one in emitters)


def chosen(base: Sensor, asked: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, ...]]:
    """The values of every axis that is swept: those asked for, or all axes' usual ones.

    Raises:
        InputError: an unknown axis.
    """
    for name in asked:
        errors.one_of("axis", name, AXES)
    named = {name: tuple(map(float, values)) for name, values in asked.items() if len(values)}
    return named or {name: axis.usual(base) for name, axis in AXES.items()}


def cameras(
    base: Sensor, axes: Mapping[str, Sequence[float]], *, full: bool = False
) -> list[Camera]:
    """The cameras of a sweep about a base, the base itself always among them and first.

    Args:
        base: a stereo camera.
        axes: values of each axis, beside the base's own, by name in `AXES`.
        full: all combinations (full factorial); else at most one axis departs from the base.

    Raises:
        InputError: structured light, an unknown axis, or a value that no camera can have.
    """
    if base.kind != "stereo":
        raise errors.refuse(
            "sensor",
            "must be a stereo camera: with structured light the projector is at the baseline",
            base.name,
            "Sweep another one, such as d435.",
        )
    for name in axes:
        errors.one_of("axis", name, AXES)
    own = {name: axis.of(base) for name, axis in AXES.items()}
    levels = [dict.fromkeys((own[name], *axes.get(name, ()))) for name in AXES]
    found = []
    for combination in itertools.product(*levels):
        values = dict(zip(AXES, combination, strict=True))
        moved = _moved(values, own)
        if not full and len(moved) > 1:
            continue
        sensor = base
        for name in moved:
            sensor = AXES[name].into(sensor, values[name])
        found.append(Camera(values=values, sensor=sensor))
    order = list(AXES)
    return sorted(found, key=lambda one: [order.index(name) for name in _moved(one.values, own)])


def _moved(values: Mapping[str, float], own: Mapping[str, float]) -> list[str]:
    """The axes in which a camera departs from the base."""
    return [name for name in AXES if values[name] != own[name]]


def name_of(camera: Camera, base: Camera) -> str:
    """Say what tells a camera from the base: "baseline 100 mm"."""
    said = [
        f"{AXES[name].word} {AXES[name].shown(camera.values[name])}"
        for name in _moved(camera.values, base.values)
    ]
    return ", ".join(said) or "base"


def along(name: str, swept: Sequence[Camera]) -> list[Camera]:
    """Those cameras that differ from the first, the base, in one axis alone, by its value."""
    base = swept[0].values
    held = [camera for camera in swept if {**camera.values, name: base[name]} == dict(base)]
    return sorted(held, key=lambda camera: camera.values[name])
