"""What rendering leaves behind: linear radiance layers of each imager and the truth of the left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """Radiance [W m^-2 sr^-1] that reaches one imager, each (h, w), light by light.

    Light is linear: any weighted sum of layers is the radiance under lights of those strengths.
    The projector's layers are for the power the sensor had when they were rendered.
    """

    projector_direct: Image  # One bounce from the projector.
    projector_indirect: Image  # Two bounces and more; zeros where not asked for.
    ambient: Image  # Everything that is not the projector.

    @property
    def radiance(self) -> Image:
        """Sum of the layers [W m^-2 sr^-1]."""
        return self.projector_direct + self.projector_indirect + self.ambient


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
    right: View
    truth: Truth
