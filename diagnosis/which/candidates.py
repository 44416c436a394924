"""Candidate effects of a pipeline segment, and the values at which they are simulated."""

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

_NODES = 4  # Nodes of a range; to each side for effects of both signs.
_LEAST = 1 / 30  # Ratio of the weakest to the strongest departure, for effects of both signs.
_WIDE = 4.0  # Ranges around 1 with high / low from this get geometric spacing.
_EQUAL = 0.01  # Relative difference up to which a measured value equals the base.
# Effects that do nothing without a partner, show only in repeats, or change the image size.
LEFT_OUT = frozenset({"rolling_shutter", "temporal_filter", "decimation", "registration"})
_DEPTH_ONLY = frozenset({"dropped_bits"})  # Output images lack these bits; only depth shows them.
_FINISH = "scene.finish."  # Paths of the finish, which acts on bodies alone.
_MOTIONS = frozenset({"motion", "turning"})


class Segment(Enum):
    """Part of the pipeline that an effect acts on."""

    IMAGE = "image"  # Simulated against real infrared, both matched by our matcher.
    DEPTH = "depth"  # Our matcher's depth of the real infrared against the device's depth.
    WHOLE = "whole"  # Simulated against device depth, if no infrared was captured.


@dataclass(frozen=True, kw_only=True, slots=True)
class Candidate:
    """A parameter of an effect, and its values to simulate."""

    name: str  # `EFFECT` or `EFFECT.PARAMETER`.
    effect: Effect
    segment: Segment
    base: Value  # Value in the given sensor or scene.
    nodes: tuple[Value, ...]  # Values besides the base, in ascending order if numeric.
    whole: bool = False  # Whether it is an integer parameter.
    measured: Value | None = None  # Value measured from the captures; it is one of the nodes.

    @property
    def is_further(self) -> bool:
        """Whether it is another parameter of an effect than the first."""
        return self.name != self.effect.name

    @property
    def numeric(self) -> bool:
        """Whether it takes intermediate values, unlike a choice."""
        return not setting.parameter_of(self.name)[1].choices


def effects_on_bodies() -> list[str]:
    """List the effects that act on bodies, not on the shapes of a Mitsuba XML."""
    return [effect.name for effect in effects.table() if _acts_on_bodies(effect)]


def _acts_on_bodies(effect: Effect) -> bool:
    return effect.parameters[0].paths[0].startswith(_FINISH)


def candidates(sensor: Sensor, scene: Scene, segment: Segment) -> list[Candidate]:
    """List the effects that may act in a segment.

    Each parameter of an effect is a candidate. Parameters that do nothing while the first one is
    neutral, such as the position of a second projector, are tried once the first is accepted.
    A scene of a Mitsuba XML has no bodies, so `effects_on_bodies` are left out.

    Args:
        sensor: the base.
        scene: a scene of the base.
        segment: matcher, post-processing and bits that only the matcher reads act on depth; all
            other effects act on the image; all act on the whole.
    """
    late = (Stage.MATCHER, Stage.POST)
    listed = []
    for effect in effects.table():
        if effect.name in LEFT_OUT or (not scene.bodies and _acts_on_bodies(effect)):
            continue
        of_depth = effect.stage in late or effect.name in _DEPTH_ONLY
        if segment is not Segment.WHOLE and of_depth != (segment is Segment.DEPTH):
            continue
        for number, parameter in enumerate(effect.parameters):
            base = setting.value(parameter, sensor, scene)
            if base is None:
                continue
            name = effect.name if number == 0 else f"{effect.name}.{parameter.name}"
            whole = setting.whole(parameter, sensor)
            values = nodes(parameter, base, whole=whole)
            if effect.name in _MOTIONS and not sensor.left.rolling_shutter_s:
                # Opposite motion gives the same blur.
                values = tuple(value for value in values if float(value) > float(base))
            if values:
                listed.append(
                    Candidate(
                        name=name,
                        effect=effect,
                        segment=segment,
                        base=base,
                        nodes=values,
                        whole=whole,
                    )
                )
    return listed


def with_measured_node(candidate: Candidate, value: float) -> Candidate:
    """Add a node at a value measured from the captures, unless it equals the base.

    Args:
        candidate: numeric candidate.
        value: measured value of its parameter.
    """
    if abs(value - float(candidate.base)) < _EQUAL * value:
        return candidate
    values = sorted({*map(float, candidate.nodes), value})
    return dataclasses.replace(candidate, nodes=tuple(values), measured=value)


def nodes(parameter: Parameter, base: Value, *, whole: bool = False) -> tuple[Value, ...]:
    """Choose the values at which an effect is simulated, without the base.

    Spacing is geometric, or linear if the range starts at 0. Effects of both signs get values on
    both sides of the base.

    Args:
        parameter: parameter of the effect.
        base: value in the given sensor or scene.
        whole: whether only integers are valid.
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
    rounded = {round(float(value), 0 if whole else 9) for value in values}
    return tuple(sorted(value for value in rounded if abs(value - base) > 1e-9 * max(1, abs(base))))
