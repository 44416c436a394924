"""Scene and sensor to layers: one traced pass a view, no Monte-Carlo noise in direct light.

Every pixel is sampled at n x n fixed sub-pixel positions (box filter). At each the surface is
found by one ray from the imager and the projector's light by one ray *from the projector*, so
that a surface with noise does not shadow itself. Where no compiler is, `sim.render_scalar` makes
the same layers with Mitsuba's own integrators.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim import backend
from sim.camera import Camera, cameras, opaque, pixels
from sim.layers import Image, Layers, Truth, View
from sim.projection import Light, clear, projected
from sim.sensor import Sensor
from sim.stage import Stage


def layers(stage: Stage, sensor: Sensor, *, subpixels: int = 2) -> Layers:
    """Render what both imagers of a sensor receive, and the truth.

    Args:
        stage: the scene in Mitsuba; its `world_from_left` poses the sensor.
        sensor: geometry and projector; the layers are for 1 W.
        subpixels: n of the n x n fixed positions in a pixel.

    Returns:
        Layers with zero indirect light (see `sim.indirect`).
    """
    if not backend.is_jit():
        from sim import render_scalar

        return render_scalar.layers(stage, sensor, subpixels=subpixels)
    left, right = cameras(sensor, stage.scene.world_from_left)
    light = Light.of(sensor, stage.scene.world_from_left)
    return Layers(
        left=_view(stage, left, light, subpixels),
        right=_view(stage, right, light, subpixels),
        truth=_truth(stage, left, right, light),
    )


def _ambient(stage: Stage, si: Any) -> Any:
    """Radiance that surface points return of ambient light of 1 W m^-2 [W m^-2 sr^-1]."""
    mi, dr = backend.mitsuba(), backend.drjit()
    ambient = stage.scene.ambient
    # A metal's diffuse equivalent exceeds 1 in Mitsuba: no surface returns more than it gets.
    albedo = dr.minimum(si.bsdf().eval_diffuse_reflectance(si, si.is_valid())[0], 1)
    normal = _towards_viewer(si)
    tilt = dr.dot(normal, mi.Vector3f(*ambient.up)) * (2 / 3 * ambient.gradient)
    return dr.select(si.is_valid(), albedo / np.pi * (1 + tilt), 0)


def _towards_viewer(si: Any) -> Any:
    dr = backend.drjit()
    normal = si.sh_frame.n
    return dr.select(dr.dot(normal, si.to_world(si.wi)) < 0, -normal, normal)


def _view(stage: Stage, camera: Camera, light: Light, subpixels: int) -> View:
    """Average n x n fixed positions a pixel; one kernel, launched n^2 times.

    Depth and body are those of the pixel's centre.
    """
    mi, dr = backend.mitsuba(), backend.drjit()
    count = camera.size[0] * camera.size[1]
    direct, ambient = dr.zeros(mi.Float, count), dr.zeros(mi.Float, count)
    for row, column in np.ndindex(subpixels, subpixels):
        shift = opaque("Vector2f", [(i + 0.5) / subpixels - 0.5 for i in (column, row)])
        si = stage.mitsuba.ray_intersect(camera.ray(pixels(camera.size) + shift))
        direct += projected(stage, light, si)
        ambient += _ambient(stage, si)
        dr.eval(direct, ambient)
    shape, share = camera.size[::-1], np.float32(1 / subpixels**2)
    depth, body = _centres(stage, camera)
    return View(
        projector_direct=direct.numpy().reshape(shape) * share,
        projector_indirect=np.zeros(shape, np.float32),
        ambient=ambient.numpy().reshape(shape) * share,
        other=np.zeros(shape, np.float32),
        depth_m=depth,
        body=body,
    )


def _centres(stage: Stage, camera: Camera) -> tuple[Image, NDArray[np.uint32]]:
    """Depth [m] and body number of what the pixel centres see, each (h, w)."""
    mi, dr = backend.mitsuba(), backend.drjit()
    si = stage.mitsuba.ray_intersect(camera.ray(pixels(camera.size)))
    columns = (
        camera.place.local(si.p).z,
        dr.reinterpret_array(mi.UInt32, si.shape),
        si.is_valid(),
    )
    dr.eval(*columns)
    depth, body, seen = (column.numpy().reshape(camera.size[::-1]) for column in columns)
    return (
        np.where(seen, depth, np.float32(np.nan)).astype(np.float32),
        np.where(seen, stage.numbers[np.minimum(body, len(stage.numbers) - 1)], 0),
    )


def _truth(stage: Stage, left: Camera, right: Camera, light: Light) -> Truth:
    mi, dr = backend.mitsuba(), backend.drjit()
    si = stage.mitsuba.ray_intersect(left.ray(pixels(left.size)))
    hit, tolerance = si.is_valid(), stage.scene.shadow_tolerance
    normal = _towards_viewer(si)
    place = left.place
    columns = (
        left.place.local(si.p).z,
        *(dr.dot(axis, normal) for axis in (place.x, place.y, place.z)),
        dr.reinterpret_array(mi.UInt32, si.shape),
        clear(stage.mitsuba, right.place.origin, si.p, hit & right.sees(si.p), tolerance),
        light.reaches(stage.mitsuba, si.p, hit, tolerance),
        hit,
    )
    dr.eval(*columns)
    shape = left.size[::-1]
    depth, nx, ny, nz, body, right_sees, lit, seen = (c.numpy().reshape(shape) for c in columns)
    missing = np.float32(np.nan)
    return Truth(
        depth_m=np.where(seen, depth, missing).astype(np.float32),
        normal=np.where(seen[..., None], np.stack([nx, ny, nz], axis=-1), missing),
        material=np.where(seen, stage.numbers[np.minimum(body, len(stage.numbers) - 1)], 0),
        right_sees=right_sees,
        lit=lit,
    )
