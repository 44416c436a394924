"""Plain rules that tell where the gap in holes lies: a small tree over the covariates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.tree import DecisionTreeRegressor

from starling.diagnosis.scenes.rooms import means
from starling.diagnosis.scenes.strata import Ground, Mask
from starling.diagnosis.where.covariates import share

Limits = dict[str, tuple[float, float]]  # By covariate, from and to.

_DEPTH = 3
_LEAST_AREA = 0.01  # Share of the pixels that a rule must cover.
_FAIR_SHARE = 0.1
_PIXELS = 20_000  # Drawn of each scene.
_LEAST_ROOMS = 4  # Two to learn from, two to judge by.
_LEAST_AGREE = 0.75  # Share of the rooms not learnt from that must agree in sign.
_LEAST_GAP = 0.005  # Share of no-depth pixels, below which a rule tells nothing.


@dataclass(frozen=True, kw_only=True, slots=True)
class Rule:
    """A part of all pixels, and the gap there."""

    text: str  # As `level < 12 DN and edge > 12 px`.
    gap: float  # Share of no-depth pixels, second less first.
    area: float  # Share of the counted pixels.
    net: float  # What it adds to the gap of all pixels.
    share: float  # That of the whole gap; NaN where gaps cancel (see `table.share`).


def rules(
    first: Sequence[Mask],
    second: Sequence[Mask],
    grounds: Sequence[Ground],
    rooms: Sequence[str],
) -> list[Rule]:
    """Find where the second maps have no depth and the first have.

    Half of the rooms grow the tree, the other half measure its leaves.

    Args:
        first: (h, w) of every scene, True without depth.
        second: likewise.
        grounds: of the scenes.
        rooms: likewise.

    Returns:
        Rules by size of their share of the gap; none of less than four rooms. Left out are those
        that the other rooms do not confirm: by the sign in all of them, three quarters of four and
        more, and by half of what the first half has.
    """
    order = list(dict.fromkeys(rooms))
    if len(order) < _LEAST_ROOMS:
        return []
    names = [one.name for one in grounds[0].covariates.values() if one.value is not None]
    rng = np.random.default_rng(0)
    drawn = [
        _drawn(before, after, ground, names, rng)
        for before, after, ground in zip(first, second, grounds, strict=True)
    ]
    half = [order.index(room) % 2 for room in rooms]
    learn, judge = ([one for one, of in zip(drawn, half, strict=True) if of == h] for h in (0, 1))
    judging = [room for room, of in zip(rooms, half, strict=True) if of == 1]
    learnt_x, learnt_y = (np.concatenate([one[axis] for one in learn]) for axis in (0, 1))
    tree = _grown(learnt_x, learnt_y)
    learnt_at = tree.apply(learnt_x)
    leaves = [tree.apply(x) for x, _ in judge]
    total = float(np.mean([y.mean() for _, y in judge]))
    nets = {
        leaf: float(
            np.mean([(y * (at == leaf)).mean() for (_, y), at in zip(judge, leaves, strict=True)])
        )
        for leaf in np.unique(np.concatenate(leaves)).tolist()
    }
    gross = sum(map(abs, nets.values()))
    units = {name: grounds[0].covariates[name].unit for name in names}
    found = []
    for leaf, text in _paths(tree, names, units):
        each = np.array(
            [
                y[at == leaf].mean() if np.any(at == leaf) else np.nan
                for (_, y), at in zip(judge, leaves, strict=True)
            ]
        )
        of_rooms = means(each, judging)
        learnt = float(learnt_y[learnt_at == leaf].mean())
        if not text or not _confirmed(learnt, of_rooms[np.isfinite(of_rooms)]):
            continue
        gap = float(np.nanmean(each))
        area = float(np.mean([np.mean(at == leaf) for at in leaves]))
        net = nets[leaf]
        part = share(net, total, gross)
        found.append(Rule(text=text, gap=gap, area=area, net=net, share=part))
    return sorted(found, key=lambda rule: -abs(rule.net))


def _confirmed(learnt: float, judged: NDArray[np.float64]) -> bool:
    """Whether rooms (n,) that the tree did not see bear out the gap of a leaf."""
    if judged.size < 2 or judged.mean() * np.sign(learnt) < max(_LEAST_GAP, 0.5 * abs(learnt)):
        return False
    agree = np.mean(np.sign(judged) == np.sign(learnt))
    return bool(agree >= (_LEAST_AGREE if judged.size >= 4 else 1.0))


def _drawn(
    before: Mask, after: Mask, ground: Ground, names: Sequence[str], rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Covariates (n, covariates) and the change (n,) of some pixels of a scene."""
    pixels = np.flatnonzero(ground.counted)
    pixels = rng.choice(pixels, size=min(_PIXELS, pixels.size), replace=False)
    columns = []
    for name in names:
        value = ground.covariates[name].value
        assert value is not None
        columns.append(value.ravel()[pixels])
    change = after.ravel()[pixels].astype(np.float32) - before.ravel()[pixels]
    return np.stack(columns, axis=1), change


def _grown(x: NDArray[np.float32], y: NDArray[np.float32]) -> DecisionTreeRegressor:
    """A tree whose every split gains a fair share of what the first gains."""
    least = max(1, int(_LEAST_AREA * len(y)))
    stump = DecisionTreeRegressor(max_depth=1, min_samples_leaf=least, random_state=0)
    impurity = stump.fit(x, y).tree_.impurity
    weight = stump.tree_.weighted_n_node_samples / len(y)
    gained = impurity[0] - float((impurity[1:] * weight[1:]).sum()) if len(impurity) > 1 else 0.0
    return DecisionTreeRegressor(
        max_depth=_DEPTH,
        min_samples_leaf=least,
        min_impurity_decrease=_FAIR_SHARE * gained,
        random_state=0,
    ).fit(x, y)


def _paths(
    tree: DecisionTreeRegressor, names: Sequence[str], units: dict[str, str]
) -> list[tuple[int, str]]:
    """Leaves of the tree, each with the conditions that lead there."""
    grown = tree.tree_
    left, right = list(grown.children_left), list(grown.children_right)
    feature, threshold = list(grown.feature), list(grown.threshold)
    found: list[tuple[int, str]] = []
    todo: list[tuple[int, Limits]] = [(0, {})]
    while todo:
        node, limits = todo.pop()
        if left[node] < 0:
            found.append((node, " and ".join(_said(limits, units))))
            continue
        name: str = names[int(feature[node])]
        at = float(threshold[node])
        low, high = limits.get(name, (-np.inf, np.inf))
        todo.append((left[node], {**limits, name: (low, min(high, at))}))
        todo.append((right[node], {**limits, name: (max(low, at), high)}))
    return found


def _said(limits: Limits, units: dict[str, str]) -> list[str]:
    said = []
    for name, (low, high) in limits.items():
        if np.isfinite(low) and np.isfinite(high):
            said.append(f"{name} {low:.3g} to {high:.3g} {units[name]}")
        elif np.isfinite(low):
            said.append(f"{name} > {low:.3g} {units[name]}")
        else:
            said.append(f"{name} < {high:.3g} {units[name]}")
    return said
