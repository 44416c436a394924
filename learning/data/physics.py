"""Probability of no depth from repeated simulations, and their cache files."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.data.example import Image, Physics
from starling.learning.methods import model_file
from starling.patterns import errors

# Simulated holes are accurate to half a matching window of 9 px. Their borders depend on single
# dots and on the registration of the reference. On real rooms every blur of 1 to 8 px improves the
# ranking of pixels, most at 3 to 5 px.
PLACE_PX = 4.0
PRIOR_DRAWS = 1.0  # Weight of the prior, the scene's mean share of holes, in draws.
_RAREST = 1e-3  # Least share of holes, or of depth, of a scene.


def physics_probability(physics: Physics, *, place_px: float = PLACE_PX) -> Image:
    """Estimate the probability (h, w) of no depth from simulations (see `drawn_probability`).

    Args:
        physics: repeated simulations.
        place_px: sigma of the Gaussian; 0 = no smoothing.

    Raises:
        InputError: if there is no draw.
    """
    return drawn_probability(physics.ndp, physics.draws, place_px=place_px)


def drawn_probability(ndp: NDArray, draws: int, *, place_px: float = PLACE_PX) -> Image:
    """Estimate the probability (h, w) of no depth from k of n draws: (k' + a m) / (n + a), a = 1.

    k' is k smoothed by a Gaussian, because holes are accurate to a matching window only; m is the
    share of holes in all draws of the scene. It keeps the probability away from 0 and 1, which few
    draws cannot support. A prior of 1/2 instead would predict 6 % of holes in regions without any.

    Args:
        ndp: (h, w) k / n, share of the draws without depth, 0 to 1.
        draws: n.
        place_px: sigma of the Gaussian; 0 = no smoothing.

    Source: the posterior mean under a beta prior fitted to all pixels (empirical Bayes; Casella, An
    introduction to empirical Bayes data analysis, The American Statistician 39, 1985).

    Raises:
        InputError: if there is no draw.
    """
    errors.in_interval("draws", draws, 1, 1_000_000, "Simulate at least once.")
    mean = np.clip(ndp.mean(dtype=np.float64), _RAREST, 1 - _RAREST)
    share = ndp.astype(np.float64)
    if place_px > 0:
        share = np.clip(_smoothed(share, place_px), 0, 1)
    return ((share * draws + PRIOR_DRAWS * mean) / (draws + PRIOR_DRAWS)).astype(np.float32)


def missed_probability(probability: Image, simulated: Image) -> Image:
    """Return the probability (h, w) that a pixel has no depth where physics has it, at least 0.

    Args:
        probability: (h, w) predicted probability of no depth.
        simulated: (h, w) probability by physics, from `physics_probability`.
    """
    return np.clip((probability - simulated) / (1 - simulated), 0, 1).astype(np.float32)


def as_precise_as_physics(image: NDArray) -> NDArray:
    """Smooth a simulated image (h, w) by its position uncertainty, 4 px."""
    return _smoothed(image, PLACE_PX)


def _smoothed(image: NDArray, sigma_px: float) -> NDArray:
    smoothed = cv2.GaussianBlur(image, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(smoothed, image.dtype)


_VERSION = 3
_KINDS = {  # Kinds of the arrays (see `model_file.take`).
    **{"ndp": "f2", "draws": "i0", "infrared": "f2", "contrast": "f2", "disparity_px": "f2"},
    **{"one_draw_px": "f2", "one_draw_ndp": "b2", "reason": "u2"},
}


def write_physics(folder: Path, key: str, physics: Physics) -> None:
    """Write a simulation atomically under a key that identifies its inputs.

    Raises:
        InputError: if the file cannot be written.
    """
    fields = dataclasses.fields(Physics)
    arrays = {field.name: np.asarray(getattr(physics, field.name)) for field in fields}
    model_file.write(folder, key, _VERSION, arrays)


def read_physics(folder: Path, key: str) -> Physics | None:
    """Read a simulation by its key; None if it is not in the cache.

    Raises:
        InputError: if the file is damaged or of another version.
    """
    path = model_file.path_of(folder, key)
    if not path.is_file():
        return None
    remedy = "Delete it: it is simulated again."
    try:
        arrays = model_file.take(model_file.read(folder, key, _VERSION), _KINDS, folder)
    except errors.InputError as error:
        rule = "must be whole and of this version"
        raise errors.refuse("simulation", rule, path, remedy) from error
    values: dict[str, Any] = dict(zip(_KINDS, arrays, strict=True))
    if len({array.shape for array in arrays if array.ndim}) > 1:
        raise errors.refuse("simulation", "must have images of one size", path, remedy)
    values["draws"] = int(values["draws"])
    return Physics(**values)
