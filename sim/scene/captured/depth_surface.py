"""Scene from reference depth: the surface seen by a camera, continued behind its edges."""

from __future__ import annotations

import cv2
import numpy as np

from starling.sim.arrays import Image
from starling.sim.captures.info import CaptureInfo
from starling.sim.scene.captured import depth_mesh
from starling.sim.scene.captured.room_light import LIT_ROOM_W_M2
from starling.sim.scene.scene import Ambient, Body, Material, Scene

_PATCHED_PX = 8.0  # Largest step that is meshed over on continued surfaces [px].
_MARGIN_PX = 128  # Columns added at each side, for regions that only the right imager sees [px].
_ROWS_PX = 16  # Rows added above and below; lens blur would darken the outermost rows [px].
_SOFT_PX = 9  # Side of the square whose mean reflectance a continued surface takes [px].
_NOISY_SURFACE = 0.01  # Shadow tolerance of surfaces measured with noise.


def scene(
    name: str,
    disparity_px: Image,
    info: CaptureInfo,
    material: Material,
    *,
    reflectance: Image | None = None,
    ambient_w_m2: float = LIT_ROOM_W_M2,
    ambient_share: Image | None = None,
) -> Scene:
    """Build a scene from reference disparity: filled, smoothed, and continued behind edges.

    Args:
        name: Name of the scene.
        disparity_px: (h, w) for the captures' focal length and baseline, NaN where unknown.
        info: Information of the captures.
        material: Material of all surfaces.
        reflectance: (h, w) in the left view; replaces the material's. It may include shading.
        ambient_w_m2: Irradiance of ambient light [W m^-2].
        ambient_share: (h, w) local ambient light relative to `ambient_w_m2`; None: 1 everywhere.
    """
    sides = ((_ROWS_PX, _ROWS_PX), (_MARGIN_PX, _MARGIN_PX))
    front_px = np.pad(depth_mesh.smooth(depth_mesh.close_holes(disparity_px)), sides, mode="edge")
    hidden_px, source = depth_mesh.continue_behind(front_px)

    def texture_pair(image: Image | None) -> tuple[Image | None, Image | None]:
        """Image values on the surface and on the continued surface behind it."""
        if image is None:
            return None, None
        front = np.pad(image, sides, mode="reflect")
        soft = np.asarray(cv2.blur(front, (_SOFT_PX, _SOFT_PX)), np.float32)
        return front, soft.ravel()[source]

    front, back = texture_pair(reflectance)
    lit_front, lit_back = texture_pair(ambient_share)
    cx, cy = info.cx_px + _MARGIN_PX, info.cy_px + _ROWS_PX
    intrinsics = np.array([[info.fx_px, 0, cx], [0, info.fy_px, cy], [0, 0, 1]])
    parts = (
        ("surface", front_px, {}, front, lit_front),
        ("surface behind", hidden_px, {"jump_px": _PATCHED_PX}, back, lit_back),
    )
    return Scene(
        name=name,
        bodies=tuple(
            Body(
                name=part,
                mesh=depth_mesh.triangulate(
                    disparity, intrinsics, info.focal_baseline_px_m, **limit
                ),
                material=material,
                texture=texture,
                ambient_share=share,
            )
            for part, disparity, limit, texture, share in parts
            if np.isfinite(disparity).any()
        ),
        ambient=Ambient(irradiance_w_m2=ambient_w_m2, gradient=0.0),
        shadow_tolerance=_NOISY_SURFACE,
    )
