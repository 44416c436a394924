"""Effects of the projector: dots, falloff off the axis, power and flicker."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera import dots
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.dots import ProjectorDots
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import LightView
from starling.diagnosis.validation.camera.spread import Ellipse

_EDGE_RAD = math.radians(45.0)  # Half of the 90 degree field, where both falloff laws agree.
_SECOND_PATTERN_PX = (5.0, 1.5)  # Shift of the second reflection of a plate (x, y) [px].


def project(
    view: LightView, strengths: Strengths, projector_dots: ProjectorDots, draws: Draws
) -> LightView:
    """Apply all projector effects to the laser light of one view.

    Args:
        view: Light at nominal power.
        strengths: Nominal camera and effect strengths.
        projector_dots: Dots of the projector.
        draws: Random streams. The streams used here are equal for both imagers.

    Returns:
        The view with modified laser light, or `view` itself if no effect is active.
    """
    focal_px = strengths.nominal.fx_px
    view = dots.dropped(
        view, projector_dots, strengths.value("dropped_dots"), draws.device_rng("projector/dropped")
    )
    view = dots.shifted(
        view,
        projector_dots,
        strengths.value("shifted_dots"),
        focal_px,
        draws.device_rng("projector/shifted"),
    )
    view = dots.doubled(view, strengths.value("doubled_dots"), _SECOND_PATTERN_PX)
    view = dots.widened(view, added_variance(view, strengths))
    return _dim(view, strengths, flicker(strengths.value("flicker"), draws))


def added_variance(view: LightView, strengths: Strengths) -> Ellipse:
    """Return the variances that dot blur and dot defocus add to the dots.

    The variance is uniform over the field in direction cosines. A small change c of a cosine moves
    the tangent t of a ray by (1 + t^2)^(3/2) c radially and by sqrt(1 + t^2) c tangentially.
    """
    focus_m = strengths.nominal.projector_focus_m
    out_of_focus = strengths.value("dot_defocus") * np.abs(1.0 / view.depth_m - 1.0 / focus_m)
    variance_mrad2 = strengths.value("dot_blur") ** 2 + out_of_focus**2
    x, y = np.nan_to_num(view.px), np.nan_to_num(view.py)
    stretch = 1.0 + x**2 + y**2
    across = np.nan_to_num(variance_mrad2 * (1e-3 * strengths.nominal.fx_px) ** 2 * stretch)
    longer = across * (1.0 + stretch)
    return Ellipse(xx=across + longer * x**2, yy=across + longer * y**2, xy=longer * x * y)


def falloff(view: LightView, exponent: float) -> NDArray[np.float64]:
    """Return the relative power (h, w) of a projector that dims off its axis.

    A Gaussian beam exp(-k a^2), as of a single-mode emitter, replaces cos^n a of the effect page.
    Both agree on the axis and at the edge of the field, 45 degrees.
    """
    angle = np.arctan(np.hypot(np.nan_to_num(view.px), np.nan_to_num(view.py)))
    return np.exp(exponent * math.log(math.cos(_EDGE_RAD)) * (angle / _EDGE_RAD) ** 2)


def flicker(deviation: float, draws: Draws) -> float:
    """Draw the relative power of a frame: a gamma variate of mean 1, not a log-normal one."""
    if deviation == 0.0:
        return 1.0
    return float(draws.frame_rng("projector/flicker").gamma(deviation**-2, deviation**2))


def _dim(view: LightView, strengths: Strengths, power: float) -> LightView:
    exponent = strengths.value("projector_falloff")
    laser = view.laser_e
    if exponent != 0.0:
        laser = laser * falloff(view, exponent)
    if strengths.is_active("projector_power"):
        laser = laser * (strengths.value("projector_power") / strengths.nominal.power_w)
    if power != 1.0:
        laser = laser * power
    return view if laser is view.laser_e else dataclasses.replace(view, laser_e=laser)
