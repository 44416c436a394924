"""Split of disparity errors: near edges, fixed in the camera image, following the image, rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.observation import SceneObservation, StereoObservation
from starling.diagnosis.scenes.strata import FAR_OFF_PX, Strata
from starling.diagnosis.where.coherence import views
from starling.diagnosis.where.coherence.scene_split import FEWEST_WINDOWS
from starling.diagnosis.where.coherence.spectra import (
    BANDS,
    Plane,
    Spectra,
    band_sums,
    cells_within,
    cross,
    window_means,
    window_powers,
    window_spectra,
)
from starling.sim.arrays import Image, Mask

LONGEST = "> 64 px"  # Band of the means of windows.
DISPARITY_BANDS = (*(band.name for band in BANDS), LONGEST)
SIDES: tuple[str, ...] = ("real", "simulated", "gap")  # Gap: real minus simulated.
_LEAST_KNOWN = 0.9  # Least share of pixels with depth in a window.
_LEAST_POWER = 1e-6  # Share of an image's power that keeps a filter finite.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ErrorSpectra:
    """Disparity errors of one scene's windows, and the image that they may follow."""

    cells: NDArray[np.intp]
    error: Spectra
    means: NDArray[np.float64]  # (windows,) less their mean [px].
    image: Spectra | None  # None without infrared.
    edge_square: float  # Sum of squares near depth edges [px^2].
    surface_square: float  # Sum of squares elsewhere.

    @property
    def powers(self) -> NDArray[np.float64]:
        """Mean square by band [px^2]; the last one is that of the windows' means."""
        inside = band_sums(cross(self.error, self.error)) / len(self.cells)
        return np.append(inside, float(np.mean(self.means**2)))


def error_spectra(
    real: SceneObservation, base: SceneObservation, strata: Strata
) -> dict[str, ErrorSpectra] | None:
    """Transform the disparity errors of a scene: captured, simulated, and their difference.

    Args:
        real: captured disparity.
        base: simulated disparity, or that of another capture.
        strata: strata of the scene.

    Returns:
        By side; None with too few windows without depth edges.
    """
    errors = [_error(observation.depth_px[0], strata) for observation in (real, base)]
    surface = views.surface_pixels(strata)
    known = surface & np.isfinite(errors[0]) & np.isfinite(errors[1])
    cells = np.intersect1d(cells_within(surface), cells_within(known, least=_LEAST_KNOWN), True)
    if len(cells) < FEWEST_WINDOWS:
        return None
    images = [_image(observation, strata, surface, cells) for observation in (real, base)]
    sides = zip(SIDES, (*errors, errors[0] - errors[1]), (*images, images[0]), strict=True)
    return {name: _side(error, image, strata, known, cells) for name, error, image in sides}


def camera_share(
    first: ErrorSpectra, second: ErrorSpectra
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Correlate the errors of two rooms at the same place of the camera image.

    Returns:
        Sum of the products of both, and sum of the geometric means of their powers (bands,).
    """
    _, in_first, in_second = np.intersect1d(first.cells, second.cells, True, return_indices=True)
    left, right = first.error[in_first], second.error[in_second]
    ones = np.ones(left.shape[1:])
    powers = np.sqrt(window_powers(left, ones) * window_powers(right, ones)).sum(axis=0)
    means = first.means[in_first], second.means[in_second]
    size = np.sqrt(np.sum(means[0] ** 2) * np.sum(means[1] ** 2))
    return (
        np.append(band_sums(cross(left, right)), float(means[0] @ means[1])),
        np.append(powers, float(size)),
    )


def image_shares(scenes: Sequence[ErrorSpectra], rooms: Sequence[str]) -> NDArray[np.float64]:
    """Return the share of each scene's error that a filter of its image predicts (scenes, bands).

    The filter has a free amplitude and phase at each frequency, and is fitted to the other rooms.
    The share is 0 or less if a filter of other rooms does not help. It is 0 without other rooms.
    """
    shares = np.zeros((len(scenes), len(DISPARITY_BANDS)))
    sums = [None if scene.image is None else _filter_sums(scene) for scene in scenes]
    for number, (scene, room) in enumerate(zip(scenes, rooms, strict=True)):
        others = [
            each
            for each, name in zip(sums, rooms, strict=True)
            if name != room and each is not None
        ]
        scene_sums = sums[number]
        if scene_sums is None or not others:
            continue
        products, power = (np.sum([each[part] for each in others], axis=0) for part in (0, 1))
        response = products / (power + _LEAST_POWER * power.max())
        gained = (
            2 * np.real(scene_sums[0] * response.conj()) - np.abs(response) ** 2 * scene_sums[1]
        )
        total = np.maximum(scene.powers[:-1] * len(scene.cells), 1e-12)
        shares[number, :-1] = band_sums(gained) / total
    return shares


def edge_shares(scenes: Sequence[ErrorSpectra]) -> NDArray[np.float64]:
    """Return the share of each scene's squared errors that lies near depth edges (scenes,)."""
    squares = np.array([(scene.edge_square, scene.surface_square) for scene in scenes])
    return squares[:, 0] / np.maximum(squares.sum(axis=1), 1e-12)


def _error(disparity_px: Image, strata: Strata) -> Image:
    """Return disparity minus reference, less its median; NaN where unknown or far off."""
    error = disparity_px - strata.disparity_px
    inside = strata.counted & (np.abs(error) <= FAR_OFF_PX)
    middle = np.median(error[inside]) if inside.any() else np.float32(0)
    return np.where(inside, error - middle, np.float32(np.nan))


def _image(
    observation: SceneObservation, strata: Strata, surface: Mask, cells: NDArray[np.intp]
) -> Spectra | None:
    if not isinstance(observation, StereoObservation):
        return None
    divisor = window_means(views.root_level(strata), surface, cells)[:, None, None]
    level = observation.left[0].astype(np.float32)
    return window_spectra(level, surface, cells) / divisor.astype(np.float32)


def _side(
    error: Image, image: Spectra | None, strata: Strata, known: Mask, cells: NDArray[np.intp]
) -> ErrorSpectra:
    means = window_means(error, known, cells)
    square = np.nan_to_num(error) ** 2
    near = strata.counted & ~strata.interior
    return ErrorSpectra(
        cells=cells,
        error=window_spectra(error, known, cells),
        means=means - means.mean(),
        image=image,
        edge_square=float(square[near].sum()),
        surface_square=float(square[strata.interior].sum()),
    )


def _filter_sums(scene: ErrorSpectra) -> tuple[NDArray[np.complex128], Plane]:
    """Sum error times image, and the image's power, over windows."""
    assert scene.image is not None
    return cross(scene.error, scene.image), cross(scene.image, scene.image).real


def pooled_camera_shares(
    pairs: Mapping[tuple[int, int], tuple[NDArray[np.float64], NDArray[np.float64]]],
    times: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the share by band that repeats in the camera image; 0 without pairs of rooms.

    Args:
        pairs: from `camera_share`, by the numbers of both scenes.
        times: (scenes,) weight of each scene.
    """
    total, size = np.zeros(len(DISPARITY_BANDS)), np.zeros(len(DISPARITY_BANDS))
    for (first, second), (products, powers) in pairs.items():
        total += times[first] * times[second] * products
        size += times[first] * times[second] * powers
    return np.where(size > 0, total / np.maximum(size, 1e-12), 0.0)
