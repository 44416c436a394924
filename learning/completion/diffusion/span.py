"""Depth in metres to what the autoencoder takes, and back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.alignment import Normalisation, normalisation
from starling.learning.completion.frame import Frame, Image

HOLE = -1.0  # Of a pixel without depth; the paper does not say what it gives them.
_INNER = 0.8  # Where -1 and 1 come to lie: what is in holes is often beyond all that is measured.


@dataclass(frozen=True, slots=True)
class Span:
    """The depths that a sensor's frame spans, which fix scale and shift of its encoding.

    Truth and prediction are encoded by the sensor's span, so that a prediction comes back in
    metres without any truth (the paper's "sensor depth scale", sec. 4.3).
    """

    normalisation: Normalisation

    @classmethod
    def of(cls, frame: Frame) -> Span:
        """Span of a frame that has depth somewhere."""
        return cls(normalisation(frame.depth_m, frame.valid))

    def encoded(self, depth_m: Image) -> Image:
        """Encode depth, any shape, to -1..1; what is NaN becomes `HOLE`."""
        values = np.clip(_INNER * self.normalisation(depth_m), -1, 1)
        return np.where(np.isnan(depth_m), np.float32(HOLE), values)

    def metres(self, encoded: NDArray[Any]) -> Image:
        """Depth [m] of what `encoded` gives; NaN where none above zero comes out."""
        depth = self.normalisation.denormalise(encoded / _INNER)
        return np.where(depth > 0, depth, np.float32(np.nan))
