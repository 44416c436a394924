"""Mitsuba's own plugins for a scene: projector emitter, perspective sensor, integrator."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from starling.patterns import errors
from starling.sim.arrays import Image
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.render import backend, emission
from starling.sim.render.bsdf import grey_bitmap
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.sensor.sensor import Sensor

_SQUARE = 2e-3  # Tolerance of the pixels' aspect ratio.


def lit(mi_scene: MitsubaScene, sensor: Sensor, irradiance: Image, number: int = 0) -> Any:
    """Build a Mitsuba scene lit by one of the projector's emitters.

    Mitsuba's `projector` gives radiance rho for irradiance 1 instead of rho / pi. The irradiance is
    therefore divided by pi.

    Args:
        mi_scene: Scene with its shapes.
        sensor: Sensor with its projector.
        irradiance: (h, w) on the plane at unit distance over the field [W m^-2].
        number: Number of the emitter.
    """
    mi = backend.mitsuba()
    part = sensor.projector
    source = emission.emitters(part)[number]
    place = frames.pose(part.position_m, part.rotation_deg)
    place = place @ frames.pose(source.offset_m, source.rotation_deg)
    half_x, half_y = emission.half_tangents(part)
    columns = irradiance.shape[1]
    # The texture's shape sets the plugin's vertical field, so its pixels must be square.
    square = cv2.resize(
        irradiance, (columns, round(columns * half_y / half_x)), interpolation=cv2.INTER_AREA
    )
    emitter = {
        "type": "projector",
        "irradiance": grey_bitmap(np.asarray(square, np.float32) / np.float32(np.pi)),
        "fov": part.fov_x_deg,
        "fov_axis": "x",
        "to_world": _transform(mi_scene.scene.world_from_left @ place),
    }
    shapes = {f"body_{i:04d}": shape for i, shape in enumerate(mi_scene.shapes)}
    return mi.load_dict({"type": "scene", "projector": emitter, **shapes})


def camera(
    sensor: Sensor, world_from_camera: Pose, *, sampler: dict[str, Any], shrink: int = 1
) -> Any:
    """Build a Mitsuba sensor with a box filter for one imager.

    Args:
        sensor: Sensor with the intrinsics.
        world_from_camera: OpenCV pose.
        sampler: `fixed(n)` for n x n fixed positions per pixel, or another sampler of Mitsuba.
        shrink: Reduction of the image's size, with the same field.

    Raises:
        InputError: if the sensor's pixels are not square.
    """
    mi = backend.mitsuba()
    errors.in_interval(
        "fy_px / fx_px",
        sensor.fy_px / sensor.fx_px,
        1 - _SQUARE,
        1 + _SQUARE,
        "Indirect light and the scalar variant need square pixels: set samples to 0, or fy_px.",
    )
    offset_x, offset_y = frames.principal_point_offset(
        sensor.cx_px, sensor.cy_px, sensor.width, sensor.height
    )
    return mi.load_dict(
        {
            "type": "perspective",
            "fov": float(np.rad2deg(2 * np.arctan(sensor.width / (2 * sensor.fx_px)))),
            "fov_axis": "x",
            "principal_point_offset_x": offset_x,
            "principal_point_offset_y": offset_y,
            "near_clip": 1e-3,
            "far_clip": 1e4,
            "to_world": _transform(world_from_camera),
            "film": {
                "type": "hdrfilm",
                "width": sensor.width // shrink,
                "height": sensor.height // shrink,
                "rfilter": {"type": "box"},
                "pixel_format": "luminance",
                "component_format": "float32",
            },
            "sampler": sampler,
        }
    )


def fixed(subpixels: int) -> dict[str, Any]:
    """Sampler of n x n fixed positions per pixel, equal for all pixels and seeds."""
    return {"type": "stratified", "sample_count": subpixels**2, "jitter": False}


def direct() -> Any:
    """Integrator of direct light: one primary and one shadow ray per position."""
    return backend.mitsuba().load_dict(
        {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0, "hide_emitters": True}
    )


def _transform(world_from_part: Pose) -> Any:
    mi = backend.mitsuba()
    return mi.ScalarTransform4f(frames.mitsuba_to_world(world_from_part))
