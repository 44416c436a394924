"""Points and normals of the surfaces in a depth image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.learning.data.example import Image, Mask
from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry import planes

Points = NDArray[np.float64]

_STEP_PX = 0.6  # Greatest disparity step within a surface, without slope [px].
_STEEPEST = 0.35  # Greatest slope of disparity [px / px]: an incidence of 77 degrees at 0.7 m.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Cloud:
    """Points of a surface in the left imager's frame."""

    point_m: Points  # (n, 3)
    normal: Points  # (n, 3) unit, towards the imager.

    def __len__(self) -> int:
        return len(self.point_m)

    def rows(self) -> NDArray[np.float32]:
        """Points and normals as rows (n, 6), the format of OpenCV's `ppf_match_3d`."""
        return np.hstack([self.point_m, self.normal]).astype(np.float32)

    def moved(self, scene_from_cloud: Points) -> Cloud:
        """Return the cloud after a rigid motion (4, 4)."""
        rotation = scene_from_cloud[:3, :3]
        return Cloud(
            point_m=self.point_m @ rotation.T + scene_from_cloud[:3, 3],
            normal=self.normal @ rotation.T,
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Surface:
    """Points and normals by pixel; NaN where there is no depth."""

    point_m: NDArray[np.float32]  # (h, w, 3)
    normal: NDArray[np.float32]  # (h, w, 3) unit, towards the imager.

    @property
    def known(self) -> Mask:
        """Pixels with depth (h, w)."""
        return np.isfinite(self.point_m[..., 2])

    def cloud(self, pixels: Mask) -> Cloud:
        """Cloud of the pixels (h, w) that have depth, in row order."""
        chosen = pixels & self.known
        return Cloud(
            point_m=self.point_m[chosen].astype(np.float64),
            normal=self.normal[chosen].astype(np.float64),
        )


def surface(depth_m: Image, info: CaptureInfo) -> Surface:
    """Compute points and normals of a depth image (h, w) [m], NaN where unknown.

    Raises:
        InputError: if too few pixels are known for a plane.
    """
    disparity = info.disparity_px(depth_m)
    known = np.isfinite(disparity)
    fitted = planes.surface_planes(disparity, known)
    y, x = np.indices(depth_m.shape, np.float32)
    across, down = x - np.float32(info.cx_px), y - np.float32(info.cy_px)
    # Disparity is f b (n . ray) over the plane's distance, so its gradient and value determine n.
    ahead = fitted.disparity_px - fitted.across * across - fitted.down * down
    towards = [-info.fx_px * fitted.across, -info.fy_px * fitted.down, -ahead]
    normal = np.stack(towards, axis=-1).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    normal[~known] = np.nan
    ray = np.stack([across / info.fx_px, down / info.fy_px, np.ones_like(x)], axis=-1)
    point = ray * np.asarray(depth_m)[..., None]
    return Surface(point_m=point.astype(np.float32), normal=normal)


def same_surface(rise_px: NDArray[np.floating], distance_px: float | Points) -> Mask:
    """Whether two pixels are on one surface, by difference of disparity and distance in pixels."""
    return np.asarray(np.abs(rise_px) <= _STEP_PX + _STEEPEST * distance_px)
