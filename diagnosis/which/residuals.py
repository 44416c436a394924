"""Where a gap is: by group of features, alike in all scenes, and what of it stays unexplained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.strata import COVARIATES
from starling.diagnosis.which.likelihood import squares
from starling.sim.statistics import mean_known

_NAMED = 3  # Groups of features that a lead names.
_LEAD = 3.0  # Mean deviations of a group from which it is a lead.
_OFF = 1.0  # Deviations from which a feature is off.


def by_group(
    features: Sequence[str], left: NDArray[np.float64], weight: NDArray[np.float64]
) -> dict[str, float]:
    """What groups of features add to a gap's size, which is their sum; the largest first.

    Args:
        features: their names.
        left: (scenes, features) what there is or what effects leave of it, over its deviation; NaN
            where not known.
        weight: (features,) votes.
    """
    votes = max(float((np.isfinite(left) @ weight).sum()), 1e-9)
    parts = squares(left).sum(axis=0) * weight / votes
    total: dict[str, float] = {}
    for name, part in zip(features, parts, strict=True):
        total[group(name)] = total.get(group(name), 0.0) + float(part)
    return dict(sorted(total.items(), key=lambda one: -one[1]))


def alike(
    features: Sequence[str], left: NDArray[np.float64], weight: NDArray[np.float64]
) -> dict[str, list[float]]:
    """Features that are off in every scene, and the same way, with what is left in each; those that
    are off most and have most votes first.

    Args:
        features: their names.
        left: as `by_group`.
        weight: likewise.
    """
    off = np.where(np.isfinite(left), np.abs(left), 0.0).min(axis=0) > _OFF
    same = off & (np.sign(left) == np.sign(left[:1])).all(axis=0)
    far = np.abs(np.nan_to_num(left).mean(axis=0)) * np.sqrt(weight)
    order = [int(number) for number in np.argsort(-far) if same[number]]
    return {features[number]: left[:, number].tolist() for number in order}


def leads(
    features: Sequence[str], left: NDArray[np.float64]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Name what stays unexplained: alike in all scenes, and in most scenes but in each otherwise.

    What differs from scene to scene no effect of the camera explains that has one strength for all.

    Args:
        features: their names.
        left: (scenes, features) what is left (`Likelihood.beyond`); NaN where not known.

    Returns:
        Groups of features whose mean over scenes is far off, the worst first, and others of which
        the median scene is.
    """
    groups = np.array([group(name) for name in features])
    alike: dict[str, float] = {}
    each: dict[str, float] = {}
    for name in dict.fromkeys(groups.tolist()):
        inside = left[:, groups == name]
        mean = mean_known(inside, axis=0)
        alike[name] = float(np.sqrt(mean_known(mean**2, axis=0)))
        of_scenes = np.sqrt(mean_known(inside**2, axis=1))
        each[name] = float(np.median(np.nan_to_num(of_scenes)))
    first = _worst(alike)
    return first, _worst({name: size for name, size in each.items() if name not in first})


def _worst(size: Mapping[str, float]) -> tuple[str, ...]:
    """Names of what is far off, the worst first; what no scene tells of is not."""
    worst = sorted((name for name in size if size[name] > _LEAD), key=lambda name: -size[name])
    return tuple(worst[:_NAMED])


def group(name: str) -> str:
    """Features that tell of one thing: `holes.edge.open` is of `holes by edge`."""
    first, *rest = name.split(".")
    by = next((word for word in rest if word in COVARIATES), None)
    return first if by is None else f"{first} by {by}"
