"""The pictures of a calibration's report, as PNG bytes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.correlation import high_passed
from starling.calibration.heldout import Scored, Side
from starling.calibration.pattern.unprojected import PatternImage
from starling.sim.captures import png

Array = NDArray[np.floating[Any]]
Image = TypeVar("Image", Array, NDArray[np.uint8], NDArray[np.bool_])

ZOOM = 3
RESIDUAL_LIMIT = 2.0  # Of the local deviation: what is drawn white or black.
_PANEL_PX = 640  # Widest picture.
UNKNOWN = (190, 170, 205)  # Red, green, blue where no view looked: in neither scale of colours.


@dataclass(frozen=True, kw_only=True, slots=True)
class Crop:
    """A part of an image, in pixels."""

    left: int
    top: int
    width: int
    height: int

    def of(self, image: Image) -> Image:
        """Cut it out of an image (h, w)."""
        return image[self.top : self.top + self.height, self.left : self.left + self.width]


@dataclass(frozen=True, kw_only=True, slots=True)
class Residual:
    """What a simulation leaves of a real image, both high-passed."""

    whole: bytes
    zoomed: bytes
    unexplained: float  # Its share of the real image's variance.


@dataclass(frozen=True, kw_only=True, slots=True)
class ImagerPictures:
    """One imager of a held-out scene."""

    shape: tuple[int, int]  # (h, w) of the images.
    crop: Crop
    crop_ncc: float  # Correlation in the crop.
    real: bytes
    simulated: bytes
    real_zoomed: bytes
    simulated_zoomed: bytes
    real_dn: tuple[float, float]  # Levels drawn black and white.
    simulated_dn: tuple[float, float]
    residual: Residual
    before: Residual | None  # By the sensor that the fit began from.


@dataclass(frozen=True, kw_only=True, slots=True)
class PatternPictures:
    """A recovered pattern over its directions."""

    value: bytes
    zoomed: bytes  # About the axis.
    coverage: bytes
    sd: bytes
    scale: bytes  # Colours from the low limit to the high one.
    most_views: float  # High limit of `coverage`; 0 is the low one.
    sd_limits: tuple[float, float]


def of_imager(scored: Scored, before: Scored | None, side: Side) -> ImagerPictures:
    """Draw one imager's real and simulated image, and what is left.

    Real and simulated image each have their own grey scale, as the score ignores gain and offset.
    The crop is the one whose correlation is the median of all: neither the best nor the worst.

    Args:
        scored: held-out scene with that imager.
        before: the same scene by the sensor that the fit began from.
        side: which imager.
    """
    real, simulated = scored.real[side], scored.simulated[side]
    crop, crop_ncc = _typical(high_passed(real), high_passed(simulated))
    real_dn, simulated_dn = _limits(real), _limits(simulated)
    seen, laid = _brightened(real, real_dn), _brightened(simulated, simulated_dn)
    began = before.simulated.get(side) if before else None
    return ImagerPictures(
        shape=(real.shape[0], real.shape[1]),
        crop=crop,
        crop_ncc=crop_ncc,
        real=_whole(seen),
        simulated=_whole(laid),
        real_zoomed=_zoomed(seen, crop),
        simulated_zoomed=_zoomed(laid, crop),
        real_dn=real_dn,
        simulated_dn=simulated_dn,
        residual=_residual(real, simulated, crop),
        before=None if began is None else _residual(real, began, crop),
    )


def of_pattern(image: PatternImage) -> PatternPictures:
    """Draw a pattern, how many views looked in each direction, and how well it is known there."""
    known = np.isfinite(image.sd) & (image.views > 0)
    value = np.where(known, image.value, 0)
    low, high = np.percentile(image.value[known], (1, 99.5)) if known.any() else (0.0, 1.0)
    deviations = image.sd[known]
    limits = np.percentile(deviations, (2, 98)) if deviations.size else np.array([0.0, 1.0])
    most = float(image.views.max(initial=0))
    grey = _codes((value - low) / max(high - low, 1e-12))
    lit = np.repeat(grey[..., None], 3, axis=2)
    height, width = grey.shape
    crop = _about((height, width), (width // 2, height // 2))
    sd = _share(np.where(known, image.sd, 0), *map(float, limits))
    return PatternPictures(
        value=_in_colour(lit, known),
        zoomed=_in_colour(_enlarged(crop.of(lit)), _enlarged(crop.of(known))),
        coverage=_in_colour(_coloured(_share(image.views, 0.0, most)), known),
        sd=_in_colour(_coloured(sd), known),
        scale=png.encode_colour(_coloured(np.linspace(0, 1, 256)[None].repeat(8, axis=0))),
        most_views=most,
        sd_limits=(float(limits[0]), float(limits[1])),
    )


def _residual(real: Array, simulated: Array, crop: Crop) -> Residual:
    """Real less simulated, high-passed, the simulated by the factor that leaves least."""
    seen = high_passed(real).astype(np.float64)
    laid = high_passed(simulated).astype(np.float64)
    factor = (seen * laid).sum() / max(float((laid * laid).sum()), 1e-12)
    left = seen - factor * laid
    grey = _codes(left / (2 * RESIDUAL_LIMIT) + 0.5)
    share = float((left * left).mean() / max(float((seen * seen).mean()), 1e-12))
    return Residual(whole=_whole(grey), zoomed=_zoomed(grey, crop), unexplained=share)


def _typical(seen: Array, laid: Array) -> tuple[Crop, float]:
    """Of crops side by side, the one whose correlation is their median, and that."""
    height, width = seen.shape
    size = _about((height, width), (width // 2, height // 2))
    crops = [
        Crop(left=left, top=top, width=size.width, height=size.height)
        for top in range(0, height - size.height + 1, size.height)
        for left in range(0, width - size.width + 1, size.width)
    ]
    found = sorted(
        ((_correlation(crop.of(seen), crop.of(laid)), i) for i, crop in enumerate(crops)),
    )
    ncc, number = found[len(found) // 2]
    return crops[number], ncc


def _correlation(first: Array, second: Array) -> float:
    one, other = first - first.mean(), second - second.mean()
    norm = float(np.linalg.norm(one)) * float(np.linalg.norm(other))
    return float((one * other).sum()) / norm if norm > 0 else 0.0


def _about(shape: tuple[int, int], middle: tuple[int, int]) -> Crop:
    """The crop about a pixel (x, y) that fills a picture when it is zoomed."""
    height, width = shape
    across = min(_PANEL_PX // ZOOM, width)
    down = min(max(round(across * height / width), 1), height)
    left = min(max(middle[0] - across // 2, 0), width - across)
    top = min(max(middle[1] - down // 2, 0), height - down)
    return Crop(left=left, top=top, width=across, height=down)


def _limits(image: Array) -> tuple[float, float]:
    """Levels [DN] drawn black and white: dots show, highlights may burn."""
    low, high = np.percentile(image, (0.5, 99.7))
    return float(low), float(high)


def _brightened(image: Array, limits: tuple[float, float]) -> NDArray[np.uint8]:
    """Grey codes, brightened by a square root so that dark surfaces show."""
    return _codes(np.sqrt(_share(image, *limits)))


def _share(image: Array, low: float, high: float) -> Array:
    return np.clip((image - low) / max(high - low, 1e-12), 0, 1)


def _codes(share: Array) -> NDArray[np.uint8]:
    return np.rint(255 * np.clip(share, 0, 1)).astype(np.uint8)


def fitting(image: NDArray[np.uint8], interpolation: int) -> NDArray[np.uint8]:
    """Reduce an image (h, w) or (h, w, 3) that is wider than a picture."""
    height, width = image.shape[:2]
    if width <= _PANEL_PX:
        return image
    size = (_PANEL_PX, max(round(height * _PANEL_PX / width), 1))
    return cv2.resize(image, size, interpolation=interpolation).astype(np.uint8)


def _whole(grey: NDArray[np.uint8]) -> bytes:
    return png.encode(fitting(grey, cv2.INTER_AREA))


def _zoomed(grey: NDArray[np.uint8], crop: Crop) -> bytes:
    return png.encode(_enlarged(crop.of(grey)))


def _enlarged(image: Image) -> Image:
    return image.repeat(ZOOM, axis=0).repeat(ZOOM, axis=1)


def _coloured(share: Array) -> NDArray[np.uint8]:
    """Viridis, perceptually uniform: red, green, blue (h, w, 3)."""
    return cv2.applyColorMap(_codes(share), cv2.COLORMAP_VIRIDIS)[..., ::-1].astype(np.uint8)


def _in_colour(image: NDArray[np.uint8], known: NDArray[np.bool_]) -> bytes:
    shown = fitting(np.ascontiguousarray(image), cv2.INTER_AREA)
    seen = fitting(known.astype(np.uint8), cv2.INTER_NEAREST) > 0
    return png.encode_colour(np.where(seen[..., None], shown, np.array(UNKNOWN, np.uint8)))
