"""Composition of a gap by groups of features, and groups that stay unexplained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.strata import COVARIATES
from starling.diagnosis.which.likelihood import clipped_squares
from starling.sim.arrays import mean_known

_MOST_LEADS = 3  # Largest number of groups that are reported as unexplained.
_LEAD = 3.0  # Root mean squared deviation of a group from which it is reported.
_OFF = 1.0  # Deviation from which a feature is off.


def by_group(
    features: Sequence[str], residual: NDArray[np.float64], weight: NDArray[np.float64]
) -> dict[str, float]:
    """Divide the size of a gap among groups of features, in decreasing order.

    Args:
        features: names of the features.
        residual: (scenes, features) gap, or what effects leave of it, over its deviation; NaN where
            unknown.
        weight: (features,) feature weights.
    """
    total_weight = max(float((np.isfinite(residual) @ weight).sum()), 1e-9)
    parts = clipped_squares(residual).sum(axis=0) * weight / total_weight
    total: dict[str, float] = {}
    for name, part in zip(features, parts, strict=True):
        total[feature_group(name)] = total.get(feature_group(name), 0.0) + float(part)
    return dict(sorted(total.items(), key=lambda item: -item[1]))


def consistent_features(
    features: Sequence[str], residual: NDArray[np.float64], weight: NDArray[np.float64]
) -> dict[str, list[float]]:
    """Select features that are off in every scene in the same direction.

    Args:
        features: names of the features.
        residual: as `by_group`.
        weight: as `by_group`.

    Returns:
        Residual in each scene, by feature; largest weighted means first.
    """
    off = np.where(np.isfinite(residual), np.abs(residual), 0.0).min(axis=0) > _OFF
    consistent = off & (np.sign(residual) == np.sign(residual[:1])).all(axis=0)
    size = np.abs(np.nan_to_num(residual).mean(axis=0)) * np.sqrt(weight)
    order = [int(number) for number in np.argsort(-size) if consistent[number]]
    return {features[number]: residual[:, number].tolist() for number in order}


def leads(
    features: Sequence[str], residual: NDArray[np.float64]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Name the groups of features that stay unexplained.

    What varies from scene to scene cannot be explained by an effect of the camera, which has one
    strength for all scenes.

    Args:
        features: names of the features.
        residual: (scenes, features) from `Likelihood.unexplained`; NaN where unknown.

    Returns:
        Groups whose mean over scenes is off, and further groups that are off in the median scene;
        worst first.
    """
    groups = np.array([feature_group(name) for name in features])
    common: dict[str, float] = {}
    varying: dict[str, float] = {}
    for name in dict.fromkeys(groups.tolist()):
        inside = residual[:, groups == name]
        mean = mean_known(inside, axis=0)
        common[name] = float(np.sqrt(mean_known(mean**2, axis=0)))
        scene_sizes = np.sqrt(mean_known(inside**2, axis=1))
        varying[name] = float(np.median(np.nan_to_num(scene_sizes)))
    first = _worst(common)
    return first, _worst({name: size for name, size in varying.items() if name not in first})


def _worst(size: Mapping[str, float]) -> tuple[str, ...]:
    """Name the groups that are off, worst first; unknown ones are left out."""
    worst = sorted((name for name in size if size[name] > _LEAD), key=lambda name: -size[name])
    return tuple(worst[:_MOST_LEADS])


def feature_group(name: str) -> str:
    """Return the group of a feature: `holes.edge.open` belongs to `holes by edge`."""
    first, *rest = name.split(".")
    covariate = next((word for word in rest if word in COVARIATES), None)
    return first if covariate is None else f"{first} by {covariate}"
