"""Detection limits: how strong each effect must be in these scenes to be accepted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from starling.diagnosis.which import null
from starling.diagnosis.which.fit import fit, places
from starling.diagnosis.which.likelihood import Likelihood
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.segment import Screening, SegmentResult
from starling.sim.effects.effect import Value

POWER = 0.5  # Share of simulated captures with the effect in which it must gain enough.
_COARSE_STEPS = 4  # Positions tried between two nodes.


@dataclass(frozen=True, kw_only=True, slots=True)
class DetectionLimit:
    """Values of one effect from which it passes the threshold in half of the captures."""

    name: str  # Name of the candidate.
    base: Value
    below: Value | None  # None if no simulated value below the base is detected.
    above: Value | None


def remaining_gap(segment: SegmentResult) -> Likelihood:
    """Return the likelihood of the gap that the accepted effects of a segment leave."""
    likelihood = segment.likelihood
    return replace(likelihood, gap=segment.search.residual * likelihood.deviation)


def detection_limits(
    screening: Screening, remaining: Sequence[Likelihood] = ()
) -> list[DetectionLimit]:
    """Estimate the limits of all screened effects except choices.

    No further value is simulated. The screening has few values, so the limits are coarse.

    Args:
        screening: screening of the segment.
        remaining: gaps in which the effect has to be detected; empty takes simulated captures
            without a gap.
    """
    return [
        DetectionLimit(
            name=signature.name,
            base=signature.candidate.base,
            below=detection_limit(signature, screening, remaining, upwards=False),
            above=detection_limit(signature, screening, remaining, upwards=True),
        )
        for signature in screening.signatures
        if signature.candidate.numeric
    ]


def detection_limit(
    signature: Signature,
    screening: Screening,
    remaining: Sequence[Likelihood] = (),
    *,
    upwards: bool,
    steps: int = _COARSE_STEPS,
) -> Value | None:
    """Find the value nearest to the base beyond which all values are detected.

    Args:
        signature: signature of the effect.
        screening: screening of the segment.
        remaining: as `detection_limits`.
        upwards: search above the base, else below.
        steps: positions tried between two nodes.
    """
    tried = places(signature, steps)
    base = float(signature.values.index(signature.candidate.base))
    inwards = tried[tried > base][::-1] if upwards else tried[tried < base]
    nearest = None
    for place in inwards:
        if not is_detected(signature, float(place), screening, remaining):
            break
        nearest = signature.value(float(place))
    return nearest


def is_detected(
    signature: Signature,
    place: float,
    screening: Screening,
    remaining: Sequence[Likelihood] = (),
) -> bool:
    """Whether an effect gains enough in half of the captures if it is added to them.

    Args:
        signature: signature of the effect.
        place: position between its values.
        screening: screening of the segment.
        remaining: as `detection_limits`.
    """
    change = signature.change_at(place).change
    if remaining:
        likelihoods = [replace(gap, gap=gap.gap + change) for gap in remaining]
    else:
        likelihoods = [
            base.likelihood(capture + change, screening.weight)
            for base, capture in null.leave_one_out(screening.base)
        ]
    return gains_enough(signature, likelihoods, screening)


def gains_enough(
    signature: Signature, likelihoods: Sequence[Likelihood], screening: Screening
) -> bool:
    """Whether an effect passes the threshold in a share `POWER` of some captures.

    Args:
        signature: signature of the effect.
        likelihoods: likelihoods of captures with the effect.
        screening: screening of the segment.
    """
    gains = [
        fit(signature, likelihood, screening.folds, steps=_COARSE_STEPS).total
        for likelihood in likelihoods
    ]
    return sum(gain >= screening.threshold for gain in gains) >= POWER * len(likelihoods)
