"""Common noise models of depth images, for `noise_models.py`. Disparities are in pixels."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.captures.info import CaptureInfo

Image = NDArray[np.float32]
QUANTUM_PX = 1 / 32  # Step of a D415's disparity.


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A clean surface seen by the left imager."""

    disparity_px: Image  # (h, w), NaN without a surface.
    depth_m: Image
    tilt: Image  # (h, w) angle between ray and normal [rad].
    focal_baseline: float  # [px m]

    @staticmethod
    def from_depth(depth_m: Image, info: CaptureInfo) -> Surface:
        """Compute disparity and tilt of a depth image (h, w) [m]."""
        disparity_px = info.disparity_px(depth_m)
        rows, columns = np.indices(depth_m.shape, dtype=np.float32)
        x, y = (columns - info.cx_px) / info.fx_px, (rows - info.cy_px) / info.fy_px
        nearness = (1 / depth_m).astype(np.float32)
        across, down = (cv2.Sobel(nearness, cv2.CV_32F, *order) / 8 for order in ((1, 0), (0, 1)))
        # The plane n . p = 1 has the nearness n . ray, so its gradient gives n.
        normal_x, normal_y = across * info.fx_px, down * info.fy_px
        normal_z = nearness - normal_x * x - normal_y * y
        length = np.sqrt(normal_x**2 + normal_y**2 + normal_z**2)
        cosine = nearness / length / np.sqrt(1 + x**2 + y**2)
        tilt = np.nan_to_num(np.arccos(np.clip(np.abs(cosine), 0, 1)), nan=np.pi / 2)
        return Surface(disparity_px, depth_m, tilt.astype(np.float32), info.focal_baseline_px_m)


def gaussian(surface: Surface, rng: np.random.Generator, *, noise_px: float, share: float) -> Image:
    """Noise proportional to the squared depth, which is even in disparity, and random holes."""
    noisy = surface.disparity_px + noise_px * rng.standard_normal(surface.depth_m.shape)
    noisy[rng.random(noisy.shape) < share] = np.nan
    return noisy.astype(np.float32)


def handa(
    surface: Surface, rng: np.random.Generator, *, noise_px: float, lateral_px: float
) -> Image:
    """Lateral and axial noise, then rounding.

    Source: Handa et al. 2014, ICRA (ICL-NUIM), after Barron and Malik 2013, CVPR. Their sensor is a
    Kinect: 1/2 px, and 1/6 of a code of 1/8 px.
    """
    shifted = _shifted(surface.disparity_px, rng, np.float32(lateral_px))
    noisy = shifted + noise_px * rng.standard_normal(shifted.shape)
    return (np.rint(noisy / QUANTUM_PX) * QUANTUM_PX).astype(np.float32)


def nguyen(
    surface: Surface,
    rng: np.random.Generator,
    *,
    axial: float,
    lateral: float,
    steepest_deg: float,
) -> Image:
    """Axial and lateral noise of a Kinect by depth and tilt, scaled; steep surfaces are holes.

    Source: Nguyen, Izadi and Lovell 2012, 3DIMPVT, eq. 2, 3 and 5.
    """
    tilt = np.minimum(surface.tilt, np.deg2rad(80))  # The formulas' end.
    steepness = tilt / (np.pi / 2 - tilt)
    depth_m = surface.depth_m
    sigma_m = 0.0012 + 0.0019 * (depth_m - 0.4) ** 2
    sigma_m += np.where(tilt > np.deg2rad(60), 1e-4 / np.sqrt(depth_m) * steepness**2, 0)
    sigma_px = surface.disparity_px * sigma_m / depth_m
    shifted = _shifted(surface.disparity_px, rng, lateral * (0.8 + 0.035 * steepness))
    noisy = shifted + axial * sigma_px * rng.standard_normal(tilt.shape)
    noisy[surface.tilt > np.deg2rad(steepest_deg)] = np.nan
    return noisy.astype(np.float32)


def edges(
    surface: Surface,
    rng: np.random.Generator,
    *,
    noise_px: float,
    reach_px: int,
    jump_px: float,
    share: float,
) -> Image:
    """Even disparity noise; pixels near depth edges are holes with a probability."""
    noisy = gaussian(surface, rng, noise_px=noise_px, share=0.0)
    noisy[_near_edges(surface, reach_px, jump_px) & (rng.random(noisy.shape) < share)] = np.nan
    return noisy


def edges_and_shadow(
    surface: Surface,
    rng: np.random.Generator,
    *,
    noise_px: float,
    reach_px: int,
    jump_px: float,
    share: float,
) -> Image:
    """As `edges`; what the right imager does not see is a hole too."""
    noisy = edges(surface, rng, noise_px=noise_px, reach_px=reach_px, jump_px=jump_px, share=share)
    noisy[shadow(surface.disparity_px)] = np.nan
    return noisy


def shadow(disparity_px: Image) -> NDArray[np.bool_]:
    """Pixels (h, w) that the right imager does not see, to one column."""
    height, width = disparity_px.shape
    known = np.nan_to_num(disparity_px)
    column = np.rint(np.arange(width) - known).astype(np.intp)
    row = np.broadcast_to(np.arange(height)[:, None], column.shape)
    inside = column >= 0
    nearest = np.zeros((height, width), np.float32)
    np.maximum.at(nearest, (row[inside], column[inside]), known[inside])
    seen = np.zeros(known.shape, bool)
    seen[inside] = known[inside] >= nearest[row[inside], column[inside]] - 1
    return ~seen


def _near_edges(surface: Surface, reach_px: int, jump_px: float) -> NDArray[np.bool_]:
    known = np.nan_to_num(surface.disparity_px)
    kernel = np.ones((3, 3), np.uint8)
    step = (cv2.dilate(known, kernel) - cv2.erode(known, kernel)) > jump_px
    side = 2 * reach_px - 1
    return cv2.dilate(step.astype(np.uint8), np.ones((side, side), np.uint8)).astype(bool)


def _shifted(image: Image, rng: np.random.Generator, sigma_px: NDArray | np.floating) -> Image:
    """Look up each pixel at a place with Gaussian offsets, linearly."""
    rows, columns = np.indices(image.shape, dtype=np.float32)
    offset = rng.standard_normal((2, *image.shape)) * sigma_px
    places = (columns + offset[0]).astype(np.float32), (rows + offset[1]).astype(np.float32)
    moved = cv2.remap(image, *places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, np.float32)
