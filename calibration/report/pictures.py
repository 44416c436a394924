"""Pictures of a calibration's report, as PNG bytes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration.correlation import high_passed
from starling.calibration.heldout import SceneScore
from starling.calibration.observation import Side
from starling.calibration.pattern.unprojected import PatternImage
from starling.sim.captures import png
from starling.sim.report.pictures import (
    PANEL_PX,
    ZOOM,
    enlarged,
    fitting,
    grey_codes,
    grey_limits,
)

Array = NDArray[np.floating[Any]]
Image = TypeVar("Image", Array, NDArray[np.uint8], NDArray[np.bool_])

RESIDUAL_LIMIT = 2.0  # Residual drawn as white or black [local standard deviations].
UNKNOWN = (190, 170, 205)  # RGB of directions that no view covers; outside both colour scales.


@dataclass(frozen=True, kw_only=True, slots=True)
class Crop:
    """A rectangle of an image, in pixels."""

    left: int
    top: int
    width: int
    height: int

    def cut(self, image: Image) -> Image:
        """Return the rectangle's pixels of an image (h, w)."""
        return image[self.top : self.top + self.height, self.left : self.left + self.width]


@dataclass(frozen=True, kw_only=True, slots=True)
class Residual:
    """Difference of a real and a simulated image, both high-passed."""

    whole: bytes
    zoomed: bytes
    unexplained: float  # Residual variance over the real image's variance.


@dataclass(frozen=True, kw_only=True, slots=True)
class ImagerPictures:
    """One imager of a held-out scene."""

    shape: tuple[int, int]  # (h, w) of the images.
    crop: Crop
    crop_ncc: float  # Correlation within the crop.
    real: bytes
    simulated: bytes
    real_zoomed: bytes
    simulated_zoomed: bytes
    real_dn: tuple[float, float]  # Levels drawn as black and white.
    simulated_dn: tuple[float, float]
    residual: Residual
    before: Residual | None  # Residual of the initial sensor.


@dataclass(frozen=True, kw_only=True, slots=True)
class PatternPictures:
    """A recovered pattern over its directions."""

    value: bytes
    zoomed: bytes  # Around the optical axis.
    coverage: bytes
    sd: bytes
    scale: bytes  # Colour bar, low to high.
    most_views: float  # Upper limit of `coverage`; the lower limit is 0.
    sd_limits: tuple[float, float]


def draw_imager(scored: SceneScore, before: SceneScore | None, side: Side) -> ImagerPictures:
    """Draw one imager's real and simulated image, and their residual.

    The two images have separate grey scales, because the score ignores gain and offset.
    The crop shown is the one with the median correlation.

    Args:
        scored: held-out scene with that imager.
        before: the same scene, simulated with the initial sensor.
        side: imager to draw.
    """
    real, simulated = scored.real[side], scored.simulated[side]
    crop, crop_ncc = _typical(high_passed(real), high_passed(simulated))
    real_dn, simulated_dn = grey_limits(real), grey_limits(simulated)
    real_grey, simulated_grey = grey_codes(real, real_dn), grey_codes(simulated, simulated_dn)
    initial = before.simulated.get(side) if before else None
    return ImagerPictures(
        shape=(real.shape[0], real.shape[1]),
        crop=crop,
        crop_ncc=crop_ncc,
        real=_whole(real_grey),
        simulated=_whole(simulated_grey),
        real_zoomed=_zoomed(real_grey, crop),
        simulated_zoomed=_zoomed(simulated_grey, crop),
        real_dn=real_dn,
        simulated_dn=simulated_dn,
        residual=_residual(real, simulated, crop),
        before=None if initial is None else _residual(real, initial, crop),
    )


