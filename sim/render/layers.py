"""What rendering leaves behind: linear radiance layers of each imager and the truth of the left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """What reaches one imager, each (h, w), light by light, and how far its surfaces are.

    Light is linear: a weighted sum of layers is the radiance [W m^-2 sr^-1] under lights of those
    strengths (see `sim.light`).
    """

    projector_direct: Image  # One bounce from the projector, of 1 W [W m^-2 sr^-1].
    projector_indirect: Image  # Two bounces and more, of 1 W; zeros where not asked for.
    ambient: Image  # Under ambient light of 1 W m^-2 [W m^-2 sr^-1].
    other: Image  # Sun and other devices' projectors, at their own strength [W m^-2 sr^-1].
    depth_m: Image  # z along this imager's axis; NaN where there is no surface.
    body: NDArray[np.uint32]  # Object number from 1; 0 where there is no surface.


@dataclass(frozen=True, kw_only=True, slots=True)
class Truth:
    """What the left imager's pixel centres see, each (h, w)."""

    depth_m: Image  # z along the optical axis; NaN where there is no surface.
    normal: NDArray[np.float32]  # (h, w, 3) unit, left frame, towards the imager; NaN likewise.
    material: NDArray[np.uint32]  # Object number from 1; 0 where there is no surface.
    right_sees: Mask  # The right imager sees the same point, inside its image.
    lit: Mask  # The projector reaches the same point, inside its field.


@dataclass(frozen=True, kw_only=True, slots=True)
class Layers:
    """One scene as one sensor's imagers receive it."""

    left: View
    right: View | None  # None: structured light, which has one imager.
    truth: Truth
