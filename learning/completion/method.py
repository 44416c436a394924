"""The interface of all completion methods."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.frame import CompletionFrame, Image, make_frame

CANNOT = "cannot: no pixel has depth to go by"
NOTHING = "nothing to complete: every pixel has depth"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Completed:
    """Completed depth of a frame."""

    depth_m: Image  # (h, w) z [m]; NaN where the method gives none.
    # (h, w) expected standard deviation of the error of depth_m [m]; NaN where it is not estimated.
    sigma_m: Image
    note: str = ""  # Reason why the frame was not completed: `CANNOT` or `NOTHING`.


def unknown_sigma(frame: CompletionFrame) -> Image:
    """Expected error of a method that does not estimate it: NaN (h, w)."""
    return np.full(frame.shape, np.nan, np.float32)


class CompletionMethod(Protocol):
    """A completion method, ready for use."""

    @property
    def name(self) -> str:
        """Name of the method on the command line of `starling complete`."""
        ...

    def fill(self, frame: CompletionFrame) -> Completed:
        """Complete a frame that has both holes and depth.

        Raises:
            InputError: if the method cannot take this size.
        """
        ...


def complete(
    method: CompletionMethod, rgb: NDArray[Any] | None, depth_m: NDArray[Any], valid: NDArray[Any]
) -> Completed:
    """Complete one frame by any method.

    Args:
        method: the completion method.
        rgb: (h, w, 3) or grey (h, w), registered to depth.
        depth_m: (h, w) [m].
        valid: (h, w) True where there is depth.

    Returns:
        Dense depth and its expected error. For a frame without any depth: NaN everywhere and
        `CANNOT`. For a frame without holes: its own depth and `NOTHING`.

    Raises:
        InputError: see `make_frame`.
    """
    frame = make_frame(rgb, depth_m, valid)
    unknown = unknown_sigma(frame)
    if not frame.valid.any():
        return Completed(depth_m=unknown, sigma_m=unknown, note=CANNOT)
    if frame.valid.all():
        return Completed(depth_m=frame.depth_m, sigma_m=unknown, note=NOTHING)
    return method.fill(frame)
