"""Effect transfer: apply a simulated effect to a captured image of the same scene.

A captured image has texture and noise that the simulated image lacks, and an effect acts on both:
blur removes texture, for example. The simulated change is therefore split into a filter and a tone
curve, which are also applied to the captured image, and an additive residual:

    with_effect = t(h * without_effect) + r

Here h is a linear filter, t is a tone curve, and r is the residual. Filters are estimated block by
block, because shift and blur vary over the image. Noise and speckle do not pass through the lens,
so h is estimated from images simulated without them. The residual has two parts: r_scene, what h
leaves of the scene, and r_noise, what h leaves of noise and speckle. If an effect does not change
the noise, r_noise restores what h removes of it.

The two simulations share their noise. If an effect adds noise in quadrature, their difference has
less power than the added noise. So r_noise is amplified in frequency bands until the power is
right, and its spatial distribution is kept. If noise must decrease, the captured image is
attenuated instead.

If a tone curve alone explains the change, it is applied first. A filter would only take its mean
slope. Moreover, levels of the captured image may lie outside the simulated range.

All steps act on dequantised levels of the captured image (`dequantise`), which are rounded at the
end. The image without the effect is rounded from the same levels, so that both have equal noise.
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

_TILE_PX = 32  # Side of the tiles of the spectra.
_REACH_PX = 8  # Radius of the filters.
_BLOCKS = 4  # Largest number of blocks along each side; each block has its own filter.
_LEAST_PX = 3 * _TILE_PX  # Least side of a block.
_MOST_GAIN = 16.0  # Upper limit of the amplification of r_noise.
_LEAST_GAIN = 0.2  # Lower limit of the attenuation of the captured image.
_WINDOW = np.outer(np.hanning(_TILE_PX), np.hanning(_TILE_PX)).astype(np.float32)
_LITTLE = 1e-4 * float((_WINDOW**2).sum())  # Power of the finest bits: too weak to use.
_INCOHERENT = 0.05  # Regularisation: share of incoherent power added to the filter's denominator.
_BANDS = 8  # Number of radial frequency bands in which powers are compared.
_RADIUS = np.hypot(fftfreq(_TILE_PX)[:, None], rfftfreq(_TILE_PX)[None])  # Frequency [1 / px].
_EDGES = np.linspace(0.0, _RADIUS.max() + 1e-9, _BANDS + 1)  # Limits of the bands [1 / px].
_BAND = (np.digitize(_RADIUS, _EDGES) - 1).ravel()
_POINTWISE = 0.02  # Share of a change's power that a sufficient tone curve leaves.


@dataclass(frozen=True, eq=False)
class TransferBase:
    """Images (h, w) [DN] of one scene and one imager without the effect."""

    levels: Image  # Captured, dequantised (see `dequantise`).
    simulated: Image  # Not rounded.
    noiseless: Image  # Simulated without noise and speckle, not rounded.

    @cached_property
    def spectra(self) -> list[_BlockSpectra]:
        """Spectra of each block."""
        return _all_block_spectra(self.levels, self.simulated, self.noiseless)


@dataclass(frozen=True, slots=True, eq=False)
class EffectImages:
    """Images (h, w) [DN] simulated with an effect, not rounded."""

    simulated: Image  # With the same noise as `TransferBase.simulated`.
    noiseless: Image  # Without noise and speckle.


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedPairs:
    """Simulated pairs of one scene, not rounded."""

    pairs: Sequence[Pair]
    noiseless: Pair  # Without noise and speckle.


def transfer_effect(base: TransferBase, effect: EffectImages, *, ceiling: float) -> Image:
    """Apply the effect that a simulation shows to a captured image.

    Args:
        base: captured image, and simulation without the effect.
        effect: simulation with the effect.
        ceiling: largest code.

    Returns:
        (h, w) whole codes [DN].
    """
    level, without, scene = base.levels, base.simulated, base.noiseless
    changed = effect.simulated
    if np.array_equal(without, changed):
        return _quantise(level, ceiling)
    spectra = None
    pointwise = tone_curve.fit_tone_curve(without, changed - without)
    if _power(changed - pointwise.apply(without)) < _POINTWISE * _power(changed - without):
        level, without, scene = (pointwise.apply(image) for image in (level, without, scene))
        spectra = _all_block_spectra(level, without, scene)
    blocks = _blocks(level.shape)
    responses = [
        _response(
            of_base, *(_spectra(image[block.window]) for image in (changed, effect.noiseless))
        )
        for block, of_base in zip(blocks, spectra or base.spectra, strict=True)
    ]
    amplify, attenuate = _noise_gains(responses)
    filtered_level, filtered, filtered_scene = (np.zeros_like(level) for _ in range(3))
    for block, response in zip(blocks, responses, strict=True):
        kernel = _kernel(response.scene_filter)
        _add(filtered_level, level, block, _kernel(response.scene_filter * attenuate))
        _add(filtered, without, block, kernel)
        _add(filtered_scene, scene, block, kernel)
    # The change is noiseless, because the filter removes noise, which would bias the curve.
    curve = tone_curve.fit_tone_curve(filtered, effect.noiseless - filtered_scene)
    r_scene = effect.noiseless - filtered_scene - curve.change_at(filtered_scene)
    r_noise = changed - filtered - curve.change_at(filtered) - r_scene
    residual = r_scene + cv2.filter2D(r_noise, -1, _kernel(amplify))
    return _quantise(filtered_level + curve.change_at(filtered_level) + residual, ceiling)


def _quantise(image: Image, ceiling: float) -> Image:
    return np.clip(np.rint(image), 0, ceiling)


def transfer_bases(
    levels: tuple[NDArray, NDArray], without: SimulatedPairs
) -> tuple[list[TransferBase], list[TransferBase]]:
    """Combine captured and simulated pairs without an effect.

    Args:
        levels: dequantised left and right captured images (n, h, w) [DN].
        without: at least n simulated pairs, with the noise that those with effects share.

    Returns:
        Bases of the left and of the right images.
    """
    left, right = (
        [
            TransferBase(*map(_single, (image, pair[side], without.noiseless[side])))
            for image, pair in zip(images, without.pairs, strict=False)
        ]
        for side, images in enumerate(levels)
    )
    return left, right


def transfer_pairs(
    bases: tuple[list[TransferBase], list[TransferBase]], effect: SimulatedPairs, *, ceiling: float
) -> tuple[list[Image], list[Image]]:
    """Apply the effect that simulated pairs show to captured pairs.

    Args:
        bases: bases of the left and right images.
        effect: at least as many pairs simulated with the effect.
        ceiling: largest code.

    Returns:
        Left and right images.
    """

    def transfer_side(side: int) -> list[Image]:
        noiseless = _single(effect.noiseless[side])
        images = [EffectImages(_single(pair[side]), noiseless) for pair in effect.pairs]
        matching = zip(bases[side], images, strict=False)
        return [transfer_effect(base, changed, ceiling=ceiling) for base, changed in matching]

    return transfer_side(0), transfer_side(1)


def _single(image: NDArray) -> Image:
    return image.astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    """A part of an image that has its own filter."""

    window: tuple[slice, slice]  # Region in which the filter is estimated.
    place: tuple[slice, slice]  # Region of non-zero weight, extended by the filter's reach.
    weight: Image  # Weight of the filter in `place`.


@lru_cache(maxsize=1)  # All images of a run have one shape.
def _blocks(shape: tuple[int, ...]) -> list[_Block]:
    """Divide an image into blocks; weights fall linearly from their centres and sum to 1."""
    sides = []
    for length in shape[:2]:
        count = int(np.clip(length // _LEAST_PX, 1, _BLOCKS))
        edges = np.linspace(0, length, count + 1).astype(int)
        centres = (edges[:-1] + edges[1:]) / 2
        parts = []
        for row, (first, last) in zip(np.eye(count), itertools.pairwise(edges), strict=True):
            weight = np.interp(np.arange(length), centres, row)
            inside = np.flatnonzero(weight)
            place = slice(max(inside[0] - _REACH_PX, 0), inside[-1] + 1 + _REACH_PX)
            parts.append((slice(first, last), place, weight[place]))
        sides.append(parts)
    return [
        _Block((rows, columns), (down, across), np.outer(high, wide).astype(np.float32))
        for rows, down, high in sides[0]
        for columns, across, wide in sides[1]
    ]


def _add(out: Image, image: Image, block: _Block, kernel: Image) -> None:
    """Add a block's share of a filtered image; the filter keeps the block's mean."""
    mean = float(image[block.window].mean())
    filtered = cv2.filter2D(image[block.place] - mean, -1, kernel)
    out[block.place] += block.weight * (filtered + mean)


@dataclass(frozen=True, slots=True, eq=False)
class _BlockResponse:
    """Response of one block to an effect, by frequency (h, w // 2 + 1)."""

    scene_filter: Spectrum  # h, also for the captured image.
    missing: Image  # Noise power that the filtered captured image lacks; negative: has too much.
    residual: Image  # Power that h leaves of the simulated noise.
    filtered: Image  # Power of the captured image, filtered by h.


@dataclass(frozen=True, slots=True, eq=False)
class _BlockSpectra:
    """Spectra of one block without the effect (tiles, h, w // 2 + 1) and their mean powers."""

    noise: Spectrum  # Simulated noise and speckle.
    scene: Spectrum  # Simulated image without them.
    captured_power: Image
    scene_power: Image
    noise_power: Image
    noise_share: Image  # Share of the simulated noise power that the captured image has.
    captured_noise: Image  # Power of the captured image that is noise.


def _all_block_spectra(captured: Image, simulated: Image, noiseless: Image) -> list[_BlockSpectra]:
    return [
        _block_spectra(*(image[block.window] for image in (captured, simulated, noiseless)))
        for block in _blocks(captured.shape)
    ]


def _block_spectra(captured: Image, simulated: Image, noiseless: Image) -> _BlockSpectra:
    scene = _spectra(noiseless)
    noise = _spectra(simulated) - scene
    power, noise_power = _mean_power(_spectra(captured)), _mean_power(noise)
    share = np.clip(_band_mean(power) / (_band_mean(noise_power) + _LITTLE), 0.0, 1.0)
    captured_noise = np.minimum(_band_mean(power), noise_power)
    return _BlockSpectra(
        noise, scene, power, _mean_power(scene), noise_power, share, captured_noise
    )


def _response(base: _BlockSpectra, simulated: Spectrum, noiseless: Spectrum) -> _BlockResponse:
    """Estimate one block's response.

    Args:
        base: spectra without the effect.
        simulated: spectrum with the effect.
        noiseless: spectrum with the effect, without noise and speckle.
    """
    scene, noise, power = base.scene, base.noise, base.scene_power
    changed_power = _mean_power(noiseless)
    noise_filter = ((noise.conj() * (simulated - noiseless)).mean(0) + _LITTLE) / (
        base.noise_power + _LITTLE
    )
    cross = (scene.conj() * noiseless).mean(0)
    incoherent = np.clip(changed_power - np.abs(cross) ** 2 / (power + _LITTLE), 0.0, None)
    regularisation = _LITTLE + _INCOHERENT * incoherent
    # Where the scene has no power, h is the noise's filter, limited to a gain of 1.
    scene_filter = (
        cross + regularisation * noise_filter / np.maximum(1.0, np.abs(noise_filter))
    ) / (power + regularisation)
    gain = np.abs(scene_filter) ** 2
    added = _mean_power(simulated - noiseless) - base.noise_power
    # Only noise that the captured image has can be removed.
    added[added < 0] *= base.noise_share[added < 0]
    return _BlockResponse(
        scene_filter=scene_filter,
        missing=(1 - gain) * base.captured_noise + added,
        residual=_mean_power(simulated - noiseless - scene_filter * noise),
        filtered=gain * base.captured_power,
    )


def _noise_gains(responses: Sequence[_BlockResponse]) -> tuple[Spectrum, Spectrum]:
    """Compute gains (h, w // 2 + 1) that amplify r_noise and attenuate the captured image.

    They are averaged over blocks and directions, because single frequencies are too noisy.
    """

    def gain(share: Image, least: float, most: float) -> Image:
        centres = 0.5 * (_EDGES[1:] + _EDGES[:-1])
        return np.interp(_RADIUS, centres, np.sqrt(np.clip(share, least**2, most**2)))

    missing, residual, filtered = (
        _by_band(np.mean([getattr(response, name) for response in responses], axis=0))
        for name in ("missing", "residual", "filtered")
    )
    little = 1e-6 * filtered.mean() + 1e-12
    amplify = gain(missing / (residual + little), 0.0, _MOST_GAIN)
    attenuate = gain(1.0 + np.minimum(missing, 0.0) / (filtered + little), _LEAST_GAIN, 1.0)
    return amplify, attenuate


def _by_band(power: Image) -> Image:
    """Average power over each radial band (band,)."""
    total = np.bincount(_BAND, power.ravel(), _BANDS)
    return total / np.bincount(_BAND, minlength=_BANDS)


def _band_mean(power: Image) -> Image:
    """Replace each frequency's power by the mean of its band."""
    return _by_band(power)[_BAND].reshape(power.shape)


def _mean_power(spectra: Spectrum) -> Image:
    """Average power over tiles."""
    return np.square(np.abs(spectra)).mean(0)


def _kernel(response: Spectrum) -> Image:
    """Convert a frequency response to a truncated kernel for `cv2.filter2D`."""
    kernel = fftshift(irfft2(response, (_TILE_PX, _TILE_PX)))
    middle = slice(_TILE_PX // 2 - _REACH_PX, _TILE_PX // 2 + _REACH_PX + 1)
    return np.ascontiguousarray(kernel[middle, middle][::-1, ::-1])  # filter2D correlates.


def _spectra(image: Image) -> Spectrum:
    """Compute spectra of windowed tiles less their means (tiles, h, w // 2 + 1)."""
    step_px = _TILE_PX // 2
    tiles = sliding_window_view(image, (_TILE_PX, _TILE_PX))[::step_px, ::step_px]
    tiles = tiles.reshape(-1, _TILE_PX, _TILE_PX)
    return np.asarray(rfft2(_WINDOW * (tiles - tiles.mean((1, 2), keepdims=True))))


def _power(image: Image) -> float:
    return float(np.square(image).mean())
