"""What an effect does to a simulated image, laid onto a captured one of the same scene.

A captured image has texture and noise that a simulated one has not, and answers to an effect by
them: blur takes texture away, noise adds to it. So what simulation with and without the effect
differ by is taken apart, into what is done to whatever image is there, which the captured one gets
as well, and what is put on top:

    with = t(h * without) + r

h is a filter, told block by block, as what shifts or blurs may differ over the image; t the mean
level that goes with each level; r the rest. What is done to the scene is not what is done to noise
and speckle, which a lens does not blur. So h is told by images that are simulated without these,
and r is parted: what h leaves of the scene, and what it leaves of noise and speckle. Where an
effect leaves these as they are, the latter is what h would have taken of them: it comes back.

Noise that one adds in quadrature to noise that is there makes images with the same draws differ by
less than it adds. So what is left of noise is made stronger by as much as power is missing, and
stays where it is: a sensor's is everywhere, speckle on dots. Where noise should be less, the
captured image loses that.

Where a curve alone makes the one with the effect of the one without, that comes first: a filter
would take its mean slope for its own, and levels of a captured image may lie beyond the simulated.

All this is done to levels that the captured image may have been rounded from, which are rounded
anew, without an effect too: what levels have that the captured image has not is in both.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.fft import fftfreq, fftshift, irfft2, rfft2, rfftfreq

from starling.diagnosis.transfer import tone_curve

Image = NDArray[np.floating]
Pair = tuple[Image, Image]  # Left and right image (h, w) [DN], not rounded.
Spectrum = NDArray[np.floating] | NDArray[np.complexfloating]

_TILE_PX = 32  # Of the spectra,
_REACH_PX = 8  # and how far the filters reach that these tell.
_BLOCKS = 4  # Along either side at most, each of its own filter.
_LEAST_PX = 3 * _TILE_PX  # Of a block's side.
_MOST = 16.0  # Times the noise that is added,
_LEAST = 0.2  # and share of the captured image that is left at least.
_WINDOW = np.outer(np.hanning(_TILE_PX), np.hanning(_TILE_PX)).astype(np.float32)
# Power too weak to tell of anything, as that of the finest bits.
_LITTLE = 1e-4 * float((_WINDOW**2).sum())
_UNSURE = 0.05  # Share of what is no filter's doing that what tells of one has to be above.
_BANDS = 8  # In which powers are compared,
_RADIUS = np.hypot(fftfreq(_TILE_PX)[:, None], rfftfreq(_TILE_PX)[None])  # [1 / px]
_EDGES = np.linspace(0.0, _RADIUS.max() + 1e-9, _BANDS + 1)  # by how fine they are.
_BAND = (np.digitize(_RADIUS, _EDGES) - 1).ravel()
_POINTWISE = 0.02  # Share of a change's power that a curve leaves where it is all there is.


@dataclass(frozen=True, eq=False)
class Known:
    """Images (h, w) [DN] of one scene and one imager without an effect, and what they tell."""

    levels: Image  # Captured; what was rounded to its whole codes, as of `within_codes`.
    without: Image  # Simulated, not rounded.
    still: Image  # Likewise, without noise and speckle.

    @cached_property
    def spectra(self) -> list[_Spectra]:
        """Of each block."""
        return _block_spectra(self.levels, self.without, self.still)


@dataclass(frozen=True, slots=True, eq=False)
class Changed:
    """Images (h, w) [DN] simulated with an effect, not rounded."""

    image: Image  # By the same noise as without.
    still: Image  # Without noise and speckle.


@dataclass(frozen=True, slots=True, eq=False)
class Exposed:
    """Simulated pairs of one scene, not rounded."""

    pairs: Sequence[Pair]
    still: Pair  # Without noise and speckle.


def laid_on(known: Known, changed: Changed, *, ceiling: float) -> Image:
    """Lay what an effect does to one image onto another.

    Args:
        known: the captured image, and the simulated one without the effect.
        changed: that with it.
        ceiling: largest code.

    Returns:
        (h, w) whole codes [DN].
    """
    level, base, still, other = known.levels, known.without, known.still, changed.image
    if np.array_equal(base, other):
        return _rounded(level, ceiling)
    spectra = None
    bend = tone_curve.told(base, other - base)
    if _power(other - bend.of(base)) < _POINTWISE * _power(other - base):
        level, base, still = (bend.of(one) for one in (level, base, still))
        spectra = _block_spectra(level, base, still)
    blocks = _blocks(level.shape)
    told = [
        _told(of, *(_spectra(one[block.window]) for one in (other, changed.still)))
        for block, of in zip(blocks, spectra or known.spectra, strict=True)
    ]
    more, quieter = _powers(told)
    filtered, same, scene = (np.zeros_like(level) for _ in range(3))
    for of, by in zip(blocks, told, strict=True):
        kernel = _kernel(by.of_scene)
        _add(filtered, level, of, _kernel(by.of_scene * quieter))
        _add(same, base, of, kernel)
        _add(scene, still, of, kernel)
    curve = tone_curve.told(same, changed.still - scene)  # Without noise, of which a filter takes.
    of_scene = changed.still - scene - curve.step(scene)
    of_noise = other - same - curve.step(same) - of_scene
    added = of_scene + cv2.filter2D(of_noise, -1, _kernel(more))
    return _rounded(filtered + curve.step(filtered) + added, ceiling)


def _rounded(image: Image, ceiling: float) -> Image:
    return np.clip(np.rint(image), 0, ceiling)


def known(levels: tuple[NDArray, NDArray], without: Exposed) -> tuple[list[Known], list[Known]]:
    """What captured and simulated pairs tell without an effect, of left and right images.

    Args:
        levels: of captured left and right images (n, h, w) [DN].
        without: simulated pairs, as many or more, with the noise that those with an effect have.
    """
    left, right = (
        [
            Known(*map(_single, (image, own[side], without.still[side])))
            for image, own in zip(images, without.pairs, strict=False)
        ]
        for side, images in enumerate(levels)
    )
    return left, right


def pairs_laid_on(
    without: tuple[list[Known], list[Known]], changed: Exposed, *, ceiling: float
) -> tuple[list[Image], list[Image]]:
    """Lay what an effect does to simulated pairs onto captured ones.

    Args:
        without: of left and right images.
        changed: simulated with it, as many pairs or more.
        ceiling: largest code.

    Returns:
        Of left and right images.
    """

    def of(side: int) -> list[Image]:
        still = _single(changed.still[side])
        made = [Changed(_single(pair[side]), still) for pair in changed.pairs]
        each = zip(without[side], made, strict=False)
        return [laid_on(one, by, ceiling=ceiling) for one, by in each]

    return of(0), of(1)


def _single(image: NDArray) -> Image:
    return image.astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    """A part of an image, which has a filter of its own."""

    window: tuple[slice, slice]  # In which that is told,
    place: tuple[slice, slice]  # where it counts, with what filters reach over,
    weight: Image  # and how much there.


@lru_cache(maxsize=1)  # All images of a run have one shape.
def _blocks(shape: tuple[int, ...]) -> list[_Block]:
    """Blocks whose weights fall off from their middles on and add up to 1."""
    sides = []
    for whole in shape[:2]:
        count = int(np.clip(whole // _LEAST_PX, 1, _BLOCKS))
        edges = np.linspace(0, whole, count + 1).astype(int)
        centres = (edges[:-1] + edges[1:]) / 2
        parts = []
        for row, (first, last) in zip(np.eye(count), itertools.pairwise(edges), strict=True):
            weight = np.interp(np.arange(whole), centres, row)
            inside = np.flatnonzero(weight)
            place = slice(max(inside[0] - _REACH_PX, 0), inside[-1] + 1 + _REACH_PX)
            parts.append((slice(first, last), place, weight[place]))
        sides.append(parts)
    return [
        _Block((rows, columns), (down, across), np.outer(high, wide).astype(np.float32))
        for rows, down, high in sides[0]
        for columns, across, wide in sides[1]
    ]


def _add(out: Image, image: Image, of: _Block, kernel: Image) -> None:
    """Add a block's share of a filtered image; the block's mean is left as it is."""
    mean = float(image[of.window].mean())
    filtered = cv2.filter2D(image[of.place] - mean, -1, kernel)
    out[of.place] += of.weight * (filtered + mean)


@dataclass(frozen=True, slots=True, eq=False)
class _Told:
    """What spectra of one block tell (h, w // 2 + 1)."""

    of_scene: Spectrum  # h, also for the captured image.
    missing: Image  # Power of noise that the image with the effect should have beyond the first's;
    drawn: Image  # that of what h leaves of the simulated noise,
    filtered: Image  # and that of the captured image, filtered.


@dataclass(frozen=True, slots=True, eq=False)
class _Spectra:
    """Of one block's tiles (n, h, w // 2 + 1), after the curve where that comes first."""

    noise: Spectrum  # Simulated without the effect, noise and speckle alone,
    still: Spectrum  # and all but these.
    captured: Image  # Power of the captured block,
    scene: Image  # of the still one,
    drawn: Image  # of noise and speckle,
    share: Image  # what of these the captured one has,
    quiet: Image  # and what of its power is no scene.


def _block_spectra(captured: Image, base: Image, still: Image) -> list[_Spectra]:
    return [
        _of_block(*(one[block.window] for one in (captured, base, still)))
        for block in _blocks(captured.shape)
    ]


def _of_block(captured: Image, base: Image, still: Image) -> _Spectra:
    of_still = _spectra(still)
    noise = _spectra(base) - of_still
    power, drawn = _own(_spectra(captured)), _own(noise)
    share = np.clip(_per_band(power) / (_per_band(drawn) + _LITTLE), 0.0, 1.0)
    quiet = np.minimum(_per_band(power), drawn)
    return _Spectra(noise, of_still, power, _own(of_still), drawn, share, quiet)


def _told(of: _Spectra, other: Spectrum, moved: Spectrum) -> _Told:
    """What one block tells.

    Args:
        of: without the effect.
        other: simulated with it,
        moved: and without noise and speckle too.
    """
    still, noise, scene = of.still, of.noise, of.scene
    moved_scene = _own(moved)
    of_noise = ((noise.conj() * (other - moved)).mean(0) + _LITTLE) / (of.drawn + _LITTLE)
    together = (still.conj() * moved).mean(0)
    alone = np.clip(moved_scene - np.abs(together) ** 2 / (scene + _LITTLE), 0.0, None)
    unsure = _LITTLE + _UNSURE * alone
    # Where the scene tells nothing it is filtered as noise is, but for what is added to that.
    of_scene = (together + unsure * of_noise / np.maximum(1.0, np.abs(of_noise))) / (scene + unsure)
    kept = np.abs(of_scene) ** 2
    added = _own(other - moved) - of.drawn
    added[added < 0] *= of.share[added < 0]  # Noise that is not there cannot be taken.
    return _Told(
        of_scene=of_scene,
        missing=(1 - kept) * of.quiet + added,
        drawn=_own(other - moved - of_scene * noise),
        filtered=kept * of.captured,
    )


def _powers(told: Sequence[_Told]) -> tuple[Spectrum, Spectrum]:
    """Factors (h, w // 2 + 1) of what is left of noise and of what was captured.

    Alike in all blocks and directions, as chance has its part in every single frequency.
    """

    def root(share: Image, least: float, most: float) -> Image:
        centres = 0.5 * (_EDGES[1:] + _EDGES[:-1])
        return np.interp(_RADIUS, centres, np.sqrt(np.clip(share, least**2, most**2)))

    missing, drawn, filtered = (
        _by_band(np.mean([getattr(block, name) for block in told], axis=0))
        for name in ("missing", "drawn", "filtered")
    )
    little = 1e-6 * filtered.mean() + 1e-12
    more = root(missing / (drawn + little), 0.0, _MOST)
    quieter = root(1.0 + np.minimum(missing, 0.0) / (filtered + little), _LEAST, 1.0)
    return more, quieter


def _by_band(power: Image) -> Image:
    found = np.bincount(_BAND, power.ravel(), _BANDS)
    return found / np.bincount(_BAND, minlength=_BANDS)


def _per_band(power: Image) -> Image:
    """Mean over each band, at each of its frequencies."""
    return _by_band(power)[_BAND].reshape(power.shape)


def _own(one: Spectrum) -> Image:
    return np.square(np.abs(one)).mean(0)


def _kernel(response: Spectrum) -> Image:
    kernel = fftshift(irfft2(response, (_TILE_PX, _TILE_PX)))
    middle = slice(_TILE_PX // 2 - _REACH_PX, _TILE_PX // 2 + _REACH_PX + 1)
    return np.ascontiguousarray(kernel[middle, middle][::-1, ::-1])  # filter2D correlates.


def _spectra(image: Image) -> Spectrum:
    """Of tiles (n, h, w // 2 + 1), each less its mean and faded out towards its border."""
    step_px = _TILE_PX // 2
    tiles = sliding_window_view(image, (_TILE_PX, _TILE_PX))[::step_px, ::step_px]
    tiles = tiles.reshape(-1, _TILE_PX, _TILE_PX)
    return np.asarray(rfft2(_WINDOW * (tiles - tiles.mean((1, 2), keepdims=True))))


def _power(image: Image) -> float:
    return float(np.square(image).mean())
