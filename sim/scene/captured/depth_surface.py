"""Reference depth as a scene: the surface seen from a camera, going on behind its edges."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.captures.info import CaptureInfo
from starling.sim.scene.captured import depth_mesh
from starling.sim.scene.captured.room_light import LIT_ROOM_W_M2
from starling.sim.scene.scene import Ambient, Body, Material, Scene

Array = NDArray[np.float32]

_PATCHED_PX = 8.0  # What continues from different places is joined up to this step.
_MARGIN_PX = 128  # Beyond the image, for what only the right imager sees;
_ROWS_PX = 16  # above and below for what a lens brings in: outermost rows would be dark.
_SOFT_PX = 9  # Side of the square whose mean reflectance a surface goes on with behind an edge.
_NOISY_SURFACE = 0.01  # Shadow tolerance of surfaces measured with noise.


def scene(
    name: str,
    disparity_px: Array,
    info: CaptureInfo,
    material: Material,
    *,
    reflectance: Array | None = None,
    ambient_w_m2: float = LIT_ROOM_W_M2,
    ambient_share: Array | None = None,
) -> Scene:
    """Turn a map of reference disparity into a scene: closed, smoothed, going on behind edges.

    Args:
        name: of the scene.
        disparity_px: (h, w) by the captures' own f b, NaN where unknown.
        info: of the captures.
        material: all over.
        reflectance: (h, w) in the left view, in place of the material's own; the light's shading
            may be in it.
        ambient_w_m2: irradiance of ambient light.
        ambient_share: (h, w) of that which falls on what the left view sees; None: all of it.
    """
    sides = ((_ROWS_PX, _ROWS_PX), (_MARGIN_PX, _MARGIN_PX))
    seen = np.pad(depth_mesh.smoothed(depth_mesh.closed(disparity_px)), sides, mode="edge")
    hidden, source = depth_mesh.behind(seen)

    def painted(image: Array | None) -> tuple[Array | None, Array | None]:
        """What the image has, on the surface and on what goes on behind it."""
        if image is None:
            return None, None
        front = np.pad(image, sides, mode="reflect")
        soft = np.asarray(cv2.blur(front, (_SOFT_PX, _SOFT_PX)), np.float32)
        return front, soft.ravel()[source]

    front, back = painted(reflectance)
    lit_front, lit_back = painted(ambient_share)
    cx, cy = info.cx_px + _MARGIN_PX, info.cy_px + _ROWS_PX
    intrinsics = np.array([[info.fx_px, 0, cx], [0, info.fy_px, cy], [0, 0, 1]])
    parts = (
        ("surface", seen, {}, front, lit_front),
        ("surface behind", hidden, {"jump_px": _PATCHED_PX}, back, lit_back),
    )
    return Scene(
        name=name,
        bodies=tuple(
            Body(
                name=part,
                mesh=depth_mesh.triangles(disparity, intrinsics, info.focal_baseline_px_m, **limit),
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
