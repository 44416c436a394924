"""Ambient light on depth images, from the words of the user."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from starling.patterns import errors
from starling.sim import arrays
from starling.sim.scene.scene import Ambient

# Daylight in the imager's band [W m^-2 / lux], for an assumed band of 50 nm. ASTM G173 (AM1.5
# global) has 0.89 W m^-2 nm^-1 at 850 nm, and 109 klux.
W_M2_PER_LUX = 0.89 * 50 / 109e3
_GRADIENT = Ambient().gradient  # Of ambient light that is brighter from above.


def ambient_of(ambient: Ambient, lux: float | None, up: ArrayLike | None) -> Ambient:
    """Return ambient light of this strength; with `up` it is brighter from above.

    Args:
        ambient: light whose strength and direction hold where none is given.
        lux: daylight; None keeps the strength.
        up: (3,) direction of the zenith; None keeps it.

    Raises:
        InputError: if the strength is none of daylight, or `up` no direction.
    """
    if lux is not None:
        errors.in_interval("ambient_lux", lux, 0.0, 2e5, "Direct sunlight has 1e5 lux.")
        ambient = dataclasses.replace(ambient, irradiance_w_m2=lux * W_M2_PER_LUX)
    if up is None:
        return ambient
    direction = np.asarray(arrays.numbers("up", up), np.float64)
    length = np.linalg.norm(direction) if direction.shape == (3,) else 0.0
    if not 0 < length < np.inf:
        advice = "Give the zenith in the camera's axes: x right, y down, z forward."
        raise errors.refuse("up", "must be a direction (3,)", direction.tolist(), advice)
    x, y, z = (direction / length).tolist()
    return dataclasses.replace(ambient, gradient=from_above(ambient), up=(x, y, z))


def from_above(ambient: Ambient) -> float:
    """Return the gradient of ambient light with a known zenith."""
    return ambient.gradient or _GRADIENT
