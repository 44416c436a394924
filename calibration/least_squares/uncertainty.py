"""Covariance of a fit, and parameters that its captures do not determine.

Residuals of one place are correlated by the imager's averaging, by speckle and by errors of the
surface model. The covariance is a sandwich over clusters: C = H^-1 (sum s s' + I) H^-1. Here H is
the information including the prior, s is the gradient of a cluster, and I is the prior. The prior
is a measurement of each parameter with a deviation of one tolerance.

Sources: White, Econometrica 50, 1982; Liang and Zeger, Biometrika 73, 1986 (clusters).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares.solve import Equations, Matrix
from starling.calibration.parameters import CalibrationParameter

OPEN = 0.4  # Deviation above which a direction is undetermined [tolerances].
_LEAST_OTHERS = 0.05  # Minimum of 1 - leverage.
_NAMED = 0.3  # Minimum component of a parameter that is named with a direction.
_OPEN_SHARE = 0.5  # Share of variance from open directions that makes a parameter open.
_LEAST_SD = 0.02  # Deviation below which a parameter always counts as determined [tolerances].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Uncertainty:
    """Uncertainty of p parameters, in units of their tolerances."""

    covariance: Matrix  # (p, p); the prior limits the variance of open parameters.
    open: NDArray[np.bool_]  # (p,) parameters that the captures do not determine.
    # (q, p) undetermined combinations, worst first; the length of a row is its deviation.
    directions: Matrix


def estimate(equations: Equations) -> Uncertainty:
    """Estimate the clustered sandwich covariance and the undetermined directions.

    A cluster with high leverage pulls the fit towards itself, so its residuals underestimate its
    errors. Its score is divided by the square root of 1 - leverage (CR2).

    Args:
        equations: equations at the end of the fit.

    Source: Bell and McCaffrey, Survey Methodology 28(2), 2002 (CR2).
    """
    count = len(equations.gradient)
    stiff = equations.information * equations.stiffness + np.eye(count)
    value, vector = np.linalg.eigh(stiff)
    root = (vector / np.sqrt(value)) @ vector.T  # Symmetric square root of the inverse.
    inverse = root @ root
    leverage, axes = np.linalg.eigh(root @ (equations.shares * equations.stiffness) @ root)
    whitened = (axes.transpose(0, 2, 1) @ (equations.scores @ root)[..., None])[..., 0]
    whitened = (axes @ (whitened / np.sqrt(np.maximum(1 - leverage, _LEAST_OTHERS)))[..., None])[
        ..., 0
    ]
    covariance = root @ (whitened.T @ whitened) @ root + inverse @ inverse
    # Open directions come from the information, because the spread of few scores is unreliable.
    value, vector = np.linalg.eigh(inverse)
    open_directions = np.flatnonzero(value > OPEN**2)[::-1]
    directions = (vector[:, open_directions] * np.sqrt(value[open_directions])).T
    from_open = (directions**2).sum(axis=0)
    total = np.diagonal(inverse)
    undetermined = (from_open > _OPEN_SHARE * total) & (total > _LEAST_SD**2)
    return Uncertainty(
        covariance=(covariance + covariance.T) / 2, open=undetermined, directions=directions
    )


def with_open_scale(uncertainty: Uncertainty, free: Sequence[CalibrationParameter]) -> Uncertainty:
    """Mark the common scale of focal length, baseline and field as open.

    With reference depth and a projector that looks straight ahead, this scale is undetermined. A
    rotated projector distorts its field with the scale by hundredths of a pixel. A simulation
    resolves this, but in a device the residual distortion of the lens has the same effect.

    Args:
        uncertainty: uncertainty of a fit to reference depth only, with a free field.
        free: free parameters.
    """
    scaled = ("fx_px", "baseline_m", "projector.field")
    direction = np.array([float(row.name in scaled) for row in free])
    newly_open = (direction != 0) & ~uncertainty.open
    if not newly_open.any():
        return uncertainty
    return Uncertainty(
        covariance=uncertainty.covariance,
        open=uncertainty.open | newly_open,
        directions=np.concatenate([uncertainty.directions, direction[None]]),
    )


def sentences(uncertainty: Uncertainty, free: Sequence[CalibrationParameter]) -> tuple[str, ...]:
    """Describe each open direction: its parameters, and the capture that determines them."""
    texts = []
    for number, direction in enumerate(uncertainty.directions):
        part = np.abs(direction) / np.linalg.norm(direction)
        # Each open parameter is named at least with the direction of most of its variance.
        main = uncertainty.open & (np.abs(uncertainty.directions).argmax(axis=0) == number)
        order = np.argsort(-part)
        texts.append(_sentence([free[i].name for i in order if part[i] > _NAMED or main[i]]))
    return tuple(texts)


def _sentence(names: Sequence[str]) -> str:
    remedy = _remedy(names)
    if len(names) == 1:
        return f"{names[0]} is not determined by these captures: {remedy}"
    listed = f"{', '.join(names[:-1])} and {names[-1]}"
    return f"{listed} cannot be separated: {remedy}"


def _remedy(names: Sequence[str]) -> str:
    if "fx_px" in names or "projector.field" in names or "baseline_m" in names:
        return "capture surfaces at several distances whose shape and pose are known in metres."
    if "projector.dot_blur_mrad" in names:
        return "capture with more light, or at a shorter distance."
    return "capture a wall at a second distance that fills the image."
