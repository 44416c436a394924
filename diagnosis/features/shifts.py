"""Displacement of an image against a partner: position, height and width of a correlation peak.

The correlation is computed at all whole displacements within `REACH_PX`. Its largest value is
refined by a Gaussian through the neighbours, which moves it by half a pixel at most. A reading is
therefore monotone in the true displacement, to `TOLERANCE_PX` where dots are 0.6 px or more in
sigma. Displacements of `REACH_PX - 0.5` or more have no reading, and neither have images that do
not correlate. The range covers `vertical_offset`, `disparity_offset`, `pitch`, `yaw`, `roll` and
`distortion`. It does not cover the ends of `projector_rotation`, `focal_scale` and `model_turn`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.features import bins
from starling.diagnosis.scenes.shelf import MOST_HELD
from starling.diagnosis.scenes.strata import Image, Strata

REACH_PX = 4  # Largest displacement at which the correlation is computed.
TOLERANCE_PX = 0.04  # Largest error of a reading without noise; measured: 0.028 px.
_BINS = ("depth", "x", "y")
_WINDOW_PX = 15  # Side of the window in which images are standardised.
_MOST = 0.95  # Factor on a correlation: keeps its Fisher transform finite for equal images.
_RELIABLE = 0.3  # Correlation below which the position of its peak is chance.
_FLATTEST = 1e-3  # Least curvature of the logarithm of a peak [px^-2].
_LOWEST = 0.05  # Lower limit of a peak's neighbour, relative to the peak.
_REACH = range(-REACH_PX, REACH_PX + 1)
_ROWS = 32  # Rows of one block, whose products fit into the memory near the processor.
_SEARCH_ROWS = 90  # Number of rows of the search; the peak is fitted to all rows.

Place = tuple[int, int]  # Displacement down and right [px].


def pair_shift_features(left: Image, right: Image, strata: Strata) -> dict[str, float]:
    """Correlate the left image with the right image, warped by the reference disparity."""
    partner = standardise(warp_to_left(right, strata.disparity_px))
    return _shift_features("pair", standardise(left), partner, strata)


def dot_shift_features(left: Image, strata: Strata) -> dict[str, float]:
    """Correlate the left image with the expected image."""
    return _shift_features("dots", standardise(left), _standardised_expected(strata), strata)


def warp_to_left(image: Image, disparity_px: Image) -> Image:
    """Warp a right image (h, w) into the left view."""
    y, x = np.indices(image.shape, np.float32)
    return np.asarray(
        cv2.remap(
            np.asarray(image, np.float32),
            np.asarray(x - np.nan_to_num(disparity_px), np.float32),
            np.asarray(y, np.float32),
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        np.float32,
    )


def standardise(image: Image) -> Image:
    """Subtract the local mean and divide by the local standard deviation."""
    fine = np.asarray(image, np.float32)
    mean = bins.smooth(fine, _WINDOW_PX)
    variance = bins.smooth(fine**2, _WINDOW_PX) - mean**2
    return np.asarray((fine - mean) / np.sqrt(np.maximum(variance, 1e-3)), np.float32)


@lru_cache(maxsize=MOST_HELD)
def _standardised_expected(strata: Strata) -> Image:
    """Standardise the expected image; cached because all observations of a scene use it."""
    return standardise(strata.expected)


def _shift_features(kind: str, image: Image, partner: Image, strata: Strata) -> dict[str, float]:
    """Compute height, position and width in x and y of the correlation peak, by bin."""
    everywhere = [(down, right) for down in _REACH for right in _REACH]
    row_step = max(1, len(image) // _SEARCH_ROWS)
    search = _correlations(image, partner, strata, everywhere, row_step=row_step)
    peaks = {name: max(everywhere, key=values.__getitem__) for name, values in search.items()}
    crosses = {place: _cross(place) for place in set(peaks.values())}
    around = sorted({place for cross in crosses.values() for place in cross})
    features = {}
    for name, values in _correlations(image, partner, strata, around).items():
        down, right = peaks[name]
        height, fits = _fit_peak([values[place] for place in crosses[down, right]])
        features[f"{kind}.match.{name}"] = float(np.arctanh(_MOST * np.clip(height, -1, 1)))
        if not height > _RELIABLE or max(abs(down), abs(right)) == REACH_PX:
            continue
        for axis, middle, (offset, curvature) in zip("xy", (right, down), fits, strict=True):
            features[f"{kind}.shift {axis}.{name}"] = middle + offset
            features[f"{kind}.width {axis}.{name}"] = bins.log(curvature)
    return features


def _cross(place: Place) -> tuple[Place, ...]:
    """List a displacement and its neighbours left, right, above and below."""
    down, right = place
    return place, (down, right - 1), (down, right + 1), (down - 1, right), (down + 1, right)


def _correlations(
    image: Image,
    partner: Image,
    strata: Strata,
    places: Sequence[Place],
    *,
    row_step: int = 1,
) -> dict[str, dict[Place, float]]:
    """Correlate standardised images, in bins of pixels away from edges.

    Args:
        image: (h, w).
        partner: (h, w); its content is displaced.
        strata: bins of the scene.
        places: displacements of the partner's content down and right [px].
        row_step: step between the rows that count.

    Returns:
        By bin and displacement; NaN in bins of too few pixels.
    """
    padded = np.pad(partner, REACH_PX + 1, mode="edge")
    width = image.shape[1]
    sums = np.zeros((len(places) + 3, len(_bin_names(strata))))
    for top in range(0, len(image), _ROWS * row_step):
        rows = range(top, min(top + _ROWS * row_step, len(image)), row_step)
        flat, still = (each[rows.start : rows.stop : row_step] for each in (image, partner))
        products = np.empty((len(sums), *flat.shape), np.float32)
        for product, (down, right) in zip(products[:-3], places, strict=True):
            y, x = (REACH_PX + 1 + move for move in (down, right))
            moved = padded[rows.start + y : rows.stop + y : row_step, x : x + width]
            np.multiply(flat, moved, out=product)
        np.multiply(flat, flat, out=products[-3])
        np.multiply(still, still, out=products[-2])
        products[-1] = 1.0
        sums += products.reshape(len(sums), -1) @ _members(strata, rows).T
    count = sums[-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        power = np.sqrt(np.maximum(sums[-3] / count * sums[-2] / count, 1e-6))
        correlation = np.where(count * row_step < bins.FEWEST, np.nan, sums[:-3] / count / power)
    return {
        name: dict(zip(places, map(float, values), strict=True))
        for name, values in zip(_bin_names(strata), correlation.T, strict=True)
    }


def _bin_names(strata: Strata) -> list[str]:
    """Name all pixels, and the bins of each covariate."""
    return ["all", *(f"{name}.{label}" for name in _BINS for label in _labels(strata, name))]


def _labels(strata: Strata, name: str) -> tuple[str, ...]:
    return strata.covariates[name].bins


def _members(strata: Strata, rows: range) -> NDArray[np.float32]:
    """Return which pixels of some rows are in which bin, 0 or 1 (bins, pixels)."""
    chosen = slice(rows.start, rows.stop, rows.step)
    inside = strata.counted[chosen] & (strata.covariates["edge"].label[chosen] == 0)
    masks = [inside]
    for name in _BINS:
        label = strata.covariates[name].label[chosen]
        masks += [inside & (label == number) for number in range(len(_labels(strata, name)))]
    return np.stack([mask.ravel() for mask in masks]).astype(np.float32)


def _fit_peak(values: Sequence[float]) -> tuple[float, list[tuple[float, float]]]:
    """Fit a Gaussian through a correlation and its neighbours.

    Args:
        values: correlation, and those left, right, above and below.

    Returns:
        Height of the peak. In x and in y: offset of the peak [px], at most the distance of a
        neighbour, and the curvature of its logarithm [px^-2].
    """
    height = values[0]
    if not height > 0:
        return height, []
    logs = np.log(np.maximum(np.divide(values, height), _LOWEST))
    fits, rise = [], 0.0
    for before, after in (logs[1:3], logs[3:5]):
        slope, curvature = 0.5 * (after - before), max(-before - after, _FLATTEST)
        offset = float(np.clip(slope / curvature, -1, 1))
        fits.append((offset, float(curvature)))
        rise += 0.5 * curvature * offset**2
    return height * float(np.exp(rise)), fits
