"""Examples in the pixels that a network was trained on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.data.example import Example, Image, Physics
from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry.pinhole import Pinhole

_DISPARITIES = ("disparity_px", "one_draw_px")
_MEANS = ("ndp", "infrared", "contrast")  # Averaged; all other images keep single pixels.


def at_training_scale(
    example: Example, shape: tuple[int, int], predict: Callable[[Example], Image]
) -> Image:
    """Predict an image of an example with a network that was trained on images of another size.

    Objects then have the size in pixels that the network knows. The width becomes the training
    width; the ratio of the sides stays.

    Args:
        example: the example, of any size.
        shape: (h, w) of the training images.
        predict: returns a map of an example's pixels; it gets the smaller or larger example.

    Returns:
        (h, w) of the example, interpolated linearly; that of `predict` if the sizes are equal.
    """
    if example.info.shape == shape:
        return predict(example)
    predicted = predict(_resampled(example, shape[1]))
    size = (example.info.width, example.info.height)
    return np.asarray(cv2.resize(predicted, size, interpolation=cv2.INTER_LINEAR), np.float32)


def _resampled(example: Example, width: int) -> Example:
    info = _scaled(example.info, width)
    ratio = info.width / example.info.width
    physics = None
    if example.physics is not None:
        images: dict[str, Any] = {
            field.name: getattr(example.physics, field.name)
            for field in dataclasses.fields(Physics)
        }
        for name, image in images.items():
            if name != "draws":
                images[name] = _resized(image, info, averaged=name in _MEANS)
        for name in _DISPARITIES:
            images[name] = images[name] * np.float32(ratio)
        physics = Physics(**images)
    reflectance = example.reflectance
    return Example(
        scene=example.scene,
        room=example.room,
        info=info,
        depth_m=_resized(example.depth_m, info),
        reflectance=None if reflectance is None else _resized(reflectance, info),
        physics=physics,
    )


def _scaled(info: CaptureInfo, width: int) -> CaptureInfo:
    height = max(round(info.height * width / info.width), 1)
    camera = Pinhole.from_camera(info).resized(width, height)
    return dataclasses.replace(info, **dataclasses.asdict(camera))


def _resized(image: NDArray, info: CaptureInfo, *, averaged: bool = False) -> NDArray:
    """Return means over the new pixels, or the values at their centres, which mix no surfaces."""
    if averaged:
        size = (info.width, info.height)
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), image.dtype)
    rows, columns = (
        np.minimum(((np.arange(new) + 0.5) * old / new).astype(int), old - 1)
        for new, old in zip(info.shape, image.shape, strict=True)
    )
    return image[rows[:, None], columns]
