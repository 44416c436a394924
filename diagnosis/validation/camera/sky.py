"""Ambient light that walls and objects block."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy import ndimage

from starling.diagnosis.validation.camera.light import LightView, SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.psf import Image

_FARTHEST_PX = 120.0  # Largest reach in the image [px].
_DIRECTIONS = 12  # Directions in the image in which surfaces are looked for.
_STEPS = 6  # Samples in each direction.
_FLAT = 0.1  # Sine of the elevation that counts as noise of the normal.
_FAR_M = 100.0  # Depth where there is no surface [m].


def occlude(scene: SceneLight, camera: Nominal, reach_m: float) -> SceneLight:
    """Return the light of a scene with blocked ambient light.

    Args:
        scene: Light under an open sky.
        camera: Nominal camera of both views.
        reach_m: Distance up to which surfaces block light [m]; 0 is an open sky.
    """
    if reach_m == 0.0:
        return scene
    left, right = (_occluded(view, camera, reach_m) for view in (scene.left, scene.right))
    return SceneLight(left=left, right=right)


def _occluded(view: LightView, camera: Nominal, reach_m: float) -> LightView:
    sky_share = openness(view.depth_m, camera, reach_m)
    return dataclasses.replace(view, ambient_e=view.ambient_e * sky_share)


def openness(depth_m: Image, camera: Nominal, reach_m: float) -> Image:
    """Return the share (h, w) of ambient light that nearby surfaces leave, from a depth image.

    In each direction, the highest surface above the tangent plane blocks light below it. Source:
    Bavoil et al., Image-space horizon-based ambient occlusion (2008).
    """
    across, down = camera.tangents()
    point = np.stack([across * depth_m, down * depth_m, depth_m])
    smooth = ndimage.uniform_filter(np.nan_to_num(depth_m, nan=_FAR_M), 3)
    position = np.stack([across * smooth, down * smooth, smooth])
    normal = np.cross(np.gradient(position, axis=1), np.gradient(position, axis=2), axis=0)
    normal *= np.sign(-(normal * point).sum(0)) / np.maximum(np.linalg.norm(normal, axis=0), 1e-12)
    reach_px = np.nan_to_num(camera.fx_px * reach_m / depth_m, nan=1.0).clip(1.0, _FARTHEST_PX)
    rows, columns = np.indices(depth_m.shape, np.float64)
    blocked = np.zeros_like(depth_m)
    for angle in 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS:
        sine = np.zeros_like(depth_m)
        for step in (1 + np.arange(_STEPS)) / _STEPS:
            row = np.rint(rows + step * np.sin(angle) * reach_px).clip(0, camera.height - 1)
            column = np.rint(columns + step * np.cos(angle) * reach_px).clip(0, camera.width - 1)
            neighbour = (row * camera.width + column).astype(np.intp)
            x, y, z = (np.take(axis, neighbour) - axis for axis in point)
            squared_m2 = np.maximum(x * x + y * y + z * z, 1e-18)
            height = (x * normal[0] + y * normal[1] + z * normal[2]) / np.sqrt(squared_m2)
            fade = np.clip(1.0 - squared_m2 / reach_m**2, 0.0, 1.0)
            sine = np.fmax(sine, np.clip(height - _FLAT, 0.0, 1.0) * fade)
        blocked += sine / _DIRECTIONS
    return np.nan_to_num(1.0 - blocked, nan=1.0)
