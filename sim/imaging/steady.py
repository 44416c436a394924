"""Projectors without what is drawn by lot of their light."""

from __future__ import annotations

import dataclasses

from starling.sim.sensor.sensor import Projector


def steady(projector: Projector) -> Projector:
    """The same projector without speckle and flicker: the mean of its light does not move."""
    return dataclasses.replace(projector, speckle_contrast=0.0, flicker=0.0)
