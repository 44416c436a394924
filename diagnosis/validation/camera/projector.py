"""What the projector throws: its dots, how they fall off, and how strong a frame is."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera import dots
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.dots import Dots
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import View
from starling.diagnosis.validation.camera.spread import Ellipse

_EDGE_RAD = math.radians(45.0)  # Half of the field's 90 degrees, where falloffs are matched.
_SECOND_PATTERN_PX = (5.0, 1.5)  # Where a plate's second reflection falls.


def throw(view: View, strengths: Strengths, found: Dots, draws: Draws) -> View:
    """Apply every effect of the projector to the laser's light in one view.

    Args:
        view: Light at nominal power.
        strengths: The effects.
        found: The projector's dots.
        draws: Random numbers; what they name is the same for both imagers.

    Returns:
        The view with other laser light; the very view given where nothing acts.
    """
    focal_px = strengths.nominal.fx_px
    view = dots.dropped(
        view, found, strengths.of("dropped_dots"), draws.of_device("projector/dropped")
    )
    view = dots.shifted(
        view,
        found,
        strengths.of("shifted_dots"),
        focal_px,
        draws.of_device("projector/shifted"),
    )
    view = dots.doubled(view, strengths.of("doubled_dots"), _SECOND_PATTERN_PX)
    view = dots.widened(view, added(view, strengths))
    return _dim(view, strengths, flicker(strengths.of("flicker"), draws))


def added(view: View, strengths: Strengths) -> Ellipse:
    """Variances that dot blur and defocus add to the dots.

    Both add to a spot's own variance, which is the same all over the field in direction cosines. A
    cosine's small change c moves the tangent t of a ray by (1 + t^2)^(3/2) c along the field's
    radius and by sqrt(1 + t^2) c across it.
    """
    focus_m = strengths.nominal.projector_focus_m
    out_of_focus = strengths.of("dot_defocus") * np.abs(1.0 / view.depth_m - 1.0 / focus_m)
    variance_mrad2 = strengths.of("dot_blur") ** 2 + out_of_focus**2
    x, y = np.nan_to_num(view.px), np.nan_to_num(view.py)
    stretch = 1.0 + x**2 + y**2
    across = np.nan_to_num(variance_mrad2 * (1e-3 * strengths.nominal.fx_px) ** 2 * stretch)
    longer = across * (1.0 + stretch)
    return Ellipse(xx=across + longer * x**2, yy=across + longer * y**2, xy=longer * x * y)


def falloff(view: View, exponent: float) -> NDArray[np.float64]:
    """Factor (h, w) of a projector that gives less light off its axis.

    A Gaussian beam, exp(-k a^2), as from a single-mode emitter, in place of cos^n a; the same on
    the axis and at the edge of the field, 45 degrees.
    """
    angle = np.arctan(np.hypot(np.nan_to_num(view.px), np.nan_to_num(view.py)))
    return np.exp(exponent * math.log(math.cos(_EDGE_RAD)) * (angle / _EDGE_RAD) ** 2)


def flicker(deviation: float, draws: Draws) -> float:
    """Power of a frame over the mean: a gamma variate of mean 1, not a log-normal one."""
    if deviation == 0.0:
        return 1.0
    return float(draws.of_frame("projector/flicker").gamma(deviation**-2, deviation**2))


def _dim(view: View, strengths: Strengths, power: float) -> View:
    exponent = strengths.of("projector_falloff")
    laser = view.laser_e
    if exponent != 0.0:
        laser = laser * falloff(view, exponent)
    if strengths.acting("projector_power"):
        laser = laser * (strengths.of("projector_power") / strengths.nominal.power_w)
    if power != 1.0:
        laser = laser * power
    return view if laser is view.laser_e else dataclasses.replace(view, laser_e=laser)
