"""Reflectance of printed and grainy surfaces: a pattern that is fixed on each body."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import LightView, SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.psf import Image

_WAVES = 12  # Plane waves of a field.
_PRINT_M = (0.03, 0.15)  # Wavelengths of print [m].
_GRAIN_M = (0.004, 0.02)  # Wavelengths of grain [m].
_HARD = 4.0  # Steepness of the edges of print.
_DARKEST = 0.1  # Least relative reflectance.


def apply(scene: SceneLight, camera: Nominal, contrast: float, draws: Draws) -> SceneLight:
    """Return the light of a scene whose bodies have print and grain.

    Each body has its own pattern. It is a function of the position in space, so both imagers see
    the same one.

    Args:
        scene: Light of plain surfaces.
        camera: Nominal camera of both views.
        contrast: Standard deviation over mean of the reflectance; of each body 0.5 to 1.5 of it.
        draws: Random streams of the scene.
    """
    if contrast == 0.0:
        return scene
    return SceneLight(
        left=_textured(scene.left, camera, 0.0, contrast, draws),
        right=_textured(scene.right, camera, camera.baseline_m, contrast, draws),
    )


def _textured(
    view: LightView, camera: Nominal, x_m: float, contrast: float, draws: Draws
) -> LightView:
    factor = np.ones(camera.shape)
    across, down = camera.tangents()
    known = (view.body > 0) & np.isfinite(view.depth_m)
    for body in np.unique(view.body[known]):
        inside = known & (view.body == body)
        z = view.depth_m[inside]
        points = np.stack([across[inside] * z + x_m, down[inside] * z, z], -1)
        rng = draws.scene_rng(f"texture/{body}")
        strength = contrast * rng.uniform(0.5, 1.5)
        pixel_m = z / camera.fx_px
        print_field = np.tanh(_HARD * _field(points, pixel_m, _PRINT_M, rng))
        grain = _field(points, pixel_m, _GRAIN_M, rng)
        factor[inside] = np.maximum(1.0 + strength * (0.8 * print_field + 0.6 * grain), _DARKEST)
    return dataclasses.replace(
        view,
        laser_e=view.laser_e * factor,
        even_e=view.even_e * factor,
        ambient_e=view.ambient_e * factor,
        other_e=view.other_e * factor,
    )


def _field(
    points_m: Image, pixel_m: Image, wavelengths_m: tuple[float, float], rng: np.random.Generator
) -> Image:
    """Return a field (n,) of mean 0 and variance 1 at points (n, 3): plane waves of equal power.

    A pixel averages each wave over its area, which dims waves shorter than two pixels.
    """
    shortest, longest = wavelengths_m
    length_m = shortest * (longest / shortest) ** rng.random(_WAVES)
    direction = rng.standard_normal((_WAVES, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    phase = rng.uniform(0.0, 2.0 * math.pi, _WAVES)
    field = np.zeros(len(points_m))
    for wave in range(_WAVES):
        number = 2.0 * math.pi / length_m[wave]
        seen = np.exp(-((number * pixel_m) ** 2) / 24.0)  # The variance of a pixel is 1 / 12 px^2.
        field += seen * np.cos(number * (points_m @ direction[wave]) + phase[wave])
    return field * math.sqrt(2.0 / _WAVES)
