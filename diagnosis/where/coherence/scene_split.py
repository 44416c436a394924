"""Coherence split of the infrared pair of one scene."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.observation import StereoObservation
from starling.diagnosis.scenes.strata import Strata
from starling.diagnosis.where.coherence import views
from starling.diagnosis.where.coherence.image_split import ScenePowers, split_powers
from starling.diagnosis.where.coherence.repeats import FrameSpectra, SceneSpectra
from starling.diagnosis.where.coherence.spectra import cells_within, window_means, window_powers
from starling.diagnosis.where.coherence.views import NO_WINDOWS, Pair, PairSpectra, SampledView
from starling.sim.arrays import Image, Mask

FEWEST_WINDOWS = 8  # Least number of windows of a scene.
_SATURATED = 1e-4  # Least share of pixels at the largest level of a saturated image.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SceneSplit:
    """Power of one scene's images, and the spectra of its unexplained part."""

    powers: ScenePowers
    spectra: SceneSpectra
    shift_px: tuple[float, float]  # Median shift of the right image right and down, over surfaces.


def split_scene(
    real: StereoObservation,
    base: StereoObservation,
    strata: Strata,
    pattern_scale: float = 1.0,
) -> SceneSplit | None:
    """Split the first captured pair of a scene by the first simulated one.

    Args:
        real: captured pairs.
        base: simulated pairs, or those of another capture.
        strata: strata of the scene.
        pattern_scale: fitted to the scene.

    Returns:
        None with too few windows without depth edges.
    """
    pairs: tuple[Pair, Pair] = _first(real), _first(base)
    root = views.root_level(strata)
    surface = views.surface_pixels(strata) & unsaturated(pairs)
    seen = [views.camera_view(pair, strata, surface, root) for pair in pairs]
    common = seen[0].known & seen[1].known
    seen = [replace(view, known=common) for view in seen]
    cells = cells_within(common)
    if len(cells) < FEWEST_WINDOWS:
        return None
    of_real, of_base = _spectra(pairs, seen, root, cells)
    powers = split_powers(of_real, of_base)
    directed = views.directions(strata, pattern_scale)
    return SceneSplit(
        powers=powers,
        spectra=SceneSpectra(
            camera=_frame(cells, of_real.less(of_base, powers.gain), _parallax(directed), common),
            projector=_projector_frame(pairs, seen, directed, root, powers),
        ),
        shift_px=views.median_shift(seen[0], strata),
    )


def unsaturated(pairs: tuple[Pair, Pair]) -> Mask:
    """Return where no left image is at the largest level of its data (h, w).

    The brightest level counts as saturation only if it is frequent.
    """
    masks = []
    for left, _ in pairs:
        full = left >= left.max()
        masks.append(~full if full.mean() > _SATURATED else np.ones(full.shape, bool))
    return masks[0] & masks[1]


def _first(observation: StereoObservation) -> Pair:
    return observation.left[0].astype(np.float32), observation.right[0].astype(np.float32)


def _spectra(
    pairs: tuple[Pair, Pair], seen: list[SampledView], root: Image, cells: NDArray[np.intp]
) -> tuple[PairSpectra, PairSpectra]:
    real, base = (
        views.pair_spectra(pair, view, root, cells) for pair, view in zip(pairs, seen, strict=True)
    )
    return real, base


def _projector_frame(
    pairs: tuple[Pair, Pair],
    seen: list[SampledView],
    directed: Image,
    root: Image,
    powers: ScenePowers,
) -> FrameSpectra:
    surface = seen[0].known
    fields = [views.projector_view(view, directed, surface) for view in seen]
    known = fields[0].known & fields[1].known
    fields = [replace(view, known=known) for view in fields]
    cells = cells_within(known)
    x, y = views.pixel_grid(known.shape)
    place = np.stack([fields[0].left_x - x, fields[0].left_y - y], axis=-1)
    if not len(cells):
        return _frame(cells, NO_WINDOWS, place, known)
    real, base = _spectra(pairs, fields, root, cells)
    return _frame(cells, real.less(base, powers.gain), place, known)


def _parallax(directed: Image) -> Image:
    """Return how far the projector's field is displaced at each pixel (h, w, 2) [px]."""
    return np.asarray(directed - np.stack(views.pixel_grid(directed.shape), axis=-1), np.float32)


def _frame(
    cells: NDArray[np.intp], unexplained: PairSpectra, place: Image, known: Mask
) -> FrameSpectra:
    """Collect the unexplained spectra of one frame.

    Args:
        cells: grid cells.
        unexplained: unexplained spectra of these cells.
        place: (h, w, 2) displacement of the other frame [px].
        known: (h, w).
    """
    place = np.where(known[..., None], np.nan_to_num(place), 0).astype(np.float32)
    mean, square = (
        np.stack([window_means(each[..., axis], known, cells) for axis in (0, 1)], axis=-1)
        for each in (place, place**2)
    )
    return FrameSpectra(
        cells=cells,
        left=unexplained.left,
        right=unexplained.right,
        place=mean,
        spread=np.sqrt(np.maximum(square - mean**2, 0)),
        power=np.sqrt(
            window_powers(unexplained.left, unexplained.left_power)
            * window_powers(unexplained.right, unexplained.right_power)
        ),
    )
