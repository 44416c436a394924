"""What is known of a captured scene, and what its captures bear out as well.

Where no file says what a scene is made of, reflectance and ambient light are estimated from the
very images that are diagnosed. Light, exposure, a lens's fall-off and reflectance of such a scene
cannot be parted, and its fine texture is not known. Other estimates that the images allow tell how
much that matters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from starling.learning.data.captured import SMOOTHING_PX
from starling.patterns.errors import refuse
from starling.sim.captures.capture import CapturedScene
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.scene.captured import captured_scene, known_geometry
from starling.sim.scene.captured.room_light import LIT_ROOM_W_M2, Lit
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor

Estimates = tuple[Callable[[], Scene], ...]

# Families of effects that the estimates take up in part: what is left of them is not separable
# from reflectance and light.
TAKEN_UP = frozenset(
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
_DARKER = 0.5  # Brightness alone does not tell light from reflectance.
_SHADED = 0.3  # Nor a lens's fall-off, here of this share in the corners.
_BRIGHTER = 1.2  # Dots tell of ambient light to about so much.
_EVEN = 0.5  # Reflectance where there is no image.


def scene(captured: CapturedScene, sensor: Sensor) -> tuple[Scene, Estimates]:
    """Load what is known of a captured scene.

    Args:
        captured: with a `scene.toml`, or with reference depth.
        sensor: that the captures are of.

    Returns:
        The scene, and what else it may be; nothing where a file tells it.

    Raises:
        InputError: if neither geometry nor reference depth is known, or an image is damaged.
    """
    believed = known_geometry.load(captured, sensor)
    if believed is not None:
        return believed, ()
    likely = _evenly(captured)
    seen = captured.fullest().ir_left is not None
    if seen:
        likely = captured_scene.lit(
            captured, sensor, smoothing_px=SMOOTHING_PX, within_surfaces=True
        )
    info = captured.info
    x, y = np.arange(info.width) - info.cx_px, np.arange(info.height) - info.cy_px
    square = (x[None] ** 2 + y[:, None] ** 2) / Pinhole.of(info).half_diagonal_px ** 2
    shades = (_DARKER, (1 - _SHADED * square).astype(np.float32))
    others = [replace(likely, reflectance=likely.reflectance * shade) for shade in shades]
    others.append(replace(likely, ambient_w_m2=likely.ambient_w_m2 * _BRIGHTER))
    made = [partial(captured_scene.surface, captured, one) for one in others]
    if seen:
        made.append(partial(_detailed, captured, sensor))
    return captured_scene.surface(captured, likely), tuple(made)


def surface(captured: CapturedScene) -> Scene:
    """What is known of a captured scene by its reference depth alone, evenly painted and lit.

    Raises:
        InputError: if there is no reference depth.
    """
    return captured_scene.surface(captured, _evenly(captured))


def _evenly(captured: CapturedScene) -> Lit:
    truth_m = captured.truth_m()
    if truth_m is None or not np.isfinite(truth_m).any():
        rule = "must have a scene.toml or reference depth (truth.png)"
        raise refuse(f"scene {captured.name}", rule, "neither", "Leave it out, or add one.")
    return Lit(np.full(truth_m.shape, _EVEN, np.float32), LIT_ROOM_W_M2)


def _detailed(captured: CapturedScene, sensor: Sensor) -> Scene:
    return captured_scene.surface(captured, captured_scene.lit(captured, sensor))
