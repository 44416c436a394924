"""Texture of surfaces: print, grain, weave, dirt. It lies on the surface, so both imagers see it.

The relative reflectance at a point p of a body is 1 + c g(p), at least 0. The field g has unit
variance. It is a sum of plane waves in the body's frame, with random directions and phases. Their
wavelengths lie evenly in the logarithm between 1 and 128 mm. The variance of an octave is
proportional to wavelength^(s - 2). On a plane the power density then falls with the spatial
frequency f as f^-s.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

import numba as nb
import numpy as np
from numpy.typing import NDArray

from starling.sim import randomness
from starling.sim.arrays import Image, Labels
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render.layers import ViewLayers
from starling.sim.scene.scene import Body, Scene
from starling.sim.sensor.sensor import Sensor

Side = Literal["left", "right"]

_LONGEST_M = 0.128  # Longest wavelength: objects and shading are larger [m].
_OCTAVES = 7  # Down to 1 mm, one pixel of a D415 at 0.9 m.
_WAVES = 16  # Waves of an octave; fewer show as stripes.
_MOST_LOSS = 4.6  # Waves that a pixel averages to 1 % of their amplitude are left out.
_TABLE = 4096  # Entries of the tables; errors are below 0.1 % of an amplitude.
_PIXEL = 12**-0.5  # Standard deviation of a pixel's box over its side.
_UNTEXTURED = ("mirror", "glass")


def textured(view: ViewLayers, scene: Scene, sensor: Sensor, side: Side) -> ViewLayers:
    """Multiply all light that textured bodies reflect; the same object without texture.

    Args:
        view: rendered layers of one imager.
        scene: its finish names bodies, contrast and slope.
        sensor: its geometry.
        side: which imager.
    """
    if scene.finish.texture_contrast == 0 or not scene.bodies:
        return view
    relative = relative_reflectance(view.depth_m, view.body, scene, sensor, side)
    bands = tuple(_multiplied(band, relative) for band in view.bands)
    return dataclasses.replace(_multiplied(view, relative), bands=bands)


def _multiplied(view: ViewLayers, relative: Image) -> ViewLayers:
    return dataclasses.replace(
        view,
        projector_direct=view.projector_direct * relative,
        projector_indirect=view.projector_indirect * relative,
        ambient=view.ambient * relative,
        other=view.other * relative,
    )


def relative_reflectance(
    depth_m: Image, body: Labels, scene: Scene, sensor: Sensor, side: Side
) -> Image:
    """Evaluate the texture at each pixel's surface point, averaged over the pixel's box.

    Args:
        depth_m: (h, w) z along the imager's axis [m], NaN without a surface.
        body: (h, w) body numbers, from 1 in the order of the bodies.
        scene: its finish, bodies and pose.
        sensor: its geometry.
        side: which imager.

    Returns:
        (h, w) >= 0, with mean 1 over large surfaces; 1 where there is no texture.
    """
    finish, pinhole = scene.finish, Pinhole.from_camera(sensor)
    relative = np.ones(depth_m.shape, np.float32)
    places = (np.arange(_TABLE) + 0.5) / _TABLE
    cosines = np.cos(2 * np.pi * places).astype(np.float32)
    losses = np.exp(-_MOST_LOSS * places).astype(np.float32)
    world_from_view = scene.world_from_left @ _left_from_view(scene, sensor, side)
    for number, part in enumerate(scene.bodies, start=1):
        if not finish.touches(part.name) or part.material.kind in _UNTEXTURED:
            continue
        _multiply(
            relative,
            depth_m,
            body,
            number,
            np.linalg.inv(part.world_from_body) @ world_from_view,
            np.linalg.inv(pinhole.matrix),
            np.float32((_PIXEL * scene.model_error.scale**-1 / pinhole.fx_px) ** 2),
            waves(part, finish.texture_contrast, finish.texture_slope),
            cosines,
            losses,
        )
    return relative


def waves(body: Body, contrast: float, slope: float) -> NDArray[np.float64]:
    """Draw the waves of a body's texture, which depend on its name.

    Args:
        body: textured body.
        contrast: standard deviation of the relative reflectance.
        slope: exponent s of the fall of power density with frequency, on a plane.

    Returns:
        (n, 5): wave vector in the body's frame [cycles/m], phase [cycles], amplitude.
    """
    count = _OCTAVES * _WAVES
    draws = randomness.generator(0, 0, "scene", f"texture of {body.name}")
    direction = draws.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    place = (np.arange(count) + draws.random(count)) / _WAVES  # [octaves]
    wavelength_m = _LONGEST_M * 2.0**-place
    variance = wavelength_m ** (slope - 2)
    amplitude = contrast * np.sqrt(2 * variance / variance.sum())
    phase = draws.random(count)
    return np.column_stack([direction / wavelength_m[:, None], phase, amplitude])


def _left_from_view(scene: Scene, sensor: Sensor, side: Side) -> Pose:
    """Pose of the imager in the left imager's nominal frame, with the model's error undone."""
    error = scene.model_error
    true_from_model = frames.pose(error.shift_m, error.turn_deg)
    true_from_model[:3, :3] *= error.scale
    baseline_m = 0.0 if side == "left" else sensor.true_baseline_m
    return np.linalg.inv(true_from_model) @ frames.right_of(np.eye(4), baseline_m)


@nb.njit(cache=True, nogil=True, fastmath=True)
def _multiply(
    relative, depth_m, body, number, pose, ray, pixel_variance, waves, cosines, losses
):  # pragma: no cover - compiled
    height, width = depth_m.shape
    table = np.float64(cosines.size)
    squares = (waves[:, 0] ** 2 + waves[:, 1] ** 2 + waves[:, 2] ** 2) * (2 * np.pi**2)
    squares *= losses.size / _MOST_LOSS
    for row in range(height):
        for column in range(width):
            z = np.float64(depth_m[row, column])
            if body[row, column] != number or not z > 0:
                continue
            x = z * (ray[0, 0] * column + ray[0, 1] * row + ray[0, 2])
            y = z * (ray[1, 0] * column + ray[1, 1] * row + ray[1, 2])
            at_x = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
            at_y = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
            at_z = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
            spot = pixel_variance * z * z
            total = 0.0
            for wave in range(waves.shape[0]):
                loss = int(spot * squares[wave])
                if loss >= losses.size:
                    break  # Waves are ordered by wavelength.
                cycles = (
                    waves[wave, 0] * at_x
                    + waves[wave, 1] * at_y
                    + waves[wave, 2] * at_z
                    + waves[wave, 3]
                )
                cycles -= np.floor(cycles)
                entry = min(int(cycles * table), cosines.size - 1)
                total += waves[wave, 4] * losses[loss] * cosines[entry]
            relative[row, column] = max(1.0 + total, 0.0)
