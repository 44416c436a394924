"""Completion without learning, the reference for learnt methods.

Every function returns depth (h, w) [m] of all pixels of a frame that has some.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from starling.learning.completion.method import (
    Completed,
    CompletionFrame,
    Image,
    Mask,
    unknown_sigma,
)
from starling.sim.arrays import filled

_LEVEL = 0.45  # Mean that the image is scaled to, a usual target of a colour camera's exposure.
_GUIDE_SIGMA_PX = 1.5  # Sigma of the Gaussian smoothing of the guide image [px].
_ISLAND_PX = 400  # Patches of depth up to this area are not extended [px].
_STEP = 0.05  # Ratio of neighbouring depths, less 1, that separates two patches.
_LOG_STEPS = 1000  # Quantisation of a patch's depth: steps per unit of its natural logarithm.

_SMOOTHNESS = 100.0  # Lambda of `wls`: extent of smoothing in uniform image regions.
_WLS_SIGMA = 3.0  # Sigma of the image's difference for `wls` [of 255].
_REACHED = 1e-6  # Least share of a valid pixel's weight at a filled pixel.

_BILATERAL_PX = 3.0  # Sigma of distance at each scale; the window reaches two sigma [px].
_BILATERAL_SIGMA = 12.0  # Sigma of the image's difference for `bilateral` [of 255].
_COARSE_WEIGHT = 0.003  # Weight of the coarser image, relative to 1 of a valid pixel.
_LEAST_PX = 8  # Least side of a coarser image.

_MARGIN_M = 1.0  # Distance of the farthest depth from the value "empty".
# Sides of the square windows of `morphological` [px]: first dilation, by a diamond; closing of
# small gaps; fill of small holes; fill of large holes; median against outliers; final Gaussian.
_DIAMOND, _CLOSING, _SMALL, _LARGE, _MEDIAN, _BLUR = 5, 5, 7, 31, 5, 5

# Sigma of the greatest difference of a channel between neighbours for `poisson` [of 255].
_POISSON_SIGMA = 2.0
_LEAST_WEIGHT = 1e-3  # Weight across the sharpest edge, so that every hole has a rim.


def completed(frame: CompletionFrame, filled_m: NDArray[np.floating]) -> Completed:
    """Keep the camera's depth bit for bit and fill the other pixels.

    These methods do not estimate their error, so that sigma is NaN.
    """
    depth = np.where(frame.valid, frame.depth_m, filled_m).astype(np.float32)
    return Completed(depth_m=depth, sigma_m=unknown_sigma(frame))


def trusted(frame: CompletionFrame) -> Mask:
    """Return the valid pixels (h, w) that holes are filled from.

    Small isolated patches with a different depth are mostly false matches, which would spread over
    the whole hole. If most of the depth is in small patches, as with scattered points, all is
    trusted.
    """
    log = np.log(np.where(frame.valid, frame.depth_m, np.float32(1)))
    code = np.where(frame.valid, _LOG_STEPS * (log - log.min()) + 1, 0)
    patches = np.minimum(code, np.iinfo(np.int16).max).astype(np.int16)
    cv2.filterSpeckles(patches, 0, _ISLAND_PX, round(_LOG_STEPS * _STEP))
    large = patches > 0
    return large if 2 * np.count_nonzero(large) >= np.count_nonzero(frame.valid) else frame.valid


def inverse(depth_m: Image, known: Mask) -> Image:
    """Inverse depth [1/m], 0 where unknown.

    Inverse depth is averaged and smoothed because it is linear over the image of a plane. A stereo
    camera's noise is uniform in it.
    """
    out = np.zeros(known.shape, np.float32)
    np.divide(np.float32(1), depth_m, out=out, where=known)
    return out


def guide(frame: CompletionFrame) -> NDArray[np.uint8]:
    """Return the image (h, w, 3) that marks the edges of surfaces, 8 bits.

    Dark (infrared) images are scaled to a colour image's level. A Gaussian removes the projector's
    dots.
    """
    image = np.asarray(cv2.GaussianBlur(frame.rgb, (0, 0), _GUIDE_SIGMA_PX), np.float32)
    gain = _LEVEL / max(float(image.mean()), 1e-6)
    return np.rint(255 * np.clip(image * gain, 0, 1)).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class Classical:
    """A classical method by the name of its function."""

    name: str

    def fill(self, frame: CompletionFrame) -> Completed:
        """Complete a frame; valid pixels stay as they are."""
        return completed(frame, _FUNCTIONS[self.name](frame))


def nearest(frame: CompletionFrame) -> Image:
    """Fill each hole pixel with the depth of the nearest valid pixel in the image."""
    return filled(frame.depth_m, trusted(frame))


def wls(frame: CompletionFrame) -> Image:
    """Weighted least squares along rows and columns, guided by the image.

    Min et al., Fast global image smoothing based on weighted least squares, TIP 2014, in OpenCV's
    implementation. As in its section V for sparse input, smoothed inverse depth is divided by the
    smoothed mask. Pixels enclosed by edges that no valid pixel's weight reaches take the nearest
    reached depth.
    """
    known = trusted(frame)
    smoother = cv2.ximgproc.createFastGlobalSmootherFilter(guide(frame), _SMOOTHNESS, _WLS_SIGMA)
    weight = np.asarray(smoother.filter(known.astype(np.float32)), np.float32)
    value = np.asarray(smoother.filter(inverse(frame.depth_m, known)), np.float32)
    reached = (weight > _REACHED) | known
    depth = np.ones(frame.shape, np.float32)
    np.divide(weight, value, out=depth, where=weight > _REACHED)
    return filled(np.where(known, frame.depth_m, depth), reached)


def bilateral(frame: CompletionFrame) -> Image:
    """Mean of nearby valid pixels of similar colour, from coarse to fine.

    Normalised convolution (Knutsson and Westin, Normalized and differential convolution, CVPR
    1993): the filtered known depth is divided by the filtered mask. The filter is the joint
    bilateral one. A window as wide as the widest hole would be slow. Holes beyond the window take
    depth from a coarser image, filtered again by the finer one (Kopf et al., Joint bilateral
    upsampling, SIGGRAPH 2007).
    """
    known = trusted(frame)
    return _array(
        1 / _from_coarse(guide(frame), inverse(frame.depth_m, known), known.astype(np.float32))
    )


def _from_coarse(image: NDArray[np.uint8], value: Image, weight: Image) -> Image:
    """Fill inverse depth (h, w) from values with weights; 0 is unknown."""
    height, width = weight.shape
    known = weight > 0
    if known.all():
        return value
    if min(height, width) < 2 * _LEAST_PX:
        coarse = np.full(weight.shape, (value * weight).sum() / weight.sum(), np.float32)
    else:
        size = ((width + 1) // 2, (height + 1) // 2)
        halved = _smaller(weight, size)
        mean = _smaller(value * weight, size) / np.maximum(halved, np.float32(1e-6))
        small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        coarse = _from_coarse(small, np.where(halved > 0, mean, 0).astype(np.float32), halved)
        coarse = np.asarray(cv2.resize(coarse, (width, height)), np.float32)
    weights = np.where(known, weight, np.float32(_COARSE_WEIGHT))
    mixed = np.where(known, value, coarse)
    return np.where(known, value, _smooth(image, mixed * weights) / _smooth(image, weights))


def _smooth(image: NDArray[np.uint8], values: Image) -> Image:
    reach = 2 * round(2 * _BILATERAL_PX) + 1
    smooth = cv2.ximgproc.jointBilateralFilter(
        image.astype(np.float32), values, reach, _BILATERAL_SIGMA, _BILATERAL_PX
    )
    return np.asarray(smooth, np.float32)


def _smaller(image: Image, size: tuple[int, int]) -> Image:
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)


def morphological(frame: CompletionFrame) -> Image:
    """Extend depth into holes by grey-scale morphology, without the image.

    Dilation, closing, and fills of growing size. Source: Ku, Harakeh and Waslander, In defense of
    classical image processing: fast depth completion on the CPU, CRV 2018, section III, with the
    sizes given there. The extension of columns to the top of the image, made for laser scanners
    outdoors, is omitted. The large fill is repeated until all pixels are filled. Near surfaces grow
    into large holes, also where a stereo camera is occluded.
    """
    # Inverted, so that dilation, a maximum, takes the nearest depth; 0 is empty.
    far = np.float32(np.nanmax(frame.depth_m) + _MARGIN_M)
    grown: Image = np.where(trusted(frame), far - frame.depth_m, np.float32(0))
    grown = _array(cv2.dilate(grown, _diamond(_DIAMOND)))
    grown = _array(cv2.morphologyEx(grown, cv2.MORPH_CLOSE, _square(_CLOSING)))
    grown = _into_empty(grown, _SMALL)
    while (grown == 0).any():
        grown = _into_empty(grown, _LARGE)
    grown = _array(cv2.medianBlur(grown, _MEDIAN))
    return far - _array(cv2.GaussianBlur(grown, (_BLUR, _BLUR), 0))


def _into_empty(grown: Image, size: int) -> Image:
    return np.where(grown == 0, _array(cv2.dilate(grown, _square(size))), grown)


def _square(size: int) -> NDArray[np.uint8]:
    return np.ones((size, size), np.uint8)


def _diamond(size: int) -> NDArray[np.uint8]:
    away = np.abs(np.arange(size) - size // 2)
    return (away[:, None] + away <= size // 2).astype(np.uint8)


def _array(image: object) -> Image:
    return np.asarray(image, np.float32)


def poisson(frame: CompletionFrame) -> Image:
    """The smoothest inverse depth in holes: a membrane fixed at their rims, torn at image edges.

    Minimises the sum of w (x_i - x_j)^2 over neighbouring pixels. Here x is inverse depth, and w is
    exp(-(step / sigma)^2 / 2) for the image's difference `step`. Valid pixels are fixed. This is a
    Poisson problem without sources. Where w is constant the solution is harmonic, so that a plane,
    linear in inverse depth, is extended exactly. Cf. Levin, Lischinski and Weiss, Colorization
    using optimization, SIGGRAPH 2004, which the NYU data set uses to fill its depth.
    """
    image = guide(frame).astype(np.float32)
    across, down = (_weight(image, axis) for axis in (1, 0))
    fixed = trusted(frame)
    return _array(1 / _membrane(inverse(frame.depth_m, fixed), fixed, across, down))


def _weight(image: Image, axis: int) -> NDArray[np.float64]:
    """Return the weight of each pixel and the next along an axis."""
    step = np.abs(np.diff(image, axis=axis)).max(axis=2).astype(np.float64)
    return np.maximum(np.exp(-((step / _POISSON_SIGMA) ** 2) / 2), _LEAST_WEIGHT)


def _membrane(
    values: Image, fixed: Mask, across: NDArray[np.float64], down: NDArray[np.float64]
) -> Image:
    """Solve for the free pixels by a direct solver, so that results are reproducible."""
    number = np.full(fixed.shape, -1)
    number[~fixed] = np.arange(np.count_nonzero(~fixed))
    size = number.max() + 1
    diagonal, pull = np.zeros(size), np.zeros(size)
    entries: list[tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]] = []
    horizontal = ((slice(None), slice(None, -1)), (slice(None), slice(1, None)), across)
    vertical = ((slice(None, -1), slice(None)), (slice(1, None), slice(None)), down)
    for first, second, weight in (horizontal, vertical):
        for pixel, neighbour in ((first, second), (second, first)):
            free = ~fixed[pixel]
            row, column, w = number[pixel][free], number[neighbour][free], weight[free]
            np.add.at(diagonal, row, w)
            rim = column < 0
            np.add.at(pull, row[rim], w[rim] * values[neighbour][free][rim])
            entries.append((row[~rim], column[~rim], -w[~rim]))
    rows, columns, weights = (np.concatenate(part) for part in zip(*entries, strict=True))
    matrix = sparse.csc_array((weights, (rows, columns)), shape=(size, size))
    matrix = sparse.csc_array(matrix + sparse.diags_array(diagonal))
    # The matrix is symmetric and positive definite: no pivoting is needed.
    factors = linalg.splu(
        matrix,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    out = values.astype(np.float64)
    out[~fixed] = factors.solve(pull)
    return out.astype(np.float32)


_FUNCTIONS = {
    function.__name__: function for function in (nearest, morphological, bilateral, wls, poisson)
}
