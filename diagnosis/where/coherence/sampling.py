"""Sampling of images between pixels, and the power that the interpolation loses.

Values are interpolated by Lanczos' kernel of four lobes, as OpenCV has it. A sampled image is a
filtered one: short periods lose amplitude, most of it half-way between pixels. The loss follows
from the kernel and the fractions of the coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.where.coherence.spectra import COLUMN_FREQUENCY, ROW_FREQUENCY, Plane
from starling.sim.arrays import Image, Mask

_LOBES = 4
_STEPS = 32  # OpenCV rounds coordinates to 1/32 px.
_LEAST_TRANSFER = 0.05  # Smaller transfers would only amplify noise.


def sample(image: Image, x: Image, y: Image) -> Image:
    """Interpolate an image (h, w) at columns x and rows y; edges repeat outside."""
    return np.asarray(
        cv2.remap(
            np.asarray(image, np.float32),
            np.asarray(x, np.float32),
            np.asarray(y, np.float32),
            cv2.INTER_LANCZOS4,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        np.float32,
    )


def sample_smooth(image: Image, x: Image, y: Image) -> Image:
    """Interpolate a smooth image (h, w) or (h, w, n) linearly; NaN stays NaN."""
    columns, rows = (np.asarray(each, np.float32) for each in (x, y))
    mode = cv2.BORDER_REPLICATE
    sampled = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=mode)
    return np.asarray(sampled, np.float32)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Transfer:
    """What sampling keeps at each frequency of a window (rows, columns)."""

    amplitude: Plane  # Of a cross spectrum with an image that is not sampled.
    power: Plane  # Of the sampled image's own spectrum.


def transfer(x: Image, y: Image, known: Mask) -> Transfer:
    """Compute what sampling at x and y keeps.

    Args:
        x: (h, w) columns at which an image is sampled [px].
        y: (h, w) rows.
        known: (h, w) pixels that count, at least one.
    """
    rows, columns = _share_by_step(y[known]), _share_by_step(x[known])
    down, across = _responses(ROW_FREQUENCY.ravel()), _responses(COLUMN_FREQUENCY.ravel())
    amplitude = (rows @ down.real)[:, None] * (columns @ across.real)
    power = (rows @ np.abs(down) ** 2)[:, None] * (columns @ np.abs(across) ** 2)
    return Transfer(
        amplitude=np.maximum(amplitude, _LEAST_TRANSFER),
        power=np.maximum(power, _LEAST_TRANSFER**2),
    )


def _share_by_step(coordinates: NDArray) -> NDArray[np.float64]:
    """Return the share of coordinates at each step between two pixels."""
    step = np.rint(_STEPS * (coordinates % 1.0)).astype(np.intp) % _STEPS
    return np.bincount(step, minlength=_STEPS) / step.size


def _responses(frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the response of the kernel (steps, frequencies) relative to a pure shift."""
    fraction = np.arange(_STEPS)[:, None] / _STEPS
    distance = np.arange(1 - _LOBES, _LOBES + 1)[None] - fraction
    weight = np.sinc(distance) * np.sinc(distance / _LOBES)
    weight /= weight.sum(axis=1, keepdims=True)
    phase = 2 * np.pi * distance[:, :, None] * frequency
    return np.sum(weight[:, :, None] * np.exp(1j * phase), axis=1)
