"""The interface of all completion methods: the input, its validation, and the result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_FARTHEST_M = 100.0  # Least implausible median depth; depth in millimetres exceeds it.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class CompletionFrame:
    """An image with the camera's depth of the same view."""

    rgb: Image  # (h, w, 3) display-encoded red, green, blue, 0..1; grey is repeated.
    depth_m: Image  # (h, w) z [m], NaN where not `valid`.
    valid: Mask  # (h, w) True where the camera has depth.

    @property
    def shape(self) -> tuple[int, int]:
        """(h, w)."""
        height, width = self.valid.shape
        return height, width


def make_frame(
    rgb: NDArray[Any] | None, depth_m: NDArray[Any], valid: NDArray[Any]
) -> CompletionFrame:
    """Validate images and convert them to a frame.

    Args:
        rgb: (h, w, 3) or grey (h, w), uint8, uint16, or floating point 0..1, registered to depth.
        depth_m: (h, w) [m]; arbitrary where not `valid`.
        valid: (h, w) True where there is depth.

    Raises:
        InputError: if there is no image or shapes differ; valid depth is not a number above zero or
            seems to be in millimetres; the image is empty, of another type, or out of range.
    """
    if rgb is None:
        advice = "Give the image that the depth is registered to; an infrared one will do."
        raise refuse("rgb", "must be given", "none", advice)
    if depth_m.ndim != 2 or valid.shape != depth_m.shape:
        got = f"{depth_m.shape} and {valid.shape}"
        advice = "Give both of one frame."
        raise refuse("depth_m and valid", "must be (h, w) of one size", got, advice)
    if rgb.ndim not in (2, 3) or (rgb.ndim == 3 and rgb.shape[2] != 3):
        raise refuse("rgb", "must be (h, w, 3) or (h, w)", rgb.shape, "Drop the alpha channel.")
    if rgb.shape[:2] != depth_m.shape:
        advice = "Register the image to depth, or depth to the image, first."
        got = f"{rgb.shape[:2]} and {depth_m.shape}"
        raise refuse("rgb and depth_m", "must have one size", got, advice)
    mask = np.asarray(valid, bool)
    depth = np.where(mask, depth_m, np.nan).astype(np.float32)
    known = depth[mask]
    bad = known[~(np.isfinite(known) & (known > 0))]
    if bad.size:
        advice = "Mark pixels without depth as not valid."
        raise refuse("depth_m", "must be finite and > 0 where valid", bad[0], advice)
    if known.size and np.median(known) > _FARTHEST_M:
        advice = "Divide millimetres by 1000; of captures, check depth_unit_m."
        raise refuse("depth_m", "must be in metres", f"a median of {np.median(known):g}", advice)
    return CompletionFrame(rgb=_unit(rgb), depth_m=depth, valid=mask)


def _unit(rgb: NDArray[Any]) -> Image:
    """Convert an image to three channels 0..1."""
    if not rgb.size:
        raise refuse("rgb", "must have pixels", rgb.shape, "Give the image of the frame.")
    whole = rgb.dtype in (np.uint8, np.uint16)
    if not whole and not np.issubdtype(rgb.dtype, np.floating):
        advice = "Convert the image to one of these types."
        raise refuse("rgb", "must be uint8, uint16 or floating point", rgb.dtype, advice)
    scale = np.iinfo(rgb.dtype).max if whole else 1
    image = rgb.astype(np.float32) / np.float32(scale)
    if not (np.isfinite(image).all() and image.min() >= 0 and image.max() <= 1):
        got = f"{np.min(image):g} to {np.max(image):g}"
        raise refuse("rgb", "must be 0..1 in floating point", got, "Divide 8 bits by 255.")
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)


CANNOT = "cannot: no pixel has depth to go by"
NOTHING = "nothing to complete: every pixel has depth"
LEVELS = (68, 95)  # Shares of errors that intervals are made for [%].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Completed:
    """Completed depth of a frame."""

    depth_m: Image  # (h, w) z [m]; NaN where the method gives none.
    # (h, w) expected standard deviation of the error of depth_m [m]; NaN where it is not estimated.
    sigma_m: Image
    # Level of `LEVELS` -> (h, w) half-width of the interval around depth_m that holds this share of
    # the errors [m]. Empty where the method gives no intervals.
    half_m: Mapping[int, Image] = field(default_factory=dict)
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
