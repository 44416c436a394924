"""Effects that may have made a gap, and the strengths at which each is simulated."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from starling.sim import effects
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Effect, Parameter, Stage, Value
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor

_NODES = 4  # Strengths of an effect, to each side where it has two.
_LEAST = 1 / 30  # The weakest over the strongest, of effects of both signs.
_WIDE = 4.0  # Ranges above this ratio are stepped by factors.
_NO_NEWS = 0.01  # Share by which what captures tell differs from the base at least.
# Without a partner they do nothing, or repeats alone show them, or they change the image's size.
LEFT_OUT = frozenset({"rolling_shutter", "temporal_filter", "decimation", "registration"})
# Images are put out without them in any case: only depth of the device's own shows them.
_UNSEEN = frozenset({"dropped_bits"})
_MOVES = frozenset({"motion", "turning"})


class Arm(Enum):
    """Half of the stage swap that an effect shows in, or its whole where there is no half."""

    IMAGE = "image"  # Simulated against real infrared, both matched by our matcher.
    DEPTH = "depth"  # Our matcher's depth of the real infrared against the device's own.
    WHOLE = "whole"  # Simulated depth against the device's own, where no infrared was captured.


@dataclass(frozen=True, kw_only=True, slots=True)
class Candidate:
    """A parameter of an effect, with the values that are simulated."""

    name: str  # `EFFECT` or `EFFECT.PARAMETER`.
    effect: Effect
    arm: Arm
    base: Value  # Where the sensor at hand has it.
    nodes: tuple[Value, ...]  # Other values, numbers ascending.
    whole: bool = False  # Whether it takes whole numbers alone.
    told: Value | None = None  # The value that captures tell by themselves, which is a node then.

    @property
    def numeric(self) -> bool:
        """Whether values in between mean something."""
        return not setting.parameter_of(self.name)[1].choices


def candidates(sensor: Sensor, scene: Scene, arm: Arm) -> list[Candidate]:
    """List what may have made a gap in one arm.

    Rows are moved by each of their parameters: those that do nothing while the first is at its
    neutral, such as where a second projector stands, wait until that is accepted.

    Args:
        sensor: the base.
        scene: likewise.
        arm: matcher, post-processing and bits that only the matcher reads act on depth, all else
            on the image, all on the whole.
    """
    late = (Stage.MATCHER, Stage.POST)
    found = []
    for effect in effects.table():
        if effect.name in LEFT_OUT:
            continue
        of_depth = effect.stage in late or effect.name in _UNSEEN
        if arm is not Arm.WHOLE and of_depth != (arm is Arm.DEPTH):
            continue
        for number, parameter in enumerate(effect.parameters):
            base = setting.value(parameter, sensor, scene)
            if base is None:
                continue
            name = effect.name if number == 0 else f"{effect.name}.{parameter.name}"
            whole = setting.whole(parameter, sensor)
            values = nodes(parameter, base, whole=whole)
            if effect.name in _MOVES and not sensor.left.rolling_shutter_s:
                values = tuple(
                    one for one in values if float(one) > float(base)
                )  # The way back blurs alike.
            if values:
                found.append(
                    Candidate(
                        name=name, effect=effect, arm=arm, base=base, nodes=values, whole=whole
                    )
                )
    return found


def with_told(candidate: Candidate, value: float) -> Candidate:
    """The same with a node at what captures tell by themselves; as it is where that is its base.

    Args:
        candidate: one that takes numbers.
        value: of its parameter.
    """
    if abs(value - float(candidate.base)) < _NO_NEWS * value:
        return candidate
    found = sorted({*map(float, candidate.nodes), value})
    return dataclasses.replace(candidate, nodes=tuple(found), told=value)


def nodes(parameter: Parameter, base: Value, *, whole: bool = False) -> tuple[Value, ...]:
    """Values at which an effect is simulated, the base left out.

    Strengths rise by factors from the least to the greatest worth trying; effects of both signs
    depart from the base to both sides.
    """
    if parameter.choices:
        return tuple(choice for choice in parameter.choices if choice != base)
    assert parameter.low is not None and parameter.high is not None
    assert not isinstance(base, str)
    low, high = parameter.low, parameter.high
    values: Sequence[float]
    if low < 0 < high or (low < 1 < high and parameter.neutral == 1 and high / low < _WIDE):
        up, down = high - base, base - low
        steps = np.geomspace(_LEAST, 1, _NODES)
        values = [*(base - down * steps), *(base + up * steps)]
    elif low > 0:
        values = [*np.geomspace(low, high, 2 * _NODES - 2)]
        if parameter.neutral == 0 and base != 0:
            values.append(0.0)
    else:
        values = [*np.linspace(low, high, 2 * _NODES - 2)]
    kept = {round(float(value), 0 if whole else 9) for value in values}
    return tuple(sorted(value for value in kept if abs(value - base) > 1e-9 * max(1, abs(base))))
