"""Image of the dots after lens, alignment and resampling, with its derivatives.

These steps are linear in light, so they apply to derivatives as to the image. This module adds the
derivatives by the right imager's alignment and by the dots' width.
"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.arrays import Image
from starling.sim.differentiable.light import PARAMETERS, Linearised, TracedView
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager import converter
from starling.sim.imaging.imager.charge import Die
from starling.sim.imaging.optics import alignment, shading, spot
from starling.sim.sensor.imager import Alignment

# Steps of the alignment for central differences; they move the image by some 1e-3 px.
_STEPS = {
    "offset_x_px": 4e-3,
    "offset_y_px": 4e-3,
    "roll_deg": 2e-3,
    "pitch_deg": 1e-3,
    "yaw_deg": 1e-3,
}
ALIGNMENT = tuple(f"right.alignment.{name}" for name in _STEPS)
DOT_VARIANCE = "projector.dot_variance_mrad2"  # Square of `projector.dot_blur_mrad`.
ALL = (*PARAMETERS, *ALIGNMENT, DOT_VARIANCE)


def form(traced: TracedView, names: tuple[str, ...] = ()) -> Linearised:
    """Form an imager's image of the projector's light of 1 W, up to a constant factor.

    Vignetting is included. Speckle, noise, filters and glare are not.

    Args:
        traced: Traced view of one imager.
        names: Parameters in `ALL`. The right imager's alignment has no effect on the left image.

    Returns:
        Image and derivatives in one arbitrary unit. The derivative by the dots' variance assumes
        that dots widen in the image as an isotropic Gaussian.

    Raises:
        InputError: for an unknown name.
    """
    for name in names:
        errors.one_of("parameter", name, ALL)
    right = traced.side == "right"
    linear = traced.linear(tuple(name for name in names if name in PARAMETERS))
    images = (linear.image, *linear.columns.values())
    pinhole, lens = Pinhole.from_camera(traced.sensor), traced.imager.lens
    blurred = spot.blur_by_spot(images, traced.depth_m, lens, pinhole)
    image, *parts = _apply_alignment(traced, blurred, traced.imager.alignment)
    columns = dict(zip(linear.columns, parts, strict=True))
    for name in names:
        if name == DOT_VARIANCE:
            scale = np.float32(0.5 * (1e-3 * traced.sensor.fx_px) ** 2)
            columns[name] = cv2.Laplacian(image, cv2.CV_32F) * scale
        elif name in ALIGNMENT:
            field = name.rpartition(".")[2]
            columns[name] = _slope(traced, blurred[0], field) if right else np.zeros_like(image)
    return Linearised(image=image, columns={name: columns[name] for name in names})


def flow(traced: TracedView, names: tuple[str, ...]) -> dict[str, NDArray[np.float32]]:
    """Motion of the dots in the image per unit of each parameter, (h, w, 2) [px].

    As `TracedView.flow`, with the right imager's alignment. It is 0 for other parameters.

    Args:
        traced: Traced view of one imager.
        names: Parameters in `ALL`.

    Raises:
        InputError: for an unknown name.
    """
    for name in names:
        errors.one_of("parameter", name, ALL)
    flows = traced.flow(tuple(name for name in names if name in PARAMETERS))
    for name in names:
        if name in flows:
            continue
        flows[name] = np.zeros((*traced.depth_m.shape, 2), np.float32)
        if name in ALIGNMENT and traced.side == "right":
            aligned, pinhole = traced.sensor.right.alignment, Pinhole.from_camera(traced.sensor)
            field = name.rpartition(".")[2]
            slope = _map_slope(aligned, pinhole, _die(traced), field)
            flows[name] = -np.stack(slope, axis=-1)
    return flows


def _die(traced: TracedView) -> Die:
    return Die(traced.sensor.unit, traced.side)


def _apply_alignment(
    traced: TracedView, parts: tuple[Image, ...], aligned: Alignment
) -> tuple[Image, ...]:
    """Apply alignment, vignetting and resampling to images."""
    imager, pinhole = traced.imager, Pinhole.from_camera(traced.sensor)
    parts = alignment.misalign(parts, aligned, pinhole, _die(traced))
    if imager.lens.vignetting > 0:
        dimmed = shading.vignetting(imager.lens.vignetting, pinhole)
        parts = tuple(part * dimmed for part in parts)
    return tuple(converter.smooth(part, imager.smoothing_px) for part in parts)


def _slope(traced: TracedView, blurred: Image, field: str) -> Image:
    """Derivative of the image by one alignment parameter, by central difference."""
    step = _STEPS[field]
    aligned = traced.imager.alignment
    ends = [
        _apply_alignment(
            traced,
            (blurred,),
            dataclasses.replace(aligned, **{field: getattr(aligned, field) + change}),
        )[0]
        for change in (step, -step)
    ]
    return (ends[0] - ends[1]) / np.float32(2 * step)


def _map_slope(
    aligned: Alignment, pinhole: Pinhole, die: Die, name: str
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Derivative of the map from image to ideal pixels, x and y (h, w)."""
    step = _STEPS[name]
    ends = [
        _ideal(
            dataclasses.replace(aligned, **{name: getattr(aligned, name) + change}), pinhole, die
        )
        for change in (step, -step)
    ]
    x, y = ((ends[0][i] - ends[1][i]) / (2 * step) for i in range(2))
    return x.astype(np.float32), y.astype(np.float32)


def _ideal(aligned: Alignment, pinhole: Pinhole, die: Die) -> tuple[NDArray, NDArray]:
    """Ideal image positions of a misaligned imager's pixels, x and y (h, w) [px].

    This is the map of `starling.sim.imaging.optics.alignment`, steps 1 to 3, in double precision.
    """
    y, x = np.mgrid[: pinhole.height, : pinhole.width].astype(np.float64)
    x = x - aligned.offset_x_px - alignment.shift(aligned, pinhole, die)
    y = y - aligned.offset_y_px
    across, down = x - pinhole.cx_px, y - pinhole.cy_px
    inwards = aligned.distortion_px / pinhole.half_diagonal_px**3
    shrink = inwards * (across**2 + down**2)
    actual = np.stack([x - shrink * across, y - shrink * down, np.ones_like(x)])
    ideal = np.tensordot(alignment.homography(aligned, pinhole), actual, axes=1)
    return ideal[0] / ideal[2], ideal[1] / ideal[2]
