"""Output of rendering: radiance layers of each imager, and ground truth of the left one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image, Labels, Mask


@dataclass(frozen=True, kw_only=True, slots=True)
class ViewLayers:
    """Radiance of each light in one imager, and depth of the surfaces; each (h, w).

    Light is linear: the sum of the layers, weighted by the strengths of the lights, is the
    radiance [W m^-2 sr^-1] (see `starling.sim.imaging.lens_input`).
    """

    projector_direct: Image  # One bounce from the projector, of 1 W [W m^-2 sr^-1].
    projector_indirect: Image  # Two bounces and more, of 1 W; zeros if not rendered.
    ambient: Image  # Under ambient light of 1 W m^-2 [W m^-2 sr^-1].
    other: Image  # Sun and other projectors, at their own strength [W m^-2 sr^-1].
    depth_m: Image  # z along this imager's axis; NaN where there is no surface.
    body: Labels  # Object number from 1; 0 where there is no surface.
    # The view in red, green and blue light, behind a mosaic of colour filters; () is grey light.
    bands: tuple[ViewLayers, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class Truth:
    """Ground truth at the left imager's pixel centres, each (h, w)."""

    depth_m: Image  # z along the optical axis; NaN where there is no surface.
    normal: NDArray[np.float32]  # (h, w, 3) unit, left frame, towards the imager; or NaN.
    material: Labels  # Object number from 1; 0 where there is no surface.
    right_sees: Mask  # The right imager sees the same point, inside its image.
    lit: Mask  # The projector reaches the same point, inside its field.


@dataclass(frozen=True, kw_only=True, slots=True)
class Layers:
    """Rendered layers of one scene and sensor."""

    left: ViewLayers
    right: ViewLayers | None  # None: structured light, which has one imager.
    truth: Truth

    def with_bands(self, colours: Sequence[Layers]) -> Layers:
        """Return the layers with views of other light as bands: red, green, blue, or none."""
        if not colours:
            return self
        left = tuple(layers.left for layers in colours)
        right = tuple(layers.right for layers in colours if layers.right is not None)
        return replace(
            self,
            left=replace(self.left, bands=left),
            right=None if self.right is None else replace(self.right, bands=right),
        )
