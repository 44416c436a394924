"""At which strengths candidates are simulated: at few first, closer where it matters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from starling.diagnosis.which.candidates import Arm, Candidate
from starling.diagnosis.which.fit import Fit
from starling.diagnosis.which.predicted import Made
from starling.diagnosis.which.response import Signature, with_node
from starling.diagnosis.which.trial import Trial
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Stage, Value

_SHARP = 4  # Candidates that are simulated where they fit best,
_PROMISING = 0.5  # Of the threshold, that the best of them gains,
_NEAR = 0.5  # if they gain nearly as much as the best: all but this share.
_HOPEFUL = 0.65  # As much less gain those that are simulated at one more of their nodes.
_NO_NEWS = 0.05  # Share of a strength by which the next that is simulated differs at least,
_FINE = 0.15  # and that by which one halfway to a neighbour does.
_ROUNDS = 5  # Of simulating where one fits.
_WIDE, _MANY = 40.0, 5  # Strongest over weakest of a range, and its nodes, that make it wide.
_BEYOND = 5.0  # Range's end over the strong one tried, from which that tells little of the end.
_AFTER_SEARCH = ("matcher.refinement.", "matcher.checks.")


def coarse(candidate: Candidate) -> list[Value]:
    """Nodes at which a candidate is tried first: all words and whole numbers; of others a weak and
    a strong one to each side.

    A strong one alone would do for effects that grow in proportion; but few do. Of ranges that end
    far beyond it, as those of dark current, the end is tried as well, and of all filters behind a
    matcher that read captured images: a limit of depth tells nothing of those beyond it. Where each
    has to be rendered, or pairs searched anew, which takes most of the time, it is one in the
    middle, of whole numbers too, but for ranges so wide that the middle tells nothing of their
    beginning. What captures tell by themselves is tried in any case.
    """
    slow = bool(candidate.effect.rerender) or _searches(candidate)
    if not candidate.numeric or (candidate.whole and not slow):
        return list(candidate.nodes)
    base = float(candidate.base)
    told = [] if candidate.told is None else [candidate.told]
    others = [node for node in candidate.nodes if node not in told]
    below = [node for node in others if float(node) < base][::-1]
    above = [node for node in others if float(node) > base]
    end = candidate.arm is Arm.DEPTH
    found = [side[at] for side in (below, above) for at in _tried(side, base, slow=slow, end=end)]
    return sorted([*found, *told], key=float)


def _searches(candidate: Candidate) -> bool:
    """Whether pairs are searched anew; refinement and checks work on winners that were found."""
    if candidate.effect.stage is not Stage.MATCHER:
        return False
    paths = setting.parameter_of(candidate.name)[1].paths
    return not all(path.startswith(_AFTER_SEARCH) for path in paths)


def _tried(side: Sequence[Value], base: float, *, slow: bool, end: bool) -> list[int]:
    """Which of the nodes to one side, from weak to strong, are tried; `end`: the last in any case,
    if that is not slow.
    """
    count = len(side)
    if not count:
        return []
    departures = [abs(float(node) - base) for node in side]
    if slow and departures[-1] >= _WIDE * departures[0] and count >= _MANY:
        return [count // 4, count - 1 - count // 4]
    if slow:
        return [count // 2]
    strong = count - 1 - count // 4
    end = end or departures[-1] > _BEYOND * departures[strong]
    return sorted({count // 3, strong, count - 1} if end else {count // 3, strong})


def sharper(
    signatures: Sequence[Signature],
    trial: Trial,
    given: Made,
    *,
    over: Made | None = None,
    gained: float = 0.0,
) -> list[Fit]:
    """Fit candidates on top of others, those that gain most first, the best and those that come
    near it simulated at the strength where each fits, until none fits elsewhere or some rounds are
    over.

    Between nodes an effect is only as right as a straight line is, and that must not decide. Nodes
    come first, for all that may come near: what is simulated at them serves other captures of the
    same scenes.

    Args:
        signatures: of the candidates.
        trial: the arm's.
        given: what others make beside a candidate.
        over: what they make without any; None where that is the same.
        gained: by one that is simulated so already.
    """
    threshold = trial.threshold
    found = _ranked([trial.fit(one, given=given, over=over) for one in signatures])
    for _ in range(_ROUNDS):
        best = max([gained, *(one.total for one in found[:1])])
        if best < _PROMISING * threshold:
            break
        values: dict[str, Value] = {}
        for rank, one in enumerate(found):
            short = best - one.total
            if short >= max(threshold, _HOPEFUL * best) or (value := _closer(one)) is None:
                continue
            near = rank < _SHARP and short < max(threshold, _NEAR * best)
            if near or value in one.signature.candidate.nodes:
                values[one.name] = value
        if not values:
            break
        for one in found:
            if one.name in values:
                trial.bench.begin({**one.signature.given, one.name: values[one.name]})
        for number, one in enumerate(found):
            if one.name in values:
                sharp = with_node(one.signature, values[one.name], trial.bench)
                found[number] = trial.fit(sharp, given=given, over=over)
        found = _ranked(found)
    return found


def _ranked(fits: Sequence[Fit]) -> list[Fit]:
    return sorted(fits, key=lambda one: -one.total)


def _closer(of: Fit) -> Value | None:
    """The strength at which to simulate next: where it fits, and if that is at one that is
    simulated, beyond it or halfway to the farther of its neighbours. None where that is no news.

    The better of them is no guide: of an effect twice as strong as fits, features may be farther
    off than of none at all.

    If a node of the candidate's lies there, it is that.
    """
    one, node = of.signature, round(of.place)
    if not one.candidate.numeric or of.value == one.candidate.base:
        return None
    base = float(one.candidate.base)
    off = abs(float(of.value) - float(one.values[node]))
    if off > _NO_NEWS * abs(float(of.value) - base) or one.values[node] == base:
        value, least = _node(one, int(of.place), float(of.value)), _NO_NEWS
    else:
        beyond = [each for each in one.candidate.nodes if _is_beyond(one, node, float(each))]
        if beyond:
            return min(beyond, key=lambda each: abs(float(each) - float(one.values[node])))
        at = float(one.values[node])
        beside = [n for n in (node - 1, node + 1) if 0 <= n < len(one.values)]
        halves = {n: _halfway(at, float(one.values[n]), base) for n in beside}
        farther = max(beside, key=lambda n: abs(halves[n] - at))
        value, least = _node(one, min(node, farther), halves[farther]), _FINE
        value = round(value) if one.candidate.whole else value
    apart = min(abs(float(value) - float(each)) for each in one.values)
    return value if apart > least * abs(float(value) - base) else None


def _halfway(one: float, other: float, base: float) -> float:
    """Between two strengths, by factors; by steps where one is the base or beyond it."""
    first, second = one - base, other - base
    if first * second <= 0:
        return 0.5 * (one + other)
    return base + float(np.copysign(np.sqrt(first * second), first))


def _node(of: Signature, below: int, value: float) -> float:
    """A value, or the candidate's nearest node between those simulated beside it."""
    low, high = float(of.values[below]), float(of.values[below + 1])
    between = [float(node) for node in of.candidate.nodes if low < float(node) < high]
    return min(between, key=lambda node: abs(node - value), default=value)


def _is_beyond(of: Signature, place: int, value: float) -> bool:
    """Whether a value lies beyond a place that is the last one simulated."""
    first, last = float(of.values[0]), float(of.values[-1])
    return (place == 0 and value < first) or (place == len(of.values) - 1 and value > last)
