"""What an effect does to a simulated image, laid onto a captured one of the same scene.

A captured image has texture and noise that a simulated one has not, and answers to an effect by
them: blur takes texture away, noise adds to it. So what simulation with and without the effect
differ by is taken apart, into what is done to whatever image is there, which the captured one gets
as well, and what is put on top:

    with = t(h * without) + r

h is a filter, told block by block, as what shifts or blurs may differ over the image; t the mean
level that goes with each level; r the rest. What is done to the scene is not what is done to noise
and speckle, which a lens does not blur. So both are told apart: the scene's filter by images that
are simulated without noise and speckle, theirs by what that leaves of the others. A captured image
is filtered as the scene is; what that takes of its noise, of which it has as much as simulation has
or all that is there, comes back as other noise.

Noise that one adds in quadrature to noise that is there makes images with the same draws differ by
less than it adds. What the image with the effect should have of power beyond h's and r's is made up
for by noise of its own; where it should have less, r and the captured image lose that.

Where a curve alone makes the one with the effect of the one without, that comes first: a filter
would take its mean slope for its own, and levels of a captured image may lie beyond the simulated.

Codes are rounded after all that is done to them. That noise is what it was before: so simulated
images are taken without it, and powers are compared of their whole codes.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.fft import fftfreq, fftshift, irfft2, rfft2, rfftfreq
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

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
_ROUNDING = float((_WINDOW**2).sum()) / 12  # Power of the noise of whole codes.
_LITTLE = 1e-4 * _ROUNDING  # Power too weak to tell of anything.
_UNSURE = 0.05  # Share of what is no filter's doing that what tells of one has to be above.
_BANDS = 8  # In which powers are compared,
_RADIUS = np.hypot(fftfreq(_TILE_PX)[:, None], rfftfreq(_TILE_PX)[None])  # [1 / px]
_EDGES = np.linspace(0.0, _RADIUS.max() + 1e-9, _BANDS + 1)  # by how fine they are.
_BAND = (np.digitize(_RADIUS, _EDGES) - 1).ravel()
_ENDS = (0.001, 0.004, 0.015)
# Of the pixels, up to which a curve's bins reach.
_SHARES = np.sort([*np.linspace(0, 1, 25), *_ENDS, *(1 - np.array(_ENDS))])
_POINTWISE = 0.02  # Share of a change's power that a curve leaves where it is all there is.


@dataclass(frozen=True, slots=True, eq=False)
class Simulated:
    """Images (h, w) of one scene and one imager [DN], not rounded."""

    without: Image  # The effect.
    changed: Image  # With it, by the same noise.
    still: Image  # Without it, noise and speckle,
    still_changed: Image  # and with it alone.
    noise: Image  # Speckle and rounding of one image without it, others than theirs.


@dataclass(frozen=True, slots=True, eq=False)
class Exposed:
    """Simulated pairs of one scene, not rounded."""

    pairs: Sequence[Pair]
    still: Pair  # Without noise and speckle.


def laid_on(captured: NDArray, simulated: Simulated, *, ceiling: float) -> NDArray:
    """Lay what an effect does to one image onto another.

    Args:
        captured: (h, w) codes, without the effect.
        simulated: what the effect does.
        ceiling: largest code.

    Returns:
        (h, w) [DN] float32; not rounded again, as the captured codes are.
    """
    if np.array_equal(simulated.without, simulated.changed):
        return captured.astype(np.float32)
    made = (simulated.without, simulated.changed, simulated.still, simulated.still_changed)
    seen, noise = (one.astype(np.float32) for one in (captured, simulated.noise))
    base, other, still, moved = (one.astype(np.float32) for one in made)
    codes, changed_codes = np.rint(base), np.rint(other)
    bend = _curve(base, other - base)
    if _power(other - bend.of(base)) < _POINTWISE * _power(other - base):
        seen, codes = (bend.of(_between_codes(one)) for one in (seen, codes))
        base, still = bend.of(base), bend.of(still)
    images = _Images(seen, base, other, still, moved, codes, changed_codes)
    blocks = _blocks(seen.shape)
    told = [_told(images.within(of.window)) for of in blocks]
    more, less, quieter = _powers(told, noise)
    filtered, same = np.zeros_like(seen), np.zeros_like(base)
    for of, by in zip(blocks, told, strict=True):
        _add(filtered, seen, of, _kernel(by.response * quieter))
        _add(same, base, of, _kernel(by.simulated))
    curve = _curve(same, other - same)
    rest = other - same - curve.step(same)
    rest = cv2.filter2D(rest, -1, _kernel(less)) + cv2.filter2D(noise, -1, _kernel(more))
    laid = filtered + curve.step(filtered) + rest
    return np.clip(laid, 0, ceiling).astype(np.float32)


def pairs_laid_on(
    captured: tuple[NDArray, NDArray], without: Exposed, changed: Exposed, *, ceiling: float
) -> list[Image]:
    """Lay what an effect does to simulated pairs onto captured ones.

    Args:
        captured: left and right images (n, h, w), codes.
        without: simulated without the effect; twice as many as with it, the first of them by the
            same noise and speckle, the others by others.
        changed: simulated with it, n or more.
        ceiling: largest code.

    Returns:
        Left and right images (n, h, w) as of `laid_on`.
    """
    frames = len(changed.pairs)
    parts = without.pairs[:frames], without.pairs[frames:]
    laid = []
    for side, images in enumerate(captured):
        simulated = [
            Simulated(
                without=own[side],
                changed=one[side],
                still=without.still[side],
                still_changed=changed.still[side],
                noise=np.rint(another[side]) - without.still[side],
            )
            for own, another, one in zip(*parts, changed.pairs, strict=True)
        ]
        each = zip(images, simulated, strict=False)  # There may be fewer captured.
        laid.append(np.stack([laid_on(image, of, ceiling=ceiling) for image, of in each]))
    return laid


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    """A part of an image, which has a filter of its own."""

    window: tuple[slice, slice]  # In which that is told,
    place: tuple[slice, slice]  # where it counts, with what filters reach over,
    weight: Image  # and how much there.


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

    response: Spectrum  # h for the captured image
    simulated: Spectrum  # and for the simulated one.
    missing: Image  # Power that the image with the effect should have beyond the first's,
    rest: Image  # that of what h leaves of the simulated one,
    filtered: Image  # and that of the captured image, filtered.


@dataclass(frozen=True, slots=True, eq=False)
class _Images:
    """Images (h, w) [DN], after the curve where that comes first."""

    captured: Image
    base: Image  # Simulated without the effect,
    other: Image  # with it,
    still: Image  # without it, noise and speckle,
    moved: Image  # with it, without these;
    codes: Image  # the first
    changed_codes: Image  # and the second rounded.

    def within(self, window: tuple[slice, slice]) -> _Images:
        return _Images(*(getattr(self, name)[window] for name in self.__slots__))


def _told(of: _Images) -> _Told:
    seen, base, other, still, moved = (
        _spectra(one) for one in (of.captured, of.base, of.other, of.still, of.moved)
    )
    captured, power, after, scene, moved_scene = map(_own, (seen, base, other, still, moved))
    noise, changed = base - still, other - moved
    drawn = _own(noise)
    # Noise and speckle with what rounding adds, before the effect and after.
    rounded = np.clip(_own(_spectra(of.codes)) - scene, _LITTLE, None)
    since = np.clip(_own(_spectra(of.changed_codes)) - moved_scene, 0.0, None)
    of_noise = (_mean(noise, changed) + _ROUNDING) / (drawn + _ROUNDING)
    together = _mean(still, moved)
    alone = np.clip(moved_scene - np.abs(together) ** 2 / (scene + _LITTLE), 0.0, None)
    unsure = _LITTLE + _UNSURE * alone
    of_scene = (together + unsure * of_noise) / (scene + unsure)
    share = np.clip(_by_band(captured) / _by_band(rounded), 0.0, 1.0)[_BAND].reshape(scene.shape)
    quiet = np.minimum(captured, share * rounded)  # Of the captured power what is no scene.
    simulated = (of_scene * scene + of_noise * drawn) / (scene + drawn + _LITTLE)
    kept = np.abs(of_scene) ** 2
    added = since - rounded
    added[added < 0] *= share[added < 0]  # Noise that is not there cannot be taken.
    added += moved_scene - kept * scene  # What no filter makes of the scene.
    cross = _mean(base, other)
    return _Told(
        response=of_scene,
        simulated=simulated,
        missing=(1 - kept) * quiet + added,
        rest=after - 2 * (simulated.conj() * cross).real + np.abs(simulated) ** 2 * power,
        filtered=kept * captured,
    )


def _powers(told: Sequence[_Told], noise: Image) -> tuple[Spectrum, Spectrum, Spectrum]:
    """Factors (h, w // 2 + 1) of noise, of the rest and of the captured image, alike in all blocks
    and directions, as chance has its part in every single frequency.
    """

    def root(share: Image, least: float, most: float) -> Image:
        centres = 0.5 * (_EDGES[1:] + _EDGES[:-1])
        return np.interp(_RADIUS, centres, np.sqrt(np.clip(share, least**2, most**2)))

    missing, rest, filtered = (
        _by_band(np.mean([getattr(block, name) for block in told], axis=0))
        for name in ("missing", "rest", "filtered")
    )
    of_noise = _spectra(noise)
    there = _by_band(_own(of_noise))
    little = 1e-6 * filtered.mean() + 1e-12
    return (
        root((missing - rest) / (there + little), 0.0, _MOST),
        root(missing / (rest + little), 0.0, 1.0),
        root(1.0 + np.minimum(missing, 0.0) / (filtered + little), _LEAST, 1.0),
    )


def _by_band(power: Image) -> Image:
    found = np.bincount(_BAND, power.ravel(), _BANDS)
    return found / np.bincount(_BAND, minlength=_BANDS)


def _mean(one: Spectrum, other: Spectrum) -> Spectrum:
    return (one.conj() * other).mean(0)


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
    return rfft2(_WINDOW * (tiles - tiles.mean((1, 2), keepdims=True)))


def _between_codes(image: Image) -> Image:
    """Levels spread evenly over their codes: a curve would leave gaps between whole ones."""
    rng = np.random.default_rng(0)
    return image + rng.uniform(-0.5, 0.5, image.shape).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class _Curve:
    """Mean change by level."""

    levels: Image  # Rising.
    change: Image

    def step(self, image: Image) -> Image:
        """Change of each pixel; beyond the levels that of the last."""
        return np.interp(image, self.levels, self.change).astype(np.float32)

    def of(self, image: Image) -> Image:
        """The image changed; beyond the levels the curve goes on as it ends."""
        if len(self.levels) == 1:
            return image + self.step(image)
        inside = np.clip(image, self.levels[0], self.levels[-1])
        rise = np.diff(self.change) / np.diff(self.levels)
        beyond = np.where(image < inside, 1 + rise[0], 1 + rise[-1]) * (image - inside)
        return (inside + self.step(inside) + beyond).astype(np.float32)


def _curve(levels: Image, change: Image) -> _Curve:
    """Told in bins of equal shares of the pixels, and a few of the darkest and the brightest."""
    ends = np.quantile(levels, _SHARES)
    which = np.clip(np.searchsorted(ends, levels.ravel(), side="right") - 1, 0, len(ends) - 2)
    count = np.bincount(which, minlength=len(ends) - 1)
    known = count > 0
    at, mean = (
        np.bincount(which, one.ravel(), len(ends) - 1)[known] / count[known]
        for one in (levels, change)
    )
    return _Curve(at, mean)


def _power(image: Image) -> float:
    return float(np.var(image))
