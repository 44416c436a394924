"""The plan of a data set, read from a TOML file: scenes, sensors, poses and the views it draws.

Scene, camera, pose and seed of a view depend only on the view's number.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol, TypeVar, get_args

import numpy as np

from starling.patterns import errors
from starling.sim import files, quantities, randomness
from starling.sim.console.names import distinct_names
from starling.sim.datasets import draw
from starling.sim.datasets.draw import Draw, Fixed, refuse_unknown, text, weight
from starling.sim.datasets.source import SceneFiles, Setting, Source, read_source
from starling.sim.effects import setting
from starling.sim.effects.effect import Value
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.sensor import edits, presets

Layer = Literal["infrared", "truth", "reason", "rgb", "exr"]  # Depth is always written.
Missing = Literal["stop", "skip"]

LAYERS: tuple[Layer, ...] = get_args(Layer)
_MOST = 10**9


@dataclass(frozen=True, kw_only=True, slots=True)
class SensorPlan:
    """A camera, and the values that are drawn for each view."""

    preset: str  # Preset name or sensor file.
    mode: str = ""  # Mode of the camera, as for `--mode`; empty is the sensor's own.
    name: str = ""  # Distinct name in the index; empty takes the file's stem.
    weight: float = 1.0
    fields: Mapping[str, Draw] = field(default_factory=dict)  # By dotted path, as for `--set`.
    effects: Mapping[str, Draw] = field(default_factory=dict)  # By name, as for `--effect`.


@dataclass(frozen=True, kw_only=True, slots=True)
class PosePlan:
    """Displacement of a view from the scene's own pose, in the left imager's frame."""

    shift_m: tuple[Draw, Draw, Draw]
    turn_deg: tuple[Draw, Draw, Draw]  # Rotation vector.


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan:
    """Everything that determines the frames of a set."""

    seed: int
    scenes: int
    views: int = 1  # Views per scene.
    frames: int = 1  # Frames per view; they differ in noise.
    samples: int = 0  # Paths per coarse pixel for indirect light; 0 disables it.
    layers: tuple[Layer, ...] = ("infrared", "truth")
    missing: Missing = "stop"  # Reaction to a missing scene file: stop the run or skip the view.
    sources: tuple[Source, ...]
    sensors: tuple[SensorPlan, ...]
    pose: PosePlan

    @property
    def count(self) -> int:
        """Total number of frames."""
        return self.scenes * self.views * self.frames


def read(path: Path) -> Plan:
    """Read a plan; relative paths start at the folder of the file.

    Raises:
        InputError: if the file is missing or no TOML, a key is unknown, or a range is invalid for
            the sensor.
    """
    return files.read_toml(path, lambda table: from_table(table, path.absolute().parent))


def from_table(table: Mapping[str, Any], folder: Path) -> Plan:
    """Build a plan from its table; relative paths start at `folder`."""
    known = ("seed", "scenes", "views", "frames", "samples", "layers", "missing", "source")
    refuse_unknown(table, (*known, "sensor", "pose"), "plan")
    numbers = {
        name: _whole(table, name, least, default)
        for name, least, default in (
            ("seed", 0, None),
            ("scenes", 1, None),
            ("views", 1, 1),
            ("frames", 1, 1),
            ("samples", 0, 0),
        )
    }
    total = numbers["scenes"] * numbers["views"] * numbers["frames"]
    quantities.check("scenes x views x frames", total, "frames_of_a_set")
    missing = table.get("missing", "stop")
    errors.one_of("missing", missing, get_args(Missing))
    return Plan(
        **numbers,
        layers=_layers(table.get("layers", ["infrared", "truth"])),
        missing=missing,
        sources=_distinct_rooms(
            [
                read_source(entry, folder, f"source {number}")
                for number, entry in enumerate(_listed(table, "source"), 1)
            ]
        ),
        sensors=_distinct_sensors(
            [
                _sensor(entry, folder, f"sensor {number}", numbers["frames"])
                for number, entry in enumerate(_listed(table, "sensor"), 1)
            ]
        ),
        pose=_pose(table.get("pose", {})),
    )


def _distinct_rooms(sources: Sequence[Source]) -> tuple[Source, ...]:
    """Give files with equal names different rooms, also in different sources."""
    paths = [path for source in sources if isinstance(source, SceneFiles) for path in source.paths]
    rooms = distinct_names(paths)
    return tuple(
        dataclasses.replace(source, rooms=rooms) if isinstance(source, SceneFiles) else source
        for source in sources
    )


def _distinct_sensors(sensors: Sequence[SensorPlan]) -> tuple[SensorPlan, ...]:
    """Give sensor files with equal names different names in the index."""
    names = distinct_names(Path(sensor.preset) for sensor in sensors)
    return tuple(dataclasses.replace(sensor, name=names[Path(sensor.preset)]) for sensor in sensors)


def _whole(table: Mapping[str, Any], name: str, least: int, default: int | None) -> int:
    value = table.get(name, default)
    if value is None:
        raise errors.refuse(name, "must be given", "nothing", "Add the key.")
    if type(value) is not int:
        raise errors.refuse(name, "must be a whole number", repr(value), "Leave out the point.")
    errors.in_interval(name, value, least, 2**63 - 1 if name == "seed" else _MOST)
    return value


def _layers(value: Any) -> tuple[Layer, ...]:
    if not isinstance(value, list) or not value:
        raise errors.refuse("layers", "must list layers", repr(value), f"Choose from {LAYERS}.")
    for layer in value:
        errors.one_of("layer", layer, LAYERS)
    return tuple(layer for layer in LAYERS if layer in value)


def _listed(table: Mapping[str, Any], name: str) -> Sequence[Mapping[str, Any]]:
    entries = table.get(name, [])
    if (
        not isinstance(entries, list)
        or not entries
        or not all(isinstance(entry, dict) for entry in entries)
    ):
        raise errors.refuse(name, "must be one table or more", repr(entries), f"Write [[{name}]].")
    return entries


def _sensor(table: Mapping[str, Any], folder: Path, name: str, frames: int) -> SensorPlan:
    refuse_unknown(table, ("preset", "mode", "weight", "set", "effects"), name)
    preset = text(table, "preset", name, "d435")
    if preset.endswith(".toml"):
        preset = str(folder / preset)
    plan = SensorPlan(
        preset=preset,
        mode=text(table, "mode", name, "640x480") if "mode" in table else "",
        weight=weight(table, name),
        fields=_draws(table, "set", name),
        effects=_draws(table, "effects", name),
    )
    _refuse_impossible(plan, frames)
    return plan


def _draws(table: Mapping[str, Any], key: str, name: str) -> dict[str, Draw]:
    inner = table.get(key, {})
    if not isinstance(inner, Mapping):
        raise errors.refuse(f"{name}.{key}", "must be a table", repr(inner), "Give key = value.")
    return {path: draw.read(value, path) for path, value in inner.items()}


def _refuse_impossible(plan: SensorPlan, frames: int) -> None:
    """Try every end of every range separately, with the other values at their first end."""
    from starling.sim.scene.builtin import scenes
    from starling.sim.simulate import refuse_impossible

    base, scene = presets.load(plan.preset, mode=plan.mode), scenes.wall()
    first = {path: value.ends[0] for path, value in plan.fields.items()}
    effects = {name: value.ends[0] for name, value in plan.effects.items()}
    for path, value in plan.fields.items():
        for end in value.ends:
            changed = edits.with_values(base, {**first, path: end}.items())
            refuse_impossible(setting.on_sensor(changed, effects), frames)
    camera = edits.with_values(base, first.items())
    refuse_impossible(setting.on_sensor(camera, effects), frames)
    for name, value in plan.effects.items():
        for end in value.ends:
            changed, _ = setting.apply(camera, scene, {**effects, name: end})
            refuse_impossible(changed, frames)


def _pose(table: Any) -> PosePlan:
    if not isinstance(table, Mapping):
        raise errors.refuse("pose", "must be a table", repr(table), "Write [pose].")
    refuse_unknown(table, ("shift_m", "turn_deg"), "pose")
    return PosePlan(shift_m=_three(table, "shift_m"), turn_deg=_three(table, "turn_deg"))


def _three(table: Mapping[str, Any], key: str) -> tuple[Draw, Draw, Draw]:
    values = table.get(key, [0.0, 0.0, 0.0])
    if not isinstance(values, list) or len(values) != 3:
        raise errors.refuse(f"pose.{key}", "must be a list of 3", repr(values), "Give x, y, z.")
    x, y, z = (
        _number(value, f"pose.{key}.{axis}") for value, axis in zip(values, "xyz", strict=True)
    )
    return x, y, z


def _number(value: Any, name: str) -> Draw:
    number = draw.read(value, name)
    for end in number.ends:
        errors.in_interval(name, end, -1e3, 1e3)
    return Fixed(value=float(number.value)) if isinstance(number, Fixed) else number


@dataclass(frozen=True, kw_only=True, slots=True)
class PlannedView:
    """One pose of one camera in one scene; its frames differ in noise only."""

    number: int
    scene: int  # Number of the scene, which several views can share.
    name: str  # Name of its folder in the capture set.
    room: str
    setting: Setting
    preset: str
    mode: str
    sensor: str  # Name of the preset or sensor file in the index.
    fields: Mapping[str, Any]  # Fields of the sensor, by dotted path.
    effects: Mapping[str, Value]
    own_from_left: Pose  # Pose in the frame of the scene's own left imager.
    seed: int


def view(plan: Plan, number: int) -> PlannedView:
    """Draw a view.

    Each value has its own random stream by name, so an additional value in the plan changes no
    other value.

    Args:
        plan: plan of the data set.
        number: number of the view, from 0, below scenes times views.
    """
    scene, _ = divmod(number, plan.views)
    source = _weighted(plan.sources, _rng(plan, scene, "source"))
    setting = source.chosen(_rng(plan, scene, "scene"))
    sensor = _weighted(plan.sensors, _rng(plan, number, "sensor"))
    shift = _drawn(plan, number, "shift_m", plan.pose.shift_m)
    turn = _drawn(plan, number, "turn_deg", plan.pose.turn_deg)
    return PlannedView(
        number=number,
        scene=scene,
        name=f"{number:07d}",
        room=setting.room,
        setting=setting,
        preset=sensor.preset,
        mode=sensor.mode,
        sensor=sensor.name or Path(sensor.preset).stem,
        fields={
            path: draw.drawn(_rng(plan, number, f"field {path}"))
            for path, draw in sensor.fields.items()
        },
        effects={
            name: draw.drawn(_rng(plan, number, f"effect {name}"))
            for name, draw in sensor.effects.items()
        },
        own_from_left=frames.pose(shift, turn),
        seed=int(_rng(plan, number, "seed").integers(2**53)),
    )


def _drawn(
    plan: Plan, number: int, name: str, draws: tuple[Draw, Draw, Draw]
) -> tuple[float, float, float]:
    x, y, z = (
        float(draw.drawn(_rng(plan, number, f"{name}.{axis}")))
        for draw, axis in zip(draws, "xyz", strict=True)
    )
    return x, y, z


def _rng(plan: Plan, number: int, name: str) -> np.random.Generator:
    return randomness.generator(plan.seed, number, "plan", name)


class _Weighted(Protocol):
    @property
    def weight(self) -> float: ...


_W = TypeVar("_W", bound=_Weighted)


def _weighted(entries: Sequence[_W], rng: np.random.Generator) -> _W:
    """Draw an entry with probability proportional to its weight."""
    ends = np.cumsum([entry.weight for entry in entries])
    return entries[int(np.searchsorted(ends, rng.uniform(0.0, ends[-1]), side="right"))]
