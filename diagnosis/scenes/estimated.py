"""Scene of a captured room: loaded from its `scene.toml`, or estimated from its images.

Without `scene.toml`, reflectance and ambient light are estimated from the images under diagnosis.
In such a scene, light, exposure, vignetting and reflectance are not separable, and fine texture is
unknown. Alternative estimates that the images also permit give the size of this uncertainty. The
likely scene is smooth, because detail absorbs errors of the dots (docs/results/calibration.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from starling.learning.data.captured import SMOOTHING_PX
from starling.patterns.errors import refuse
from starling.sim.captures.capture import CapturedScene
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.scene.captured import captured_scene, known_geometry
from starling.sim.scene.captured.room_light import LIT_ROOM_W_M2, RoomLight
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor

Estimates = tuple[Callable[[], Scene], ...]

# Families of effects that the estimates absorb in part: their remainder is not separable from
# reflectance and light.
ABSORBED_FAMILIES = frozenset(
    {
        "ambient",
        "ambient_gradient",
        "filter",
        "projector_falloff",
        "reflectance",
        "signal_gain",
        "vignetting",
    }
)
_DARKER = 0.5  # Factor on reflectance: brightness alone does not separate it from light.
_VIGNETTING = 0.3  # Share of light lost in the corners: not separable from reflectance either.
_BRIGHTER = 1.2  # Factor on ambient light: accuracy of its estimate from the dots.
_UNIFORM_REFLECTANCE = 0.5  # Assumed where there is no image.


def load_scene(
    captured: CapturedScene, sensor: Sensor, *, even_ambient: bool = False
) -> tuple[Scene, Estimates]:
    """Load or estimate the scene that was captured.

    Args:
        captured: captured scene with a `scene.toml`, or with reference depth.
        sensor: sensor that captured it.
        even_ambient: as in `captured_scene.estimate_light`.

    Returns:
        The scene, and alternative estimates of it; none if it was loaded from a file.

    Raises:
        InputError: if neither geometry nor reference depth is known, or an image is damaged.
    """
    loaded = known_geometry.load(captured, sensor)
    if loaded is not None:
        return loaded, ()
    likely = _uniform_light(captured)
    has_image = captured.fullest().ir_left is not None
    if has_image:
        likely = captured_scene.estimate_light(
            captured,
            sensor,
            smoothing_px=SMOOTHING_PX,
            within_surfaces=True,
            even_ambient=even_ambient,
        )
    info = captured.info
    x, y = np.arange(info.width) - info.cx_px, np.arange(info.height) - info.cy_px
    square = (x[None] ** 2 + y[:, None] ** 2) / Pinhole.from_camera(info).half_diagonal_px ** 2
    shades = (_DARKER, (1 - _VIGNETTING * square).astype(np.float32))
    lights = [replace(likely, reflectance=likely.reflectance * shade) for shade in shades]
    lights.append(replace(likely, ambient_w_m2=likely.ambient_w_m2 * _BRIGHTER))
    estimates = [partial(captured_scene.scene_from_light, captured, light) for light in lights]
    if has_image:
        estimates.append(partial(_detailed, captured, sensor, even_ambient))
    return captured_scene.scene_from_light(captured, likely), tuple(estimates)


def plain_surface(captured: CapturedScene) -> Scene:
    """Build a scene from reference depth alone, with uniform reflectance and light.

    Raises:
        InputError: if there is no reference depth.
    """
    return captured_scene.scene_from_light(captured, _uniform_light(captured))


def reference_depth(captured: CapturedScene) -> NDArray[np.float32]:
    """Return the reference depth (h, w) of a scene [m].

    Raises:
        InputError: if there is none.
    """
    truth_m = captured.truth_m()
    if truth_m is None or not np.isfinite(truth_m).any():
        rule = "must have a scene.toml or reference depth (truth.png)"
        raise refuse(f"scene {captured.name}", rule, "neither", "Leave it out, or add one.")
    return truth_m


def _uniform_light(captured: CapturedScene) -> RoomLight:
    shape = reference_depth(captured).shape
    reflectance = np.full(shape, _UNIFORM_REFLECTANCE, np.float32)
    return RoomLight(reflectance, LIT_ROOM_W_M2)


def _detailed(captured: CapturedScene, sensor: Sensor, even_ambient: bool) -> Scene:
    """Estimate reflectance without smoothing, so that it keeps the texture of the image."""
    light = captured_scene.estimate_light(captured, sensor, even_ambient=even_ambient)
    return captured_scene.scene_from_light(captured, light)
