"""What a method of completion is given, and what of it is refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import refuse

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

_FARTHEST_M = 100.0  # No depth camera's median is beyond; millimetres are.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Frame:
    """One image with the depth that a camera has of it."""

    rgb: Image  # (h, w, 3) red, green, blue as encoded for display, 0..1; grey three times.
    depth_m: Image  # (h, w) z [m], NaN where not `valid`.
    valid: Mask  # (h, w) True where the camera has depth.

    @property
    def shape(self) -> tuple[int, int]:
        """(h, w)."""
        height, width = self.valid.shape
        return height, width


def checked(rgb: NDArray[Any] | None, depth_m: NDArray[Any], valid: NDArray[Any]) -> Frame:
    """Bring images into one form.

    Args:
        rgb: (h, w, 3) or grey (h, w), uint8, uint16, or floating point 0..1, registered to depth.
        depth_m: (h, w) [m]; whatever stands where not `valid`.
        valid: (h, w) True where there is depth.

    Raises:
        InputError: if there is no image, shapes differ, depth is no number above zero where it is
            valid, seems to be in millimetres, or the image is empty, of another type, or its values
            are out of range.
    """
    if rgb is None:
        advice = "Give the image that the depth is registered to; an infrared one will do."
        raise refuse("rgb", "must be given", "none", advice)
    if depth_m.ndim != 2 or valid.shape != depth_m.shape:
        got = f"{depth_m.shape} and {valid.shape}"
        raise refuse("depth_m and valid", "must be (h, w) of one size", got, "Take one frame's.")
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
        advice = "Mark what is no depth as not valid."
        raise refuse("depth_m", "must be finite and > 0 where valid", bad[0], advice)
    if known.size and np.median(known) > _FARTHEST_M:
        advice = "Divide millimetres by 1000."
        raise refuse("depth_m", "must be in metres", f"a median of {np.median(known):g}", advice)
    return Frame(rgb=_unit(rgb), depth_m=depth, valid=mask)


def _unit(rgb: NDArray[Any]) -> Image:
    """Three channels 0..1."""
    if not rgb.size:
        raise refuse("rgb", "must have pixels", rgb.shape, "Give the frame's own image.")
    whole = rgb.dtype in (np.uint8, np.uint16)
    if not whole and not np.issubdtype(rgb.dtype, np.floating):
        advice = "Say of how many bits it is by its type."
        raise refuse("rgb", "must be uint8, uint16 or floating point", rgb.dtype, advice)
    scale = np.iinfo(rgb.dtype).max if whole else 1
    image = rgb.astype(np.float32) / np.float32(scale)
    if not (np.isfinite(image).all() and image.min() >= 0 and image.max() <= 1):
        got = f"{np.min(image):g} to {np.max(image):g}"
        raise refuse("rgb", "must be 0..1 in floating point", got, "Divide 8 bits by 255.")
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
