"""Where dots lie: the right image against the left by the true disparity, the left against the
simulator's."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import cv2
import numpy as np

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.strata import Ground, Image

STEP_PX = 0.7  # Shift to both sides of the expected place.
_WINDOW_PX = 15
_MOST = 0.95  # Of a correlation, whose measure would else be without end where images are alike.
_SURE = 0.3  # Correlation below which its place is chance.
_BINS = ("depth", "x", "y")
_STEPS = {"": (0, 0), "+x": (1, 0), "-x": (-1, 0), "+y": (0, 1), "-y": (0, -1)}
_SCENES = 16  # Whose expected images are kept.


def pair(left: Image, right: Image, ground: Ground) -> dict[str, float]:
    """Correlate the right image, warped by the true disparity, with the left."""
    return _shifts("pair", left, _moved(right, ground.disparity_px), ground)


def dots(left: Image, ground: Ground) -> dict[str, float]:
    """Correlate the left image with the one that the simulator expects."""
    return _shifts("dots", left, _expected(ground), ground)


def warped(image: Image, disparity_px: Image, dx: float = 0.0, dy: float = 0.0) -> Image:
    """See an image (h, w) from the left view; `dx`, `dy` to the right and below [px]."""
    y, x = np.indices(image.shape, np.float32)
    return np.asarray(
        cv2.remap(
            np.asarray(image, np.float32),
            np.asarray(x - np.nan_to_num(disparity_px) + dx, np.float32),
            np.asarray(y + dy, np.float32),
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        np.float32,
    )


def _moved(image: Image, disparity_px: Image) -> dict[str, Image]:
    """An image seen from the left view, and a step to each side of that."""
    return {
        name: _standard(warped(image, disparity_px, dx * STEP_PX, dy * STEP_PX))
        for name, (dx, dy) in _STEPS.items()
    }


@lru_cache(maxsize=_SCENES)
def _expected(ground: Ground) -> dict[str, Image]:
    """The same of the expected image, with which all readings of a scene are compared."""
    return _moved(ground.expected, np.zeros_like(ground.disparity_px))


def _shifts(kind: str, one: Image, moved: Mapping[str, Image], ground: Ground) -> dict[str, float]:
    """Peak of the correlation and its place in x and y, by bins."""
    flat = _standard(one)
    products = {name: flat * image for name, image in moved.items()}
    powers = flat**2, moved[""] ** 2
    found = {}
    for name, where in (*ground.whole(far=True), *ground.each(*_BINS, far=True)):
        at = {step: bins.mean(product, where) for step, product in products.items()}
        power = float(np.prod([bins.mean(square, where) for square in powers]))
        likeness = at[""] / np.sqrt(max(power, 1e-6))
        found[f"{kind}.match.{name}"] = float(np.arctanh(_MOST * np.clip(likeness, -1, 1)))
        sure = likeness > _SURE
        for axis in ("x", "y"):
            bend = at[f"+{axis}"] + at[f"-{axis}"] - 2 * at[""]
            lean = 0.5 * (at[f"+{axis}"] - at[f"-{axis}"])
            if not sure or bend > -1e-3:
                continue
            found[f"{kind}.shift {axis}.{name}"] = float(np.clip(-STEP_PX * lean / bend, -3, 3))
            found[f"{kind}.width {axis}.{name}"] = bins.log(-bend / at[""])
    return found


def _standard(image: Image) -> Image:
    """Take off the local mean and divide by the local deviation."""
    fine = np.asarray(image, np.float32)
    mean = bins.smooth(fine, _WINDOW_PX)
    variance = bins.smooth(fine**2, _WINDOW_PX) - mean**2
    return np.asarray((fine - mean) / np.sqrt(np.maximum(variance, 1e-3)), np.float32)
