"""A device with a matcher of its own: depth of infrared pairs on disk."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.camera import matcher
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol import capture_files

UNIT_M = 0.001
_PAIR = ("ir_left.png", "ir_right.png")


def measure(captures: Path, camera: Nominal) -> None:
    """Write `depth.png` beside every infrared pair of a capture set, in millimetres.

    Args:
        captures: The capture set.
        camera: Its nominal settings.

    Raises:
        WithheldError: if a pair cannot be matched.
    """
    for left in sorted(captures.glob("*/*/ir_left.png")):
        ir_left, ir_right = (_image(left.with_name(name)) for name in _PAIR)
        depth_m = matcher.depth(ir_left, ir_right, camera)
        capture_files.write_depth(left.with_name("depth.png"), depth_m, UNIT_M)


def _image(path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None  # `shoot` has just written it.
    return image.astype(np.uint8) if image.dtype == np.uint8 else image.astype(np.uint16)
