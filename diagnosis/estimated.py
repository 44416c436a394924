"""What is known of a captured scene, and what its captures bear out as well.

Where no file says what a scene is made of, reflectance is estimated from the very images that are
diagnosed. Light, exposure, a lens's fall-off and reflectance of such a scene cannot be parted, and
its fine texture is not known. Other estimates that the images allow tell how much that matters.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from learning.captured import SMOOTHING_PX
from patterns.errors import refuse
from sim.capture import CapturedScene
from sim.pinhole import Pinhole
from sim.scene import Scene
from sim.scenes import captured as surfaces
from sim.scenes import known
from sim.sensor import Sensor

Estimates = tuple[Callable[[], Scene], ...]

_DARKER = 0.5  # Brightness alone does not tell light from reflectance.
_SHADED = 0.3  # Nor a lens's fall-off, here of this share in the corners.
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
    believed = known.load(captured, sensor)
    if believed is not None:
        return believed, ()
    truth_m = captured.truth_m()
    if truth_m is None or not np.isfinite(truth_m).any():
        rule = "must have a scene.toml or reference depth (truth.png)"
        raise refuse(f"scene {captured.name}", rule, "neither", "Leave it out, or add one.")
    disparity_px = captured.info.disparity_px(truth_m)
    estimate = partial(
        surfaces.reflectance,
        captured,
        vignetting=sensor.left.lens.vignetting,
        surfaces_px=disparity_px,
    )
    detailed: list[NDArray[np.float32]] = []
    if captured.frame(captured.frames[0]).ir_left is None:
        likely = np.full(disparity_px.shape, _EVEN, np.float32)
    else:
        likely = estimate(smoothing_px=SMOOTHING_PX)
        detailed.append(estimate(smoothing_px=0.0))
    info = captured.info
    x, y = np.arange(info.width) - info.cx_px, np.arange(info.height) - info.cy_px
    square = (x[None] ** 2 + y[:, None] ** 2) / Pinhole.of(info).half_diagonal_px ** 2
    shaded = likely * (1 - _SHADED * square).astype(np.float32)
    made = partial(surfaces.of_reflectance, captured, disparity_px)
    others = (_DARKER * likely, shaded, *detailed)
    return made(likely), tuple(partial(made, one) for one in others)
