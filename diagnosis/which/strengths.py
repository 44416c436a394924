"""Choice of the parameter values at which candidates are simulated: first few, then refined."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from starling.diagnosis.which.candidates import Candidate, Segment
from starling.diagnosis.which.fit import Fit
from starling.diagnosis.which.model import SearchContext
from starling.diagnosis.which.response import PredictedChange, Signature, add_node
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Stage, Value

_CANDIDATES = 12  # Largest number of candidates that are refined.
_WORTH_SHARE = 0.25  # Share of the threshold that a refined candidate must gain.
_SIMULATED = 4  # Candidates that are simulated at their best-fitting value.
_PROMISING = 0.5  # Share of the threshold that the best candidate must gain to be refined.
_NEAR = 0.5  # Gain below the best, as a share of it, up to which a candidate is refined.
_HOPEFUL = 0.65  # The same for candidates that are simulated at one more of their nodes.
_LEAST_STEP = 0.05  # Least distance of a new value from simulated ones, as a share of its strength.
_LEAST_HALF_STEP = 0.15  # The same for a value halfway between two simulated ones.
_ROUNDS = 5  # Largest number of refinements.
_WIDE = 40.0  # Ratio of strongest to weakest departure from which a range is wide.
_MANY = 5  # Least number of nodes of a wide range.
_FAR = 5.0  # Ratio of the range's end to the strong node from which the end is tried as well.
_AFTER_SEARCH = ("matcher.refinement.", "matcher.checks.")


def first_nodes(candidate: Candidate) -> list[Value]:
    """Select the nodes at which a candidate is simulated first.

    A choice or an integer parameter is simulated at all nodes. Other parameters are simulated at a
    weak and a strong node to each side, as few effects are proportional to their strength. The last
    node is added in ranges that extend far beyond the strong one, for example of dark current. It
    is also added in the depth segment: a depth limit shows nothing of filters that act beyond it.

    If each value needs rendering or a new matching search, which takes most of the time, only the
    middle node is simulated, also of integers. Wide ranges have two. A value measured from the
    captures is always simulated.
    """
    slow = bool(candidate.effect.rerender) or _needs_search(candidate)
    if not candidate.numeric or (candidate.whole and not slow):
        return list(candidate.nodes)
    base = float(candidate.base)
    measured = [] if candidate.measured is None else [candidate.measured]
    nodes = [node for node in candidate.nodes if node not in measured]
    below = [node for node in nodes if float(node) < base][::-1]
    above = [node for node in nodes if float(node) > base]
    end = candidate.segment is Segment.DEPTH
    selected = [
        side[index]
        for side in (below, above)
        for index in _first_indices(side, base, slow=slow, end=end)
    ]
    return sorted([*selected, *measured], key=float)


def _needs_search(candidate: Candidate) -> bool:
    """Whether the matching search must be repeated; refinement and checks reuse its results."""
    if candidate.effect.stage is not Stage.MATCHER:
        return False
    paths = setting.parameter_of(candidate.name)[1].paths
    return not all(path.startswith(_AFTER_SEARCH) for path in paths)


def _first_indices(side: Sequence[Value], base: float, *, slow: bool, end: bool) -> list[int]:
    """Select nodes of one side, sorted from weak to strong; `end` adds the last unless `slow`."""
    count = len(side)
    if not count:
        return []
    departures = [abs(float(node) - base) for node in side]
    if slow and departures[-1] >= _WIDE * departures[0] and count >= _MANY:
        return [count // 4, count - 1 - count // 4]
    if slow:
        return [count // 2]
    strong = count - 1 - count // 4
    end = end or departures[-1] > _FAR * departures[strong]
    return sorted({count // 3, strong, count - 1} if end else {count // 3, strong})


def worth_refining(fits: Iterable[Fit], threshold: float) -> list[Fit]:
    """Select the candidates to refine, best first.

    Args:
        fits: fits of all candidates.
        threshold: least gain of an accepted effect.
    """
    best = sorted(fits, key=lambda fitted: -fitted.total)[:_CANDIDATES]
    return [fitted for fitted in best if fitted.total > _WORTH_SHARE * threshold]


def refine(
    signatures: Sequence[Signature],
    context: SearchContext,
    background: PredictedChange,
    *,
    reference: PredictedChange | None = None,
    leader_gain: float = 0.0,
) -> list[Fit]:
    """Fit candidates together with other effects, and simulate the best ones where they fit.

    Between nodes a signature is only as accurate as linear interpolation, which must not decide. In
    each round the best candidates are simulated at their best-fitting values. Nodes take priority,
    because their simulations also serve other captures of the scenes. The rounds end when all
    values are simulated.

    Args:
        signatures: signatures of the candidates.
        context: data of the search.
        background: change by other effects that act together with a candidate.
        reference: change by the others without a candidate; None takes `background`.
        leader_gain: gain of a refined effect that the candidates compete with.

    Returns:
        Fits in order of decreasing gain.
    """
    threshold = context.threshold
    fits = _ranked(
        [
            context.fit(signature, background=background, reference=reference)
            for signature in signatures
        ]
    )
    for _ in range(_ROUNDS):
        best = max([leader_gain, *(fitted.total for fitted in fits[:1])])
        if best < _PROMISING * threshold:
            break
        values: dict[str, Value] = {}
        for rank, fitted in enumerate(fits):
            short = best - fitted.total
            if short >= max(threshold, _HOPEFUL * best) or (value := _next_value(fitted)) is None:
                continue
            near = rank < _SIMULATED and short < max(threshold, _NEAR * best)
            if near or value in fitted.signature.candidate.nodes:
                values[fitted.name] = value
        if not values:
            break
        for fitted in fits:
            if fitted.name in values:
                context.table.prefetch(
                    {**fitted.signature.background, fitted.name: values[fitted.name]}
                )
        for number, fitted in enumerate(fits):
            if fitted.name in values:
                refined = add_node(fitted.signature, values[fitted.name], context.table)
                fits[number] = context.fit(refined, background=background, reference=reference)
        fits = _ranked(fits)
    return fits


def _ranked(fits: Sequence[Fit]) -> list[Fit]:
    return sorted(fits, key=lambda fitted: -fitted.total)


def _next_value(fitted: Fit) -> Value | None:
    """Select the value to simulate next: the best-fitting one.

    If that value is simulated already, it is the next node beyond the simulated range, or a value
    halfway to the more distant neighbour. The neighbour that fits better is no guide: at twice the
    right strength, features can be further off than without the effect. A node in between is
    preferred. None if the value is too close to a simulated one.
    """
    signature, node = fitted.signature, round(fitted.place)
    if not signature.candidate.numeric or fitted.value == signature.candidate.base:
        return None
    base = float(signature.candidate.base)
    distance = abs(float(fitted.value) - float(signature.values[node]))
    if distance > _LEAST_STEP * abs(float(fitted.value) - base) or signature.values[node] == base:
        value = _nearest_node(signature, int(fitted.place), float(fitted.value))
        least = _LEAST_STEP
    else:
        if (beyond := _next_node(signature, node)) is not None:
            return beyond
        centre = float(signature.values[node])
        neighbours = [n for n in (node - 1, node + 1) if 0 <= n < len(signature.values)]
        halves = {n: _halfway(centre, float(signature.values[n]), base) for n in neighbours}
        farther = max(neighbours, key=lambda n: abs(halves[n] - centre))
        value = _nearest_node(signature, min(node, farther), halves[farther])
        least = _LEAST_HALF_STEP
        value = round(value) if signature.candidate.whole else value
    distance = min(abs(float(value) - float(simulated)) for simulated in signature.values)
    return value if distance > least * abs(float(value) - base) else None


def beyond_range(signature: Signature, place: float) -> Value | None:
    """Return the next value for an effect at an end of its simulated values, else None.

    It is the next node, or twice the departure after the last node.
    """
    last = len(signature.values) - 1
    if not signature.candidate.numeric or place not in (0, last):
        return None
    base, end = float(signature.candidate.base), float(signature.values[round(place)])
    if end == base:
        return None
    node = _next_node(signature, round(place))
    return base + 2 * (end - base) if node is None else node


def _halfway(first: float, second: float, base: float) -> float:
    """Return the geometric mean of two departures; the arithmetic mean if signs differ."""
    first_departure, second_departure = first - base, second - base
    if first_departure * second_departure <= 0:
        return 0.5 * (first + second)
    root = np.sqrt(first_departure * second_departure)
    return base + float(np.copysign(root, first_departure))


def _nearest_node(signature: Signature, below: int, value: float) -> float:
    """Return the candidate's node nearest to a value between two simulated ones, or the value."""
    low, high = float(signature.values[below]), float(signature.values[below + 1])
    between = [float(node) for node in signature.candidate.nodes if low < float(node) < high]
    return min(between, key=lambda node: abs(node - value), default=value)


def _next_node(signature: Signature, place: int) -> Value | None:
    """Return the nearest of the candidate's nodes beyond an end of the simulated values, if any."""
    end, last = float(signature.values[place]), len(signature.values) - 1
    beyond = [
        node
        for node in signature.candidate.nodes
        if (place == 0 and float(node) < end) or (place == last and float(node) > end)
    ]
    return min(beyond, key=lambda node: abs(float(node) - end), default=None)
