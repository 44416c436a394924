"""Drawing of a plan's views: scene, camera, pose and seed depend only on the view's number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

from starling.sim import randomness
from starling.sim.datasets.draw import Draw
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.source import Setting
from starling.sim.effects.effect import Value
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose


@dataclass(frozen=True, kw_only=True, slots=True)
class PlannedView:
    """One pose of one camera in one scene; its frames differ in noise only."""

    number: int
    scene: int  # Number of the scene, which several views can share.
    name: str  # Name of its folder in the capture set.
    room: str
    setting: Setting
    preset: str
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
