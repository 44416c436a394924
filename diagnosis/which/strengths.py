"""At which strengths candidates are simulated: at few first, closer where it matters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from diagnosis.which.bench import Bench
from diagnosis.which.candidates import Candidate
from diagnosis.which.fit import Fit, Folds, fit
from diagnosis.which.likelihood import Likelihood
from diagnosis.which.made import Made
from diagnosis.which.signature import Signature, with_node
from sim.effects.effect import Value

_SHARP = 4  # Candidates that are simulated where they fit best,
_PROMISING = 0.5  # Of the threshold, that the best of them gains,
_NEAR = 0.5  # if they gain nearly as much as the best: all but this share.
_AT_A_NODE = 0.1  # Places from a node within which nothing is simulated anew,
_FINE = 0.15  # unless the next is farther off than twice this share of the node's strength.
_ROUNDS = 3  # Of simulating where one fits.


def coarse(candidate: Candidate) -> list[Value]:
    """Nodes at which a candidate is tried first: all words; of numbers, whole ones too, a weak and
    a strong one to each side.

    A strong one alone would do for effects that grow in proportion; but few do. Where each has to
    be rendered, which takes most of a screening's time, it is one in the middle.
    """
    if any(isinstance(node, str) for node in candidate.nodes):
        return list(candidate.nodes)
    base = float(candidate.base)
    below = [node for node in candidate.nodes if float(node) < base][::-1]
    above = [node for node in candidate.nodes if float(node) > base]
    rendered = bool(candidate.effect.rerender)
    found = [side[at] for side in (below, above) for at in _tried(len(side), rendered=rendered)]
    return sorted(found, key=float)


def fine(of: Fit) -> list[Value]:
    """Nodes of a candidate that is worth it: all to the side where it fits, else those tried first.

    Args:
        of: one of those tried first.
    """
    candidate = of.signature.candidate
    if not candidate.numeric:
        return list(candidate.nodes)
    base, tried = float(candidate.base), coarse(candidate)
    above = float(of.value) >= base
    return [node for node in candidate.nodes if node in tried or (float(node) > base) == above]


def _tried(count: int, *, rendered: bool) -> list[int]:
    """Which of so many nodes, from weak to strong, are tried."""
    if not count:
        return []
    return [count // 2] if rendered else sorted({count // 3, count - 1 - count // 4})


def sharper(
    signatures: Sequence[Signature],
    bench: Bench,
    likelihood: Likelihood,
    folds: Folds,
    threshold: float,
    given: Made,
    *,
    gained: float = 0.0,
) -> list[Fit]:
    """Fit candidates on top of others, those that gain most first, the best and those that come
    near it simulated at the strength where each fits, until none fits elsewhere.

    Between nodes an effect is only as right as a straight line is, and that must not decide.

    Args:
        signatures, bench, likelihood, folds, threshold: as `search`.
        given: what others make.
        gained: by one that is simulated so already.
    """
    found = _ranked([fit(one, likelihood, folds, given=given) for one in signatures])
    for _ in range(_ROUNDS):
        best = max([gained, *(one.total for one in found[:1])])
        if best < _PROMISING * threshold:
            break
        least = best - max(threshold, _NEAR * best)
        near = [one for one in found[:_SHARP] if one.total > least]
        values = {one.name: value for one in near if (value := _closer(one)) is not None}
        if not values:
            break
        for number, one in enumerate(found):
            if one.name in values:
                sharp = with_node(one.signature, values[one.name], bench)
                found[number] = fit(sharp, likelihood, folds, given=given)
        found = _ranked(found)
    return found


def _ranked(fits: Sequence[Fit]) -> list[Fit]:
    return sorted(fits, key=lambda one: -one.total)


def _closer(of: Fit) -> Value | None:
    """The strength at which to simulate next: where it fits, and at a node halfway to the better of
    its neighbours; None where that is no news.
    """
    one, node = of.signature, round(of.place)
    if not one.candidate.numeric:
        return None
    if abs(of.place - node) > _AT_A_NODE:
        return one.value(of.place)
    cost = of.cost.sum(axis=1)[np.isin(of.places, range(len(one.values)))]
    beside = [n for n in (node - 1, node + 1) if 0 <= n < len(one.values)]
    better = min(beside, key=lambda n: cost[n])
    value = one.value(0.5 * (node + better))
    here, base = float(one.values[node]), float(one.candidate.base)
    apart = abs(float(value) - here)
    return value if apart > _FINE * abs(here - base) and value not in one.values else None
