"""How sure a fit is, and what its captures leave open.

Residuals of one place go together: the imager's averaging, speckle, and what the surface's model
gets wrong tie neighbours. Their sum over a place is one draw, and the spread of these sums
says how far the fit would move with other captures: C = H^-1 (sum s s' + I) H^-1 with H the
information, s the places' parts of the gradient, and I the tolerances, which count as measurements
of deviation 1 and are in H too.

Sources: White, Econometrica 50, 1982; Liang and Zeger, Biometrika 73, 1986 (clusters).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from starling.calibration.parameters import Parameter

Matrix = NDArray[np.float64]

OPEN = 0.4  # Deviation over tolerance from which on a direction was not determined.
_LEAST_OTHERS = 0.05  # Of what is known of a direction, from other clusters than one.
_NAMED = 0.3  # Least part of a parameter in a direction to be named with it.
_OPEN_SHARE = 0.5  # Of a parameter's variance, from open directions: it was not determined either.
_LEAST_SD = 0.02  # In tolerances: below, a parameter was determined wherever its variance is from.


class Clustered(Protocol):
    """Normal equations in tolerances, and the parts of clusters in them."""

    @property
    def information(self) -> Matrix:
        """(p, p), the tolerances' own not in it."""
        ...

    @property
    def gradient(self) -> Matrix:
        """(p,) of half the cost."""
        ...

    @property
    def scores(self) -> Matrix:
        """(clusters, p) parts of the gradient."""
        ...

    @property
    def shares(self) -> Matrix:
        """(clusters, p, p) parts of the information."""
        ...

    @property
    def stiffness(self) -> float:
        """The cost's curvature over the information."""
        ...


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Uncertainty:
    """Of p parameters, in units of their tolerances."""

    covariance: Matrix  # (p, p), what is open held by the tolerances alone.
    open: NDArray[np.bool_]  # (p,) parameters that the captures do not determine.
    # (q, p) combinations that they do not determine, worst first, each as long as its deviation.
    directions: Matrix


def of(equations: Clustered) -> Uncertainty:
    """Sandwich covariance with clusters, and what is open.

    A cluster that weighs much pulls the fit towards itself, and its residuals seem smaller than
    its errors; its score is made larger by the square root of its leverage's complement (CR2).

    Args:
        equations: where the fit ended.

    Source: Bell and McCaffrey, Survey Methodology 28(2), 2002 (CR2).
    """
    count = len(equations.gradient)
    stiff = equations.information * equations.stiffness + np.eye(count)
    value, vector = np.linalg.eigh(stiff)
    root = (vector / np.sqrt(value)) @ vector.T  # The inverse's symmetric root.
    inverse = root @ root
    own, axes = np.linalg.eigh(root @ (equations.shares * equations.stiffness) @ root)
    white = (axes.transpose(0, 2, 1) @ (equations.scores @ root)[..., None])[..., 0]
    white = (axes @ (white / np.sqrt(np.maximum(1 - own, _LEAST_OTHERS)))[..., None])[..., 0]
    covariance = root @ (white.T @ white) @ root + inverse @ inverse
    # What is open shows in the information: there, the spread of few scores says nothing.
    value, vector = np.linalg.eigh(inverse)
    worst = np.flatnonzero(value > OPEN**2)[::-1]
    directions = (vector[:, worst] * np.sqrt(value[worst])).T
    from_open = (directions**2).sum(axis=0)
    whole = np.diagonal(inverse)
    undetermined = (from_open > _OPEN_SHARE * whole) & (whole > _LEAST_SD**2)
    return Uncertainty(
        covariance=(covariance + covariance.T) / 2, open=undetermined, directions=directions
    )


def scale_open(found: Uncertainty, free: Sequence[Parameter]) -> Uncertainty:
    """Take the common scale of focal length, baseline and field as open, whatever residuals say.

    Reference depth alone leaves it open where the projector looks straight ahead. A turned one
    bends its field by hundredths of a pixel with it, which decides in a simulation, but which a
    lens's residual distortion imitates in a device.

    Args:
        found: of captures of reference depth alone, the field among the free parameters.
        free: the parameters.
    """
    scaled = ("fx_px", "baseline_m", "projector.field")
    direction = np.array([float(row.name in scaled) for row in free])
    fresh = (direction != 0) & ~found.open
    if not fresh.any():
        return found
    return Uncertainty(
        covariance=found.covariance,
        open=found.open | fresh,
        directions=np.concatenate([found.directions, direction[None]]),
    )


def sentences(found: Uncertainty, free: Sequence[Parameter]) -> tuple[str, ...]:
    """Say of each open direction which parameters it mixes, and which capture would tell them."""
    out = []
    for number, direction in enumerate(found.directions):
        part = np.abs(direction) / np.linalg.norm(direction)
        # Each open parameter is named at least where most of its variance is from.
        mainly = found.open & (np.abs(found.directions).argmax(axis=0) == number)
        order = np.argsort(-part)
        out.append(_sentence([free[i].name for i in order if part[i] > _NAMED or mainly[i]]))
    return tuple(out)


def _sentence(names: Sequence[str]) -> str:
    remedy = _remedy(names)
    if len(names) == 1:
        return f"{names[0]} is not determined by these captures: {remedy}"
    listed = f"{', '.join(names[:-1])} and {names[-1]}"
    return f"{listed} cannot be told apart: {remedy}"


def _remedy(names: Sequence[str]) -> str:
    if "fx_px" in names or "projector.field" in names or "baseline_m" in names:
        return "capture surfaces at several distances whose shape and pose are known in metres."
    if "projector.dot_blur_mrad" in names:
        return "capture with more light, or nearer."
    return "capture a wall at a second distance, filling the image."
