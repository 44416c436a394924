"""All features of a reading, by the arm of the stage swap that they belong to."""

from __future__ import annotations

import numpy as np

from starling.diagnosis.features import (
    disparity,
    levels,
    rematched,
    repeats,
    residual,
    shifts,
    surface,
    texture,
)
from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.scenes.strata import Ground, Image

Features = dict[str, float]


def of_image(reading: Reading, ground: Ground, *, ceiling: float) -> Features:
    """What infrared images, and our matcher on them, tell; medians over repeats are not taken: the
    first repeat stands for all but what changes in time.

    Args:
        reading: with infrared images.
        ground: of the scene.
        ceiling: largest code.
    """
    assert reading.left is not None and reading.right is not None and reading.ours_px is not None
    left, right = (image[0].astype(np.float32) for image in (reading.left, reading.right))
    beside = shifts.warped(right, ground.disparity_px)
    found = levels.levels(np.rint(left), ground, ceiling)
    found |= levels.codes(left, ground.counted, ceiling)
    found |= _named("right", levels.levels(beside, ground, ceiling))
    found |= _named("right", levels.codes(right, np.ones(right.shape, bool), ceiling))
    found |= texture.texture(left, ground)
    found |= _named("right", texture.texture(beside, ground, ("radius",)))
    found |= residual.residual(left, ground)
    found |= shifts.pair(left, right, ground)
    found |= shifts.dots(left, ground)
    found |= disparity.disparity(reading.ours_px[0], ground)
    if len(reading.left) > 1:
        found |= repeats.infrared(reading.left, ground)
    return found


def of_depth(reading: Reading, ground: Ground, *, captured_px: Image | None) -> Features:
    """What a device's depth tells, where images are there also beside our matcher's on the same.

    Args:
        reading: with depth of a device's own.
        ground: of the scene.
        captured_px: (h, w) what the device gave of these images; None where there are none.
    """
    assert reading.device_px is not None
    device = reading.device_px[0]
    found = disparity.disparity(device, ground) | surface.surface(device, ground)
    if captured_px is not None:
        assert reading.ours_px is not None
        found |= rematched.against(device, reading.ours_px[0], ground)
        found |= rematched.unlike(device, captured_px, ground)
    if len(reading.device_px) > 1:
        found |= repeats.depth(reading.device_px, ground)
    return found


def _named(prefix: str, features: Features) -> Features:
    return {f"{prefix} {name}": value for name, value in features.items()}
