"""Projectors without random fluctuation of their light."""

from __future__ import annotations

import dataclasses

from starling.sim.sensor.sensor import Projector


def steady(projector: Projector) -> Projector:
    """Return the projector without speckle and flicker; its mean light is unchanged."""
    return dataclasses.replace(projector, speckle_contrast=0.0, flicker=0.0)
