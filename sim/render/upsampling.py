"""Joint bilateral filtering and upsampling of light that is smooth over a surface."""

from __future__ import annotations

import cv2
import numpy as np

from starling.sim.arrays import Image
from starling.sim.render.paths import Surfaces

_OTHER_DEPTH = 0.05  # Relative depth step that separates surfaces.
_OTHER_NORMAL = 0.3  # Step of a normal's component that separates surfaces.


def guide(surfaces: Surfaces) -> Image:
    """Log depth and normal (h, w, 3), scaled so that a difference of 1 separates surfaces."""
    depth = np.log(np.maximum(surfaces.depth_m, np.float32(1e-3)))[..., None]
    normal = surfaces.normal[..., :2]
    return np.concatenate([depth / _OTHER_DEPTH, normal / _OTHER_NORMAL], -1, dtype=np.float32)


def low_pass(image: Image, guide: Image, sigma_px: float) -> Image:
    """Joint bilateral filter, followed by the filtered residual.

    Near a corner, light is averaged with darker neighbours only. The second pass restores most of
    this loss.

    Source: joint bilateral filter; the second pass is Tukey's "twicing" (Exploratory Data
    Analysis, 1977, sec. 16).
    """
    smooth = cv2.ximgproc.jointBilateralFilter(guide, image, -1, 1.0, sigma_px)
    rest = cv2.ximgproc.jointBilateralFilter(guide, image - smooth, -1, 1.0, sigma_px)
    return np.asarray(np.maximum(smooth + rest, 0), np.float32)


def upsample(coarse: Image, coarse_guide: Image, guide: Image) -> Image:
    """Joint bilateral upsampling to the guide's size.

    Source: Kopf et al., Joint bilateral upsampling, 2007, eq. 3.
    """
    height, width = guide.shape[:2]
    rows, columns = coarse.shape
    row = (np.arange(height, dtype=np.float32) + 0.5) * (rows / height) - 0.5
    column = (np.arange(width, dtype=np.float32) + 0.5) * (columns / width) - 0.5
    total, weights = np.zeros((2, height, width), np.float32)
    for down, across in np.ndindex(2, 2):
        i, j = np.floor(row).astype(int) + down, np.floor(column).astype(int) + across
        near = np.outer(1 - np.abs(row - i), 1 - np.abs(column - j)).astype(np.float32)
        cell = np.ix_(np.clip(i, 0, rows - 1), np.clip(j, 0, columns - 1))
        apart = np.abs(guide - coarse_guide[cell]).sum(axis=-1)
        weight = (near + 1e-3) * (np.exp(-0.5 * apart**2) + np.float32(1e-6))
        total += weight * coarse[cell]
        weights += weight
    return total / weights
