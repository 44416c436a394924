"""What a plan's view is: scene, camera, pose and seed, by its number alone."""

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
class View:
    """One pose of one camera before one scene; its frames are repeats."""

    number: int
    scene: int  # Number of the scene, which some views share.
    name: str  # Of its folder in the capture set.
    room: str
    setting: Setting
    preset: str
    fields: Mapping[str, Any]  # Of the sensor, by dotted path.
    effects: Mapping[str, Value]
    own_from_left: Pose  # Where it stands in the frame of the scene's own left imager.
    seed: int


def view(plan: Plan, number: int) -> View:
    """Draw a view.

    Each value is drawn by its own name, so that one more in the plan moves no other.

    Args:
        plan: whose.
        number: from 0, below scenes times views.
    """
    scene, _ = divmod(number, plan.views)
    source = _weighted(plan.sources, _rng(plan, scene, "source"))
    setting = source.chosen(_rng(plan, scene, "scene"))
    sensor = _weighted(plan.sensors, _rng(plan, number, "sensor"))
    shift = _drawn(plan, number, "shift_m", plan.pose.shift_m)
    turn = _drawn(plan, number, "turn_deg", plan.pose.turn_deg)
    return View(
        number=number,
        scene=scene,
        name=f"{number:07d}",
        room=setting.room,
        setting=setting,
        preset=sensor.preset,
        fields={
            path: one.drawn(_rng(plan, number, f"field {path}"))
            for path, one in sensor.fields.items()
        },
        effects={
            name: one.drawn(_rng(plan, number, f"effect {name}"))
            for name, one in sensor.effects.items()
        },
        own_from_left=frames.pose(shift, turn),
        seed=int(_rng(plan, number, "seed").integers(2**53)),
    )


def _drawn(
    plan: Plan, number: int, what: str, draws: tuple[Draw, Draw, Draw]
) -> tuple[float, float, float]:
    x, y, z = (
        float(one.drawn(_rng(plan, number, f"{what}.{axis}")))
        for one, axis in zip(draws, "xyz", strict=True)
    )
    return x, y, z


def _rng(plan: Plan, number: int, what: str) -> np.random.Generator:
    return randomness.generator(plan.seed, number, "plan", what)


class _Weighted(Protocol):
    @property
    def weight(self) -> float: ...


_W = TypeVar("_W", bound=_Weighted)


def _weighted(many: Sequence[_W], rng: np.random.Generator) -> _W:
    """Draw one of several by their weights."""
    ends = np.cumsum([one.weight for one in many])
    return many[int(np.searchsorted(ends, rng.uniform(0.0, ends[-1]), side="right"))]
