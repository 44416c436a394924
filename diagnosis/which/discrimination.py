"""Which capture would tell apart what these captures cannot: rivals are simulated in each."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes import scene_model
from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.scenes.scene_model import Subject
from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.null import FLOOR
from starling.diagnosis.which.residuals import group
from starling.diagnosis.which.rows import BITS
from starling.diagnosis.which.table import bench
from starling.patterns.errors import InputError
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Value
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Scene
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

_SEEDS = 4  # Of the noise of a proposed capture.
_REPEATS = 8
_NOTHING = Reading(left=None, right=None, ours_px=None, device_px=None)
_MOST = 4.0  # Deviations of one feature that count: one alone must not reach `TOLD`.
_FILTERS = {
    "decimation": 1.0,
    "spatial_filter": 1.0,
    "temporal_filter": 1.0,
    "hole_filling": "off",
}
TOLD = 5.0  # Root sum of squares over groups of features from which a capture tells rivals apart.

Setup = tuple[Scene, Sensor]
Readings = tuple[Sequence[str], NDArray[np.float64]]  # Features, and (seeds, features).


@dataclass(frozen=True, kw_only=True, slots=True)
class Proposal:
    """A capture to take."""

    text: str
    cost: float  # Effort, 1 for a switch.
    frames: int
    setups: Callable[[Scene, Sensor], Sequence[Setup]]
    arms: frozenset[Arm] = frozenset(Arm)  # In which it shows anything.


@dataclass(frozen=True, kw_only=True, slots=True)
class Told:
    """How well a capture tells two rivals apart."""

    capture: str
    rivals: tuple[str, str]
    deviations: float  # Root sum of squares over groups of features.

    @property
    def enough(self) -> bool:
        """Whether it is worth taking."""
        return self.deviations >= TOLD


def _projector_off(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    return [(scene, with_values(sensor, [("projector.power_w", 0.0)]))]


def _cap_on(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    dark = dataclasses.replace(
        _lit(scene, 0.0),
        sun=dataclasses.replace(scene.sun, irradiance_w_m2=0.0),
        other_projector=dataclasses.replace(scene.other_projector, power_w=0.0),
    )
    return [(dark, with_values(sensor, [("projector.power_w", 0.0)]))]


def _lamp_on(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    return [(_lit(scene, 4 * scene.ambient.irradiance_w_m2 + 1.0), sensor)]


def _exposed_longer(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    longer = 2 * sensor.left.exposure_s
    return [(scene, with_values(sensor, [("imager.exposure_s", longer)]))]


def _walls(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    return [(_at_wall(scene, scenes.wall(z)), sensor) for z in (0.6, 1.2, 2.4)]


def _at_wall(scene: Scene, wall: Scene) -> Scene:
    """The wall in the scene's light, by a camera that moves as there; what the scene's surfaces are
    like, and where they truly stand, stays with them.
    """
    light = dataclasses.replace(scene.ambient, up=wall.ambient.up)
    return dataclasses.replace(
        wall,
        ambient=light,
        sun=scene.sun,
        other_projector=scene.other_projector,
        interreflection=scene.interreflection,
        motion=scene.motion,
    )


def _as_is(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    return [(scene, sensor)]


def _filters_off(scene: Scene, sensor: Sensor) -> Sequence[Setup]:
    return [(scene, setting.on_sensor(sensor, _FILTERS))]


def _lit(scene: Scene, irradiance_w_m2: float) -> Scene:
    ambient = dataclasses.replace(scene.ambient, irradiance_w_m2=irradiance_w_m2)
    return dataclasses.replace(scene, ambient=ambient)


MENU = (
    Proposal(text="the same scene with the projector off", cost=1, frames=1, setups=_projector_off),
    Proposal(text="a lens cap on", cost=1, frames=_REPEATS, setups=_cap_on),
    Proposal(text="the same scene with a lamp on", cost=1, frames=1, setups=_lamp_on),
    Proposal(text="the same scene exposed twice as long", cost=1, frames=1, setups=_exposed_longer),
    Proposal(text=f"{_REPEATS} repeats of the same scene", cost=1, frames=_REPEATS, setups=_as_is),
    Proposal(
        text="the same scene with the depth filters off",
        cost=1,
        frames=1,
        setups=_filters_off,
        arms=frozenset({Arm.DEPTH, Arm.WHOLE}),
    ),
    Proposal(text="a flat wall at 0.6, 1.2 and 2.4 m", cost=3, frames=1, setups=_walls),
)


def tell_apart(
    of: Subject,
    one: Mapping[str, Value],
    other: Mapping[str, Value],
    arm: Arm,
    *,
    menu: Sequence[Proposal] = MENU,
) -> list[Told]:
    """Simulate two rivals in every capture of a menu.

    Args:
        of: a scene that was captured.
        one: settings of a rival.
        other: of the other.
        arm: in which the rivals act.
        menu: captures that could be taken.

    Returns:
        The captures, the one that tells most for its cost first; those in which a rival cannot be
        simulated are left out.
    """
    names = (", ".join(one), ", ".join(other))
    found = []
    for proposal in menu:
        if arm not in proposal.arms:
            continue
        squares = _squares(one, other, of, arm, proposal)
        if squares is not None:
            told = Told(capture=proposal.text, rivals=names, deviations=float(np.sqrt(squares)))
            found.append((told.deviations / proposal.cost, told))
    return [told for _, told in sorted(found, key=lambda pair: -pair[0])]


def _squares(
    one: Mapping[str, Value],
    other: Mapping[str, Value],
    of: Subject,
    arm: Arm,
    proposal: Proposal,
) -> float | None:
    """Sum over groups of features of the squared difference of two rivals over its deviation."""
    # A pair that was put out lacks the bits that its device's matcher reads: the bench makes these.
    rematched = [BITS] if arm is Arm.DEPTH else []
    bits = [{k: v for k, v in rival.items() if k in rematched} for rival in (one, other)]
    rest = [{k: v for k, v in rival.items() if k not in rematched} for rival in (one, other)]
    each = [_setups(rival, of, proposal) for rival in rest]
    supposed = [setups for setups in each if setups is not None]
    if len(supposed) < len(each):
        return None
    total = 0.0
    for number, (scene, sensor) in enumerate(proposal.setups(of.scene, of.sensor)):
        base = _taken(of, scene, sensor, proposal, number)
        if arm is Arm.DEPTH:
            base = dataclasses.replace(base, real=base.capture({}, seed=0))
        tables = []
        for setups, finer in zip(supposed, bits, strict=True):
            # What a rival changes is seen in the bins of what is believed.
            taken = _taken(of, *setups[number], proposal, number)
            taken = dataclasses.replace(taken, real=base.real, ground=base.ground)
            table = bench([taken], arm)
            seeds = range(1 if arm is Arm.DEPTH else _SEEDS)
            simulated = [table.simulated(finer, seed=seed) for seed in seeds]
            known = [found for found in simulated if found is not None]
            if len(known) < len(simulated):
                return None
            tables.append((table.names, np.concatenate(known)))
        total += _apart(*tables)
    return total


def _setups(rival: Mapping[str, Value], of: Subject, proposal: Proposal) -> Sequence[Setup] | None:
    """A proposal done to the scene and the camera that a rival supposes; None where neither goes.

    The rival is first: what is switched off in a proposal stays off.
    """
    try:
        sensor, scene = setting.apply(of.sensor, of.scene, of.own(rival))
        return proposal.setups(scene, sensor)
    except InputError:
        return None


def _taken(of: Subject, scene: Scene, sensor: Sensor, proposal: Proposal, number: int) -> Subject:
    return scene_model.of_scene(
        scene,
        sensor,
        name=f"{of.name} {number}",
        room=of.room,
        truth_m=None,
        real=_NOTHING,
        frames=proposal.frames,
    )


def _apart(one: Readings, other: Readings) -> float:
    """Squared deviations between readings, each group of features that tell alike as one."""
    names = sorted({*one[0]} & {*other[0]})
    first, second = (rows[:, [told.index(name) for name in names]] for told, rows in (one, other))
    spread = np.full(len(names), FLOOR)
    if len(first) > 1:
        both = 0.5 * (first.var(axis=0, ddof=1) + second.var(axis=0, ddof=1))
        spread = np.sqrt(both + FLOOR**2)
    off = np.minimum(np.abs(first.mean(axis=0) - second.mean(axis=0)) / spread, _MOST)
    groups: dict[str, list[float]] = {}
    for name, deviations in zip(names, off, strict=True):
        if np.isfinite(deviations):
            groups.setdefault(group(name), []).append(float(deviations) ** 2)
    return float(sum(np.mean(squares) for squares in groups.values()))
