"""Ambient light on depth images, from the words of the user."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from starling.patterns import errors
from starling.sim import arrays
from starling.sim.scene import spectra
from starling.sim.scene.scene import Ambient
from starling.sim.sensor.sensor import Sensor

_GRADIENT = Ambient().gradient  # Of ambient light that is brighter from above.


@lru_cache(maxsize=8)
def w_m2_per_lux(sensor: Sensor) -> float:
    """Equivalent irradiance of daylight in the band of a sensor's imagers [W m^-2 / lux].

    Imagers without a filter count light of all wavelengths, 25 times that of a band of 50 nm.
    """
    band = spectra.Band.from_imager(sensor.left, sensor.projector)
    return spectra.ambient_w_m2("sun", illuminance_lx=1.0, band=band)


def ambient_of(
    ambient: Ambient, lux: float | None, up: ArrayLike | None, sensor: Sensor
) -> Ambient:
    """Return ambient light of this strength; with `up` it is brighter from above.

    Args:
        ambient: light whose strength and direction hold where none is given.
        lux: daylight; None keeps the strength.
        up: (3,) direction of the zenith; None keeps it.
        sensor: its imagers count the light.

    Raises:
        InputError: if the strength is none of daylight, or `up` no direction.
    """
    if lux is not None:
        errors.in_interval("ambient_lux", lux, 0.0, 1.5e5, "Direct sunlight has 1e5 lux.")
        ambient = dataclasses.replace(ambient, irradiance_w_m2=lux * w_m2_per_lux(sensor))
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