def draw_pattern(image: PatternImage) -> PatternPictures:
    """Draw a pattern, the number of views by direction, and its standard deviation."""
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
        zoomed=_in_colour(enlarged(crop.cut(lit)), enlarged(crop.cut(known))),
        coverage=_in_colour(_coloured(_share(image.views, 0.0, most)), known),
        sd=_in_colour(_coloured(sd), known),
        scale=png.encode_colour(_coloured(np.linspace(0, 1, 256)[None].repeat(8, axis=0))),
        most_views=most,
        sd_limits=(float(limits[0]), float(limits[1])),
    )


def _residual(real: Array, simulated: Array, crop: Crop) -> Residual:
    """Return real minus simulated image, high-passed, with the least-squares factor applied."""
    real_high = high_passed(real).astype(np.float64)
    simulated_high = high_passed(simulated).astype(np.float64)
    factor = (real_high * simulated_high).sum() / max(
        float((simulated_high * simulated_high).sum()), 1e-12
    )
    remaining = real_high - factor * simulated_high
    grey = _codes(remaining / (2 * RESIDUAL_LIMIT) + 0.5)
    unexplained = float(
        (remaining * remaining).mean() / max(float((real_high * real_high).mean()), 1e-12)
    )
    return Residual(whole=_whole(grey), zoomed=_zoomed(grey, crop), unexplained=unexplained)


def _typical(real: Array, simulated: Array) -> tuple[Crop, float]:
    """Return the crop with the median correlation over a grid of crops, and that correlation."""
    height, width = real.shape
    size = _about((height, width), (width // 2, height // 2))
    crops = [
        Crop(left=left, top=top, width=size.width, height=size.height)
        for top in range(0, height - size.height + 1, size.height)
        for left in range(0, width - size.width + 1, size.width)
    ]
    ranked = sorted(
        ((_correlation(crop.cut(real), crop.cut(simulated)), i) for i, crop in enumerate(crops)),
    )
    ncc, number = ranked[len(ranked) // 2]
    return crops[number], ncc


def _correlation(first: Array, second: Array) -> float:
    first_centred, second_centred = first - first.mean(), second - second.mean()
    norm = float(np.linalg.norm(first_centred)) * float(np.linalg.norm(second_centred))
    return float((first_centred * second_centred).sum()) / norm if norm > 0 else 0.0


def _about(shape: tuple[int, int], middle: tuple[int, int]) -> Crop:
    """Return the crop around a pixel (x, y) that fills a picture when zoomed."""
    height, width = shape
    crop_width = min(PANEL_PX // ZOOM, width)
    crop_height = min(max(round(crop_width * height / width), 1), height)
    left = min(max(middle[0] - crop_width // 2, 0), width - crop_width)
    top = min(max(middle[1] - crop_height // 2, 0), height - crop_height)
    return Crop(left=left, top=top, width=crop_width, height=crop_height)


def _share(image: Array, low: float, high: float) -> Array:
    return np.clip((image - low) / max(high - low, 1e-12), 0, 1)


def _codes(share: Array) -> NDArray[np.uint8]:
    return np.rint(255 * np.clip(share, 0, 1)).astype(np.uint8)


def _whole(grey: NDArray[np.uint8]) -> bytes:
    return png.encode(fitting(grey, cv2.INTER_AREA))


def _zoomed(grey: NDArray[np.uint8], crop: Crop) -> bytes:
    return png.encode(enlarged(crop.cut(grey)))


def _coloured(share: Array) -> NDArray[np.uint8]:
    """Map shares to the perceptually uniform colours of Viridis, RGB (h, w, 3)."""
    return cv2.applyColorMap(_codes(share), cv2.COLORMAP_VIRIDIS)[..., ::-1].astype(np.uint8)


def _in_colour(image: NDArray[np.uint8], known: NDArray[np.bool_]) -> bytes:
    shown = fitting(np.ascontiguousarray(image), cv2.INTER_AREA)
    shown_known = fitting(known.astype(np.uint8), cv2.INTER_NEAREST) > 0
    return png.encode_colour(np.where(shown_known[..., None], shown, np.array(UNKNOWN, np.uint8)))
