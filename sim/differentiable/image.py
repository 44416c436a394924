"""The dots as an imager's pixels hold them, and their derivatives: lens, alignment, resampling.

All of it is linear in light and acts on derivatives as on the image. What moves or widens the
image is differentiated here: the alignment of the right imager, and the width of the dots.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.differentiable.light import PARAMETERS, Linear, Traced
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager import smoothing
from starling.sim.imaging.optics import alignment, shading, spot
from starling.sim.render.layers import Image
from starling.sim.sensor.lens import Alignment

# Steps of the alignment that move the image by some thousandths of a pixel.
_STEPS = {
    "offset_x_px": 4e-3,
    "offset_y_px": 4e-3,
    "roll_deg": 2e-3,
    "pitch_deg": 1e-3,
    "yaw_deg": 1e-3,
}
ALIGNMENT = tuple(f"right.alignment.{name}" for name in _STEPS)
DOT_VARIANCE = "projector.dot_variance_mrad2"  # Of `projector.dot_blur_mrad`, squared.
ALL = (*PARAMETERS, *ALIGNMENT, DOT_VARIANCE)


def formed(traced: Traced, names: tuple[str, ...] = ()) -> Linear:
    """The projector's light of 1 W as an imager's pixels hold it, up to a constant.

    Vignetting is in it; speckle, noise, filters and glare are not.

    Args:
        traced: of one imager.
        names: of `ALL`. The right imager's alignment leaves the left image as it is.

    Returns:
        Image and derivatives, in any one unit. The derivative by the dots' variance takes them to
        widen in the image as a Gaussian does, alike in all directions.

    Raises:
        InputError: an unknown name.
    """
    for name in names:
        errors.one_of("parameter", name, ALL)
    right = traced.side == "right"
    linear = traced.linear(tuple(name for name in names if name in PARAMETERS))
    spread = _spread(traced, (linear.image, *linear.columns.values()))
    image, *parts = _moved(traced, spread, _alignment(traced))
    columns = dict(zip(linear.columns, parts, strict=True))
    for name in names:
        if name == DOT_VARIANCE:
            scale = np.float32(0.5 * (1e-3 * traced.sensor.fx_px) ** 2)
            columns[name] = cv2.Laplacian(image, cv2.CV_32F) * scale
        elif name in ALIGNMENT:
            field = name.rpartition(".")[2]
            columns[name] = _slope(traced, spread[0], field) if right else np.zeros_like(image)
    return Linear(image=image, columns={name: columns[name] for name in names})


def flow(traced: Traced, names: tuple[str, ...]) -> dict[str, NDArray[np.float32]]:
    """How fast dots move over the image, (h, w, 2) [px] a unit of each parameter.

    As `Traced.flow`, with what moves the right image; 0 for what moves nothing.

    Args:
        traced: of one imager.
        names: of `ALL`.

    Raises:
        InputError: an unknown name.
    """
    for name in names:
        errors.one_of("parameter", name, ALL)
    found = traced.flow(tuple(name for name in names if name in PARAMETERS))
    for name in names:
        if name in found:
            continue
        found[name] = np.zeros((*traced.depth_m.shape, 2), np.float32)
        if name in ALIGNMENT and traced.side == "right":
            aligned, pinhole = traced.sensor.right.alignment, Pinhole.of(traced.sensor)
            slid = _slid(aligned, pinhole, name.rpartition(".")[2])
            found[name] = -np.stack(slid, axis=-1)
    return found


def _alignment(traced: Traced) -> Alignment:
    imager = traced.sensor.left if traced.side == "left" else traced.sensor.right
    return imager.alignment


def _spread(traced: Traced, parts: tuple[Image, ...]) -> tuple[Image, ...]:
    """Blur images as the lens does."""
    imager = traced.sensor.left if traced.side == "left" else traced.sensor.right
    return spot.blurred(parts, traced.depth_m, imager.lens, Pinhole.of(traced.sensor))


def _moved(traced: Traced, parts: tuple[Image, ...], aligned: Alignment) -> tuple[Image, ...]:
    """Move, dim and average images as a misaligned imager does."""
    imager = traced.sensor.left if traced.side == "left" else traced.sensor.right
    pinhole = Pinhole.of(traced.sensor)
    parts = alignment.moved(parts, aligned, pinhole)
    if imager.lens.vignetting > 0:
        dimmed = shading.vignetting(imager.lens.vignetting, pinhole)
        parts = tuple(part * dimmed for part in parts)
    return tuple(smoothing.smoothed(part, imager.smoothing_px) for part in parts)


def _slope(traced: Traced, spread: Image, field: str) -> Image:
    """Derivative of the image by one number of the alignment: a difference of the move itself."""
    step = _STEPS[field]
    aligned = _alignment(traced)
    ends = [
        _moved(
            traced,
            (spread,),
            dataclasses.replace(aligned, **{field: getattr(aligned, field) + way}),
        )[0]
        for way in (step, -step)
    ]
    return (ends[0] - ends[1]) / np.float32(2 * step)


def _slid(
    aligned: Alignment, pinhole: Pinhole, name: str
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Derivative (h, w) of where a pixel of the seen image lies in the ideal one, x and y."""
    step = _STEPS[name]
    ends = [
        _ideal(dataclasses.replace(aligned, **{name: getattr(aligned, name) + way}), pinhole)
        for way in (step, -step)
    ]
    x, y = ((ends[0][i] - ends[1][i]) / (2 * step) for i in range(2))
    return x.astype(np.float32), y.astype(np.float32)


def _ideal(aligned: Alignment, pinhole: Pinhole) -> tuple[NDArray, NDArray]:
    """Where the pixels of a misaligned imager lie in the ideal image, x and y (h, w) [px].

    The map of `starling.sim.imaging.optics.alignment`, steps 1 to 3, in double precision.
    """
    y, x = np.mgrid[: pinhole.height, : pinhole.width].astype(np.float64)
    x = x - aligned.offset_x_px - alignment.warp(aligned, (pinhole.height, pinhole.width))
    y = y - aligned.offset_y_px
    across, down = x - pinhole.cx_px, y - pinhole.cy_px
    inwards = aligned.distortion_px / pinhole.half_diagonal_px**3
    shrink = inwards * (across**2 + down**2)
    seen = np.stack([x - shrink * across, y - shrink * down, np.ones_like(x)])
    ideal = np.tensordot(alignment.homography(aligned, pinhole), seen, axes=1)
    return ideal[0] / ideal[2], ideal[1] / ideal[2]
