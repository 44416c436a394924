"""How strong an effect would have to be to be noticed, by what it does to these scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from starling.diagnosis.which import null
from starling.diagnosis.which.fit import fit, places
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.segment import Screen
from starling.sim.effects.effect import Value

POWER = 0.5  # Share of the readings in which an effect that is there has to gain enough.
_ROUGH = 4  # Strengths tried between two nodes.


@dataclass(frozen=True, kw_only=True, slots=True)
class Noticed:
    """Values of one effect from which on its own gain passes the threshold in half of some
    simulated readings; None where no value of its range that was simulated does.
    """

    name: str  # The candidate's.
    base: Value
    below: Value | None
    above: Value | None


def noticed(screen: Screen) -> list[Noticed]:
    """Ask of every effect that was simulated, choices aside; no more is simulated.

    Few strengths were, so between them it is rough.
    """
    return [
        Noticed(
            name=one.name,
            base=one.candidate.base,
            below=least(one, screen, upwards=False, steps=_ROUGH),
            above=least(one, screen, upwards=True, steps=_ROUGH),
        )
        for one in screen.rough
        if one.candidate.numeric
    ]


def least(of: Signature, screen: Screen, *, upwards: bool, steps: int) -> Value | None:
    """The value nearest to the base from which on all are noticed to one side.

    Args:
        of: the effect.
        screen: of the arm.
        upwards: to which side.
        steps: strengths tried between two nodes.
    """
    tried = places(of, steps)
    base = float(of.values.index(of.candidate.base))
    inwards = tried[tried > base][::-1] if upwards else tried[tried < base]
    nearest = None
    for place in inwards:
        if not at(of, float(place), screen):
            break
        nearest = of.value(float(place))
    return nearest


def at(of: Signature, place: float, screen: Screen) -> bool:
    """Whether half of the seeds, with the effect in them, give it enough gain.

    Args:
        of: the effect.
        place: between its values.
        screen: of the arm.
    """
    readings = [
        base.likelihood(reading + of.at(place).change, screen.weight)
        for base, reading in null.readings(screen.base)
    ]
    return enough(of, readings, screen)


def enough(of: Signature, readings: Sequence[Likelihood], screen: Screen) -> bool:
    """Whether an effect gains as much as it has to in enough of some readings.

    Args:
        of: the effect.
        readings: with it in them.
        screen: of the arm.
    """
    gains = [fit(of, one, screen.folds, steps=_ROUGH).total for one in readings]
    return sum(gain >= screen.threshold for gain in gains) >= POWER * len(readings)
