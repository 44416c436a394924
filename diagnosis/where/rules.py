"""Rules that describe where the gap in holes lies: leaves of a small decision tree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.tree import DecisionTreeRegressor

from starling.diagnosis.scenes.rooms import room_means
from starling.diagnosis.scenes.shelf import select, shelve
from starling.diagnosis.scenes.strata import Mask, Strata
from starling.diagnosis.where.covariates import share_of_gap

_Sample = tuple[NDArray[np.float32], NDArray[np.float32]]  # Covariates (n, c), change (n,).
Limits = dict[str, tuple[float, float]]  # Lower and upper limit by covariate.

_DEPTH = 3  # Depth of the tree.
_MOST_AREA = 1 / 3  # A rule that covers a larger share of the pixels does not say where.
_LEAST_AREA = 0.01  # Least share of the pixels that a rule covers.
_FAIR_SHARE = 0.1  # Least gain of a split, as a share of the first split's gain.
_PIXELS = 20_000  # Number of pixels sampled from each scene.
_LEAST_ROOMS = 4  # Two to grow the tree and two to confirm its leaves.
_LEAST_AGREE = 0.75  # Least share of confirming rooms that agree in sign.
_LEAST_GAP = 0.005  # Least gap of a rule, as a share of no-depth pixels.


@dataclass(frozen=True, kw_only=True, slots=True)
class GapRule:
    """A subset of the pixels, and the gap there."""

    text: str  # For example `level < 12 DN and edge > 12 px`.
    gap: float  # Share of no-depth pixels, second minus first.
    area: float  # Share of the counted pixels.
    net: float  # Contribution to the gap of all pixels.
    share: float  # `net` over the whole gap; NaN if gaps cancel (`covariates.share_of_gap`).


def find_rules(
    first: Sequence[Mask],
    second: Sequence[Mask],
    scene_strata: Sequence[Strata],
    rooms: Sequence[str],
) -> list[GapRule]:
    """Find where the second maps have no depth and the first have.

    Half of the rooms grow the tree; the other half measure its leaves.

    Args:
        first: (h, w) mask of each scene, True without depth.
        second: masks to compare with, in the same order.
        grounds: of the scenes.
        rooms: room of each scene.

    Returns:
        Rules with the largest contribution first; none with fewer than four rooms. The second half
        of the rooms has to confirm a rule. Its sign has to agree in all rooms, or in three quarters
        of four or more. Its size has to be at least half of that in the first half.
        Rules that cover more than a third of the pixels are left out.
    """
    order = list(dict.fromkeys(rooms))
    if len(order) < _LEAST_ROOMS:
        return []
    names = [
        covariate.name
        for covariate in scene_strata[0].covariates.values()
        if covariate.value is not None
    ]
    rng = np.random.default_rng(0)
    samples = shelve(
        _sampled(before, after, strata, names, rng)
        for before, after, strata in zip(first, second, scene_strata, strict=True)
    )
    half = [order.index(room) % 2 for room in rooms]
    learn, judge = (
        select(samples, [scene for scene, side in enumerate(half) if side == number])
        for number in (0, 1)
    )
    judging = [room for room, side in zip(rooms, half, strict=True) if side == 1]
    learnt_x, learnt_y = _joined(learn)
    tree = _grow_tree(learnt_x, learnt_y)
    learnt_leaves = tree.apply(learnt_x)
    leaves = [tree.apply(x) for x, _ in judge]
    total = float(np.mean([y.mean() for _, y in judge]))
    nets = {
        leaf: float(
            np.mean(
                [
                    (y * (reached == leaf)).mean()
                    for (_, y), reached in zip(judge, leaves, strict=True)
                ]
            )
        )
        for leaf in np.unique(np.concatenate(leaves)).tolist()
    }
    gross = sum(map(abs, nets.values()))
    units = {name: scene_strata[0].covariates[name].unit for name in names}
    rules = []
    for leaf, text in _paths(tree, names, units):
        each = np.array(
            [
                y[reached == leaf].mean() if np.any(reached == leaf) else np.nan
                for (_, y), reached in zip(judge, leaves, strict=True)
            ]
        )
        by_room = room_means(each, judging)
        learnt = float(learnt_y[learnt_leaves == leaf].mean())
        if not text or not _confirmed(learnt, by_room[np.isfinite(by_room)]):
            continue
        area = float(np.mean([np.mean(reached == leaf) for reached in leaves]))
        if area > _MOST_AREA:
            continue
        gap = float(np.nanmean(each))
        net = nets[leaf]
        part = share_of_gap(net, total, gross)
        rules.append(GapRule(text=text, gap=gap, area=area, net=net, share=part))
    return sorted(rules, key=lambda rule: -abs(rule.net))


def _confirmed(learnt: float, judged: NDArray[np.float64]) -> bool:
    """Whether rooms (n,) that the tree was not grown on confirm the gap of a leaf."""
    if judged.size < 2 or judged.mean() * np.sign(learnt) < max(_LEAST_GAP, 0.5 * abs(learnt)):
        return False
    agree = np.mean(np.sign(judged) == np.sign(learnt))
    return bool(agree >= (_LEAST_AGREE if judged.size >= 4 else 1.0))


def _sampled(
    before: Mask, after: Mask, strata: Strata, names: Sequence[str], rng: np.random.Generator
) -> _Sample:
    """Sample covariates (n, covariates) and the change (n,) at pixels of a scene."""
    pixels = np.flatnonzero(strata.counted)
    pixels = rng.choice(pixels, size=min(_PIXELS, pixels.size), replace=False)
    values = [strata.covariates[name].value for name in names]
    columns = [value.ravel()[pixels] for value in values if value is not None]
    change = after.ravel()[pixels].astype(np.float32) - before.ravel()[pixels]
    return np.stack(columns, axis=1), change


def _joined(samples: Sequence[_Sample]) -> _Sample:
    """Concatenate samples; they are in memory one at a time."""
    ends = np.cumsum([len(change) for _, change in samples])
    x, y = np.empty((ends[-1], samples[0][0].shape[1]), np.float32), np.empty(ends[-1], np.float32)
    for end, (columns, change) in zip(ends, samples, strict=True):
        x[end - len(change) : end], y[end - len(change) : end] = columns, change
    return x, y


def _grow_tree(x: NDArray[np.float32], y: NDArray[np.float32]) -> DecisionTreeRegressor:
    """Grow a tree in which every split gains a fair share of the first split's gain."""
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
    """Return the leaves of the tree with the conditions that lead to them."""
    grown = tree.tree_
    left_child, right_child = list(grown.children_left), list(grown.children_right)
    feature, threshold = list(grown.feature), list(grown.threshold)
    leaves: list[tuple[int, str]] = []
    todo: list[tuple[int, Limits]] = [(0, {})]
    while todo:
        node, limits = todo.pop()
        if left_child[node] < 0:
            leaves.append((node, " and ".join(_conditions(limits, units))))
            continue
        name: str = names[int(feature[node])]
        split = float(threshold[node])
        low, high = limits.get(name, (-np.inf, np.inf))
        todo.append((left_child[node], {**limits, name: (low, min(high, split))}))
        todo.append((right_child[node], {**limits, name: (max(low, split), high)}))
    return leaves


def _conditions(limits: Limits, units: dict[str, str]) -> list[str]:
    texts = []
    for name, (low, high) in limits.items():
        if np.isfinite(low) and np.isfinite(high):
            texts.append(f"{name} {low:.3g} to {high:.3g} {units[name]}")
        elif np.isfinite(low):
            texts.append(f"{name} > {low:.3g} {units[name]}")
        else:
            texts.append(f"{name} < {high:.3g} {units[name]}")
    return texts
