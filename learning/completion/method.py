"""The one interface of all methods that complete depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.frame import Frame, Image, checked

CANNOT = "cannot: no pixel has depth to go by"
NOTHING = "nothing to complete: every pixel has depth"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Completed:
    """Depth of a frame, everywhere."""

    depth_m: Image  # (h, w) z [m]; NaN where the method gives none.
    sigma_m: Image  # (h, w) standard deviation it expects of depth_m [m]; NaN where it tells none.
    said: str = ""  # Why depth is as it was given: `CANNOT`, `NOTHING`.


def untold(frame: Frame) -> Image:
    """Expected error of a method that tells none: NaN (h, w)."""
    return np.full(frame.shape, np.nan, np.float32)


class Method(Protocol):
    """A way to complete depth, ready to be used."""

    @property
    def name(self) -> str:
        """What it is called by `starling complete`."""
        ...

    def fill(self, frame: Frame) -> Completed:
        """Complete a frame that has both holes and depth.

        Raises:
            InputError: if the method cannot take this size.
        """
        ...


def complete(
    method: Method, rgb: NDArray[Any] | None, depth_m: NDArray[Any], valid: NDArray[Any]
) -> Completed:
    """Complete one frame by any method.

    Args:
        method: that does it.
        rgb: (h, w, 3) or grey (h, w), registered to depth.
        depth_m: (h, w) [m].
        valid: (h, w) True where there is depth.

    Returns:
        Depth everywhere, and its expected error. Of a frame without any depth, NaN everywhere and
        `CANNOT`; one without holes comes back as it is, with `NOTHING`.

    Raises:
        InputError: as `checked`.
    """
    frame = checked(rgb, depth_m, valid)
    unknown = untold(frame)
    if not frame.valid.any():
        return Completed(depth_m=unknown, sigma_m=unknown, said=CANNOT)
    if frame.valid.all():
        return Completed(depth_m=frame.depth_m, sigma_m=unknown, said=NOTHING)
    return method.fill(frame)
