"""The projector's dots as a capture shows them: where, how dense, in how much of the field."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from starling.calibration.correlation import WINDOW_PX, high_passed
from starling.calibration.plausibility.correspondence import Correspondences
from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry import frames
from starling.sim.render import emission
from starling.sim.sensor.sensor import Projector

Array = NDArray[np.float32]

_SKEWNESS = 0.5  # Bright dots on dark: 1 to 2 in captures, below 0 for most of a room's texture.
_SMOOTH_PX = 0.8  # Sigma before spots are counted.
_FAINTEST = 0.2  # A spot counts from this share of the brightest in its window: above noise.
_IMAGER_BLUR_PX = 0.5  # Sigma that an imager's pixel and lens add to a drawn pattern.
_CELLS = (8, 12)  # Rows and columns that the projector's field is cut into.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DotsSeen:
    """Windows of one scene that show dots, n of `tried`."""

    row: NDArray[np.intp]  # (n,) Centres in the left image [px].
    column: NDArray[np.intp]  # (n,)
    disparity_px: Array  # (n,)
    per_deg2: Array  # (n,) Spots per square degree of the imager's solid angle.
    tried: int
    image_deg2: float  # The image in those square degrees.

    @property
    def share(self) -> float:
        """Share of the windows tried that show dots, 0 ... 1."""
        return len(self.row) / self.tried

    @property
    def count(self) -> float:
        """Dots in the whole image, had all of it been looked at."""
        return float(self.per_deg2.sum()) / self.tried * self.image_deg2


def see(found: Correspondences, camera: CaptureInfo) -> DotsSeen:
    """Pick the windows that both imagers see alike and whose light is bright spots on dark.

    The mean of both images' patches tells dots from texture by its skewness: above 0.5. In 15
    captured rooms and one table 30 to 66 % of all windows pass with the projector on; off, 3 %
    of the table's and up to 4 % of simulated rooms'. A surface full of small bright specks
    would pass too.

    Args:
        found: correspondences of the scene's infrared pair.
        camera: size and focal length of the imagers.
    """
    scale = _px2_per_deg2(camera.fx_px)
    square = (found.patch**2).mean(axis=(1, 2))
    skewness = (found.patch**3).mean(axis=(1, 2)) / np.maximum(square, 1e-12) ** 1.5
    dotted = skewness > _SKEWNESS
    return DotsSeen(
        row=found.row[dotted],
        column=found.column[dotted],
        disparity_px=found.disparity_px[dotted],
        per_deg2=_spots_per_px2(found.patch[dotted]) * scale,
        tried=found.tried,
        image_deg2=camera.width * camera.height / scale,
    )


def stated_per_deg2(part: Projector, focal_px: float) -> float:
    """Spots per square degree that an imager counts where a projector's pattern is seen.

    It is counted as in captures, on the pattern drawn at the imager's resolution: spots that
    melt together there count as one, so it falls short of the dots that were drawn. Patterns of
    several emitters are laid over each other as they are far away; nearer they slide, and as many
    spots melt elsewhere.

    Args:
        part: the projector.
        focal_px: of the imagers.

    Raises:
        InputError: if the pattern cannot be had.
    """
    half_x, half_y = emission.half_tangents(part)
    size = (
        max(WINDOW_PX, round(2 * half_x * focal_px)),
        max(WINDOW_PX, round(2 * half_y * focal_px)),
    )
    drawn = [
        cv2.resize(
            emission.irradiance_at_unit_distance(part, number),
            size,
            interpolation=cv2.INTER_AREA,
        )
        for number in range(len(emission.emitters(part)))
    ]
    seen = high_passed(cv2.GaussianBlur(np.sum(drawn, axis=0), (0, 0), _IMAGER_BLUR_PX))
    starts = (range(0, length - WINDOW_PX + 1, WINDOW_PX) for length in seen.shape)
    rows, columns = (list(start) for start in starts)
    cut = [seen[y : y + WINDOW_PX, x : x + WINDOW_PX] for y in rows for x in columns]
    return float(_spots_per_px2(np.stack(cut)).mean() * _px2_per_deg2(focal_px))


def covered(part: Projector, dots: DotsSeen, camera: CaptureInfo) -> NDArray[np.bool_]:
    """Cells of the projector's field, (8, 12) in tangents, in which a scene shows dots.

    Args:
        part: the projector, posed in the left imager's frame.
        dots: what the scene shows; its own disparities tell where the dots lie.
        camera: intrinsics and baseline of the imagers.
    """
    cells = np.zeros(_CELLS, bool)
    near = dots.disparity_px > 0.5  # Beyond, the distance is anything.
    depth = camera.focal_baseline_px_m / dots.disparity_px[near]
    points = np.stack(
        [
            (dots.column[near] - camera.cx_px) / camera.fx_px * depth,
            (dots.row[near] - camera.cy_px) / camera.fy_px * depth,
            depth,
            np.ones_like(depth),
        ]
    )
    local = np.linalg.inv(frames.pose(part.position_m, part.rotation_deg)) @ points
    ahead = local[:, local[2] > 0]
    half_x, half_y = emission.half_tangents(part)
    column = np.floor((ahead[0] / ahead[2] / half_x + 1) / 2 * _CELLS[1]).astype(int)
    row = np.floor((ahead[1] / ahead[2] / half_y + 1) / 2 * _CELLS[0]).astype(int)
    inside = (row >= 0) & (row < _CELLS[0]) & (column >= 0) & (column < _CELLS[1])
    cells[row[inside], column[inside]] = True
    return cells


def _spots_per_px2(patches: NDArray) -> Array:
    """Bright local maxima in (n, 31, 31) high-passed patches, less a border of 2 px."""
    smooth = ndimage.gaussian_filter(patches, (0, _SMOOTH_PX, _SMOOTH_PX))
    bright = smooth > _FAINTEST * smooth.max(axis=(1, 2), keepdims=True, initial=0.0)
    peak = bright & (smooth == ndimage.maximum_filter(smooth, (1, 3, 3)))
    inner = peak[:, 2:-2, 2:-2]
    return inner.mean(axis=(1, 2)).astype(np.float32)


def _px2_per_deg2(focal_px: float) -> float:
    """Pixels in a square degree on the axis; off it a pixel's solid angle shrinks."""
    return float(np.deg2rad(1) * focal_px) ** 2
