"""Speckle in a pixel by the theory of integrated intensity."""

from __future__ import annotations

import numpy as np

from starling.sim.imaging.optics import speckle


def looks_in_pixel(grain_px: float) -> float:
    """Return the number of independent looks that a pixel's area averages, Goodman's M.

    Source: Goodman 2007, sec. 4.6, for a square pixel and a Gaussian correlation.
    """
    return 1 / float(speckle._pixel_covariance(np.zeros(1), grain_px)[0]) ** 2
