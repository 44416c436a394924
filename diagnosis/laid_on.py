"""What an effect does to a simulated image, laid onto a captured one of the same scene.

A captured image has texture and noise that a simulated one has not, and answers to an effect by
them: blur takes texture away, noise adds to it. So what simulation with and without the effect
differ by is taken apart, into what is done to whatever image is there, which the captured one gets
as well, and what is put on top:

    with = t(h * without) + r

h is a filter, told block by block, as what shifts or blurs may differ over the image; t the mean
level that goes with each level; r the rest. Both simulated images have the same noise, and what is
done to that is not what is done to the scene: a lens blurs one alone. So h is the cross-spectrum of
the one with the effect and a third, without it and of other noise, over that third's with the one
without (Bendat and Piersol, Random Data, 4th ed. 2010, section 7.1, where noise is only in what is
measured), and where the scene has nothing to tell h by, what is done to noise.

Noise that one adds in quadrature to noise that is there makes images with the same draws differ by
less than it adds. What the image with the effect has of power, frequency by frequency, beyond h's
and r's is made up for by noise of its own; where it has less, r and the captured image lose that.

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
_SURE = 1e-3  # Share of the mean power below which a frequency keeps what it has.
_NOISE = 0.3  # Share of the noise's power that what tells of the scene has to be above.
_MOST = 4.0  # Times the noise that is added,
_LEAST = 0.2  # and share of the captured image that is left at least.
_WINDOW = np.outer(np.hanning(_TILE_PX), np.hanning(_TILE_PX)).astype(np.float32)
_ROUNDING = float((_WINDOW**2).sum()) / 12  # Power of the noise of whole codes.
_BANDS = 8  # In which powers are compared,
_RADIUS = np.hypot(fftfreq(_TILE_PX)[:, None], rfftfreq(_TILE_PX)[None])  # [1 / px]
_EDGES = np.linspace(0.0, _RADIUS.max() + 1e-9, _BANDS + 1)  # by how fine they are.
_BAND = (np.digitize(_RADIUS, _EDGES) - 1).ravel()
_ENDS = (0.001, 0.004, 0.015)
_SHARES = np.sort(
    [*np.linspace(0, 1, 25), *_ENDS, *(1 - np.array(_ENDS))]
)  # Of pixels, in a curve.
_POINTWISE = 0.02  # Share of a change's power that a curve leaves where it is all there is.


@dataclass(frozen=True, slots=True, eq=False)
class Simulated:
    """Images (h, w) of one scene and one imager [DN], not rounded."""

    without: Image  # The effect.
    again: Image  # Likewise, by other noise.
    changed: Image  # With the effect, by the first one's noise.
    noise: Image  # Of one image without it, another than theirs.


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
    made = (simulated.without, simulated.again, simulated.changed, simulated.noise)
    seen, base, again, other, noise = (one.astype(np.float32) for one in (captured, *made))
    whole, wanted = np.rint(base), np.rint(other)
    bend = _curve(base, other - base)
    if _power(other - bend.of(base)) < _POINTWISE * _power(other - base):
        seen, whole = (bend.of(_between_codes(one)) for one in (seen, whole))
        base, again = bend.of(base), bend.of(again)
    images = (seen, base, again, other, whole, wanted)
    blocks = _blocks(seen.shape)
    told = [_told(*(one[of.window] for one in images)) for of in blocks]
    more, less, quieter = _powers(told, noise)
    filtered, same = np.zeros_like(seen), np.zeros_like(base)
    for of, by in zip(blocks, told, strict=True):
        _add(filtered, seen, of, _kernel(by.response * quieter))
        _add(same, base, of, _kernel(by.response))
    curve = _curve(same, other - same)
    rest = other - same - curve.step(same)
    rest = cv2.filter2D(rest, -1, _kernel(less)) + cv2.filter2D(noise, -1, _kernel(more))
    laid = filtered + curve.step(filtered) + rest
    return np.clip(laid, 0, ceiling).astype(np.float32)


def pairs_laid_on(
    captured: tuple[NDArray, NDArray],
    without: Sequence[Pair],
    changed: Sequence[Pair],
    *,
    ceiling: float,
) -> list[Image]:
    """Lay what an effect does to simulated pairs onto captured ones.

    Args:
        captured: left and right images (n, h, w), codes.
        without: simulated without the effect; four times as many as with it, the first of them by
            the same noise.
        changed: simulated with it, n or more.
        ceiling: largest code.

    Returns:
        Left and right images (n, h, w) as of `laid_on`.
    """
    frames = len(changed)
    parts = [without[first : first + frames] for first in range(0, len(without), frames)]
    laid = []
    for side, images in enumerate(captured):
        simulated = [
            Simulated(
                without=own[side],
                again=again[side],
                changed=one[side],
                noise=(third[side] - fourth[side]) / np.float32(np.sqrt(2)),
            )
            for own, again, third, fourth, one in zip(*parts, changed, strict=True)
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

    response: Spectrum  # h.
    missing: Spectrum  # Power that the image with the effect has beyond h's,
    rest: Spectrum  # that of what h leaves,
    filtered: Spectrum  # and that of the captured image, filtered.


def _told(
    seen: Image, base: Image, again: Image, other: Image, whole: Image, wanted: Image
) -> _Told:
    of_seen, of_base, of_again, of_other, of_whole, of_wanted = map(
        _spectra, (seen, base, again, other, whole, wanted)
    )
    power, after, there, before, codes = (
        _mean(one, one).real for one in (of_base, of_other, of_seen, of_whole, of_wanted)
    )
    little = _SURE * power.mean() + 1e-12
    cross = _mean(of_base, of_other)
    of_noise = (cross + _ROUNDING) / (power + _ROUNDING)
    scene = _mean(of_again, of_base)
    unsure = (_NOISE * np.clip(power - scene.real, 0.0, None) + little) ** 2
    changed = _mean(of_again, of_other)
    response = (scene.conj() * changed + unsure * of_noise) / (np.abs(scene) ** 2 + unsure)
    kept = np.abs(response) ** 2
    return _Told(
        response=response,
        missing=codes - kept * before,
        rest=after - 2 * (response.conj() * cross).real + kept * power,
        filtered=kept * there,
    )


def _powers(told: Sequence[_Told], noise: Image) -> tuple[Spectrum, Spectrum, Spectrum]:
    """Factors (h, w // 2 + 1) of noise, of the rest and of the captured image, alike in all blocks
    and directions, as chance has its part in every single frequency.
    """

    def by_band(power: Spectrum) -> Image:
        found = np.bincount(_BAND, np.asarray(power).ravel(), _BANDS)
        return found / np.bincount(_BAND, minlength=_BANDS)

    def root(share: Image, least: float, most: float) -> Image:
        centres = 0.5 * (_EDGES[1:] + _EDGES[:-1])
        return np.interp(_RADIUS, centres, np.sqrt(np.clip(share, least**2, most**2)))

    missing, rest, filtered = (
        by_band(np.mean([getattr(block, name) for block in told], axis=0))
        for name in ("missing", "rest", "filtered")
    )
    of_noise = _spectra(noise)
    there = by_band(_mean(of_noise, of_noise).real)
    little = 1e-6 * filtered.mean() + 1e-12
    return (
        root((missing - rest) / (there + little), 0.0, _MOST),
        root(missing / (rest + little), 0.0, 1.0),
        root(1.0 + np.minimum(missing, 0.0) / (filtered + little), _LEAST, 1.0),
    )


def _mean(one: Spectrum, other: Spectrum) -> Spectrum:
    return (one.conj() * other).mean(0)


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
