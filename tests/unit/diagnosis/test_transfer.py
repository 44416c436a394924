"""Transfer of simulated effects onto images with texture that the simulation lacks."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from starling.diagnosis.transfer import dequantise
from starling.diagnosis.transfer.transfer import (
    EffectImages,
    SimulatedPairs,
    TransferBase,
    transfer_bases,
    transfer_effect,
    transfer_pairs,
)

SHAPE = (240, 640)
Do = Callable[[np.ndarray, np.random.Generator | None], np.ndarray]


def scene(texture: float) -> np.ndarray:
    """Draw dots on a background with or without texture."""
    rng = np.random.default_rng(1)
    dots = np.zeros(SHAPE)
    dots[rng.integers(0, SHAPE[0], 3000), rng.integers(0, SHAPE[1], 3000)] = 300
    rough = cv2.GaussianBlur(rng.standard_normal(SHAPE), (0, 0), 2)
    return 30 + cv2.GaussianBlur(dots, (0, 0), 1.0) + 40 * texture * rough


def blurred(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), 0.7) + noise(rng)


def lower(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
    size = (SHAPE[1], SHAPE[0])
    shift = np.array([[1, 0, 0], [0, 1, 0.5]])
    return cv2.warpAffine(image, shift, size, flags=cv2.INTER_CUBIC) + noise(rng)


def smoothed(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
    return cv2.GaussianBlur(image + noise(rng), (0, 0), 0.6)


def noisier(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
    return image + noise(rng) + 2 * noise(rng)


def brighter(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
    return 255 * (np.clip(image + noise(rng), 0, 255) / 255) ** (1 / 1.3)


def slightly_brighter(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
    return 255 * (np.clip(image + noise(rng), 0, 255) / 255) ** (1 / 1.002)


def plain(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
    return image + noise(rng)


def noise(rng: np.random.Generator | None) -> np.ndarray:
    return np.zeros(SHAPE) if rng is None else 2 * rng.standard_normal(SHAPE)


def capture(texture: float, do: Do, seed: int) -> np.ndarray:
    return np.rint(exact(texture, do, seed)).astype(np.uint8)


def exact(texture: float, do: Do, seed: int | None) -> np.ndarray:
    rng = None if seed is None else np.random.default_rng(seed)
    return np.clip(do(scene(texture), rng), 0, 255).astype(np.float32)


@dataclasses.dataclass(frozen=True)
class Simulated:
    """Simulated images without texture, before and after an effect."""

    simulated: np.ndarray
    noiseless: np.ndarray
    effect: EffectImages


def simulate(do: Do) -> Simulated:
    effect = EffectImages(exact(0.0, do, 7), exact(0.0, do, None))
    return Simulated(exact(0.0, plain, 7), exact(0.0, plain, None), effect)


def transfer(captured: np.ndarray, images: Simulated) -> np.ndarray:
    base = TransferBase(dequantise.draw_levels(captured), images.simulated, images.noiseless)
    return transfer_effect(base, images.effect, ceiling=255)


def requantise(captured: np.ndarray) -> np.ndarray:
    """Return the image that the transfer gives without any effect."""
    return np.rint(dequantise.draw_levels(captured))


def rms(image: np.ndarray, reference: np.ndarray) -> float:
    return float(np.sqrt(np.mean((image.astype(float) - reference) ** 2)))


def sharpness(image: np.ndarray) -> float:
    return float(np.sqrt(fine_power(image)).mean())


def fine_power(image: np.ndarray) -> np.ndarray:
    return cv2.Laplacian(image.astype(np.float32), cv2.CV_32F) ** 2


@pytest.mark.parametrize("do", [blurred, lower, smoothed, noisier, brighter])
def test_a_textured_image_changes_as_by_the_effect_itself(do: Do):
    """In mean and sharpness; effects without new noise also pixel by pixel."""
    captured, expected = capture(1.0, plain, 5), capture(1.0, do, 5)
    result = transfer(captured, simulate(do))
    np.testing.assert_array_equal(result, np.rint(result))
    assert result.dtype == np.float32
    assert result.mean() == pytest.approx(expected.mean(), rel=0.01)
    assert sharpness(result) == pytest.approx(sharpness(expected), rel=0.04)
    if do in {blurred, lower}:  # A lens does not filter noise, so the transfer restores it.
        noise_after = result - exact(1.0, do, None)
        noise_before = captured - exact(1.0, plain, None)
        assert noise_after.std() == pytest.approx(noise_before.std(), rel=0.05)
    elif do is not noisier:
        error, change = (rms(image, expected) for image in (result, captured))
        assert error < 0.4 * change


def test_a_tone_curve_extends_beyond_the_simulated_levels():
    """Texture has darker pixels than the simulated background."""
    captured, expected = capture(1.0, plain, 5), capture(1.0, brighter, 5)
    result = transfer(captured, simulate(brighter))
    dark = captured <= np.quantile(captured, 0.002)
    bright = captured >= np.quantile(captured, 0.998)
    assert captured[dark].max() < exact(0.0, plain, 7).min()
    assert (expected[dark] - captured[dark].astype(float)).mean() > 10
    assert result[dark].mean() == pytest.approx(expected[dark].mean(), abs=1.5)
    assert result[bright].mean() == pytest.approx(expected[bright].mean(), abs=0.2)


def test_a_tone_curve_leaves_no_empty_codes():
    captured, expected = capture(1.0, plain, 5), capture(1.0, brighter, 5)
    result = np.rint(transfer(captured, simulate(brighter)))
    comb = [_comb(image) for image in (expected, result)]
    assert comb[1] < 1.5 * comb[0]
    curve = 255 * (captured / 255) ** (1 / 1.3)
    assert _comb(np.rint(curve)) > 5 * comb[0]


def test_a_tiny_effect_adds_no_noise():
    """Detection limits depend on the changes by the weakest strengths."""
    captured = capture(1.0, plain, 5)
    change = transfer(captured, simulate(slightly_brighter)) - requantise(captured)
    expected = 255 * (captured / 255) ** (1 / 1.002) - captured
    assert 0.05 < expected.mean() < 0.3
    assert change.mean() == pytest.approx(expected.mean(), abs=0.01)
    assert set(np.unique(change)) == {0, 1}


def test_the_finest_bits_of_an_averaged_image_do_not_define_a_filter():
    """They differ by chance, which would look like an attenuation."""

    def fine(effect: float, seed: int | None) -> np.ndarray:
        glare = effect * np.linspace(0, 1, SHAPE[1])
        image = (1 - effect) * cv2.GaussianBlur(exact(0.0, plain, seed), (0, 0), 0.9) + glare
        return (np.rint(256 * image) / 256).astype(np.float32)

    captured = np.rint(fine(0.0, 5)).astype(np.uint8)
    without, noiseless, *changed = (
        fine(effect, seed) for effect in (0.0, 0.001) for seed in (7, None)
    )
    result = transfer(captured, Simulated(without, noiseless, EffectImages(*changed)))
    least = np.abs(changed[0] - without).mean()
    assert 0.02 < least < 0.06
    assert np.abs(result - requantise(captured)).mean() < 1.5 * least


def test_a_tone_curve_gives_both_images_no_common_pattern():
    """A matcher would find a common pattern at zero disparity where dots are weak."""
    shape = (160, 224)

    def even(seed: int | None, gain: float) -> tuple[np.ndarray, np.ndarray]:
        noise = np.zeros((2, *shape))
        if seed is not None:
            noise = np.random.default_rng(seed).normal(0, 0.3, (2, *shape))
        left, right = (gain * (6.3 + noise)).astype(np.float32)
        return left, right

    left, right = (
        dequantise.draw_levels(np.rint(image).astype(np.uint8)) for image in even(5, 1.0)
    )
    bases = transfer_bases(
        (left[None], right[None]), SimulatedPairs([even(7, 1.0)], even(None, 1.0))
    )
    images = transfer_pairs(bases, SimulatedPairs([even(7, 2.0)], even(None, 2.0)), ceiling=255)
    fine = (side[0] - cv2.GaussianBlur(side[0], (0, 0), 2) for side in images)
    first, second = (image.ravel() for image in fine)
    assert first.std() > 0.3 and second.std() > 0.3
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.05


def _comb(codes: np.ndarray) -> float:
    """Measure how much the frequency of codes differs from that of their neighbours."""
    count = np.bincount(codes.astype(int).ravel())
    return float(np.abs(count[1:-1] - 0.5 * (count[:-2] + count[2:])).sum() / count.sum())


def test_a_lens_blurs_texture_but_no_noise():
    """Texture as fine as noise is separated from it by its power alone."""
    rng = np.random.default_rng(3)
    rough = scene(0.0) + 6 * rng.standard_normal(SHAPE)
    captured, expected = (
        np.clip(np.rint(do(rough, np.random.default_rng(5))), 0, 255).astype(np.uint8)
        for do in (plain, blurred)
    )
    result = transfer(captured, simulate(blurred))
    assert sharpness(expected) < 0.6 * sharpness(captured)
    assert sharpness(result) == pytest.approx(sharpness(expected), rel=0.05)


def test_quantisation_errors_are_those_of_the_textured_image():
    """A wall without texture has one code, so its quantisation error is constant."""
    rng = np.random.default_rng(3)
    texture = cv2.GaussianBlur(rng.standard_normal(SHAPE), (0, 0), 0.7)

    def wall(contrast: float, blur_px: float, seed: int | None) -> np.ndarray:
        image = cv2.GaussianBlur(0.2 + scene(0.0) + 3 * contrast * texture, (0, 0), blur_px)
        if seed is not None:
            image = image + np.random.default_rng(seed).normal(0, 0.2, SHAPE)
        return image.astype(np.float32)

    captured, expected = (np.rint(wall(1.0, px, 5)).astype(np.uint8) for px in (0.05, 1.0))
    without, noiseless, *changed = (wall(0.0, px, seed) for px in (0.05, 1.0) for seed in (7, None))
    result = transfer(captured, Simulated(without, noiseless, EffectImages(*changed)))
    bare = cv2.dilate(wall(0.0, 1.0, None), np.ones((5, 5))) < 30.4
    assert bare.mean() > 0.05
    before, after, transferred = (
        fine_power(image)[bare].mean() for image in (captured, expected, result)
    )
    assert after < 0.4 * before
    assert transferred == pytest.approx(after, rel=0.05)


@pytest.mark.parametrize("blur_px", [0.1, 0.2])
def test_a_tiny_blur_adds_no_noise(blur_px: float):
    def tiny_blur(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
        return cv2.GaussianBlur(image, (0, 0), blur_px) + noise(rng)

    captured = capture(1.0, plain, 5)
    result = transfer(captured, simulate(tiny_blur))
    assert np.abs(result - requantise(captured)).mean() < 0.1
    assert sharpness(result) == pytest.approx(sharpness(requantise(captured)), rel=0.01)


def test_equal_simulations_change_nothing():
    captured = capture(1.0, plain, 5)
    np.testing.assert_array_equal(transfer(captured, simulate(plain)), requantise(captured))


def test_a_uniform_wall_stays_smooth():
    """More light moves a share of a wall of one code to the next code, in connected areas."""
    captured = np.full(SHAPE, 6, np.uint8)
    flat = [np.full(SHAPE, level, np.float32) for level in (6.0, 6.0, 7.2, 7.2)]
    noise = 0.02 * np.random.default_rng(0).standard_normal(SHAPE).astype(np.float32)
    effect = EffectImages(flat[2] + noise, flat[3])
    result = transfer(captured, Simulated(flat[0] + noise, flat[1], effect))
    assert set(np.unique(result)) == {7.0, 8.0}
    assert (result == 8).mean() == pytest.approx(0.2, abs=0.05)
    assert (result[:, 1:] == result[:, :-1]).mean() > 0.9


def test_a_residual_stays_in_place_and_codes_in_their_range():
    captured, images = capture(1.0, plain, 5), simulate(plain)
    changed, noiseless = images.simulated.copy(), images.noiseless.copy()
    changed[100, 200] = noiseless[100, 200] = 255
    bright_pixel = dataclasses.replace(images, effect=EffectImages(changed, noiseless))
    result = transfer(captured, bright_pixel)
    added = 255 - images.simulated[100, 200]
    assert result[100, 200] == pytest.approx(captured[100, 200] + added, rel=0.03)
    rest = np.abs(result - requantise(captured))
    rest[100, 200] = 0
    assert rest.max() <= 2 and rest.mean() < 0.1
    halved = EffectImages(images.simulated / 2 + 127, images.noiseless / 2 + 127)
    assert transfer(captured, dataclasses.replace(images, effect=halved)).max() <= 255


def test_a_shift_that_varies_over_the_image_has_a_filter_for_each_block():
    """A magnification by 0.1 % moves dots by a third of a pixel at the sides."""

    def magnified(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
        scaling = cv2.getRotationMatrix2D((320, 120), 0, 1.001)
        return cv2.warpAffine(image, scaling, SHAPE[::-1], flags=cv2.INTER_CUBIC) + noise(rng)

    captured, expected = capture(1.0, plain, 5), capture(1.0, magnified, 5)
    result = transfer(captured, simulate(magnified))
    error, change = (rms(image, expected) for image in (result, captured))
    assert error < 0.75 * change
