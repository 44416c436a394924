"""What an effect does to a simulated image, laid onto one with texture that simulation lacks."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from starling.diagnosis.transfer import dequantise
from starling.diagnosis.transfer.transfer import (
    Changed,
    Exposed,
    Known,
    known,
    laid_on,
    pairs_laid_on,
)

SHAPE = (240, 640)
Do = Callable[[np.ndarray, np.random.Generator | None], np.ndarray]


def scene(texture: float) -> np.ndarray:
    """Dots on a ground, with texture or without."""
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


def hardly_brighter(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
    return 255 * (np.clip(image + noise(rng), 0, 255) / 255) ** (1 / 1.002)


def plain(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
    return image + noise(rng)


def noise(rng: np.random.Generator | None) -> np.ndarray:
    return np.zeros(SHAPE) if rng is None else 2 * rng.standard_normal(SHAPE)


def taken(texture: float, do: Do, seed: int) -> np.ndarray:
    return np.rint(exact(texture, do, seed)).astype(np.uint8)


def exact(texture: float, do: Do, seed: int | None) -> np.ndarray:
    rng = None if seed is None else np.random.default_rng(seed)
    return np.clip(do(scene(texture), rng), 0, 255).astype(np.float32)


@dataclasses.dataclass(frozen=True)
class Simulated:
    """An image without texture: by noise of its own, and without noise."""

    without: np.ndarray
    still: np.ndarray
    changed: Changed


def simulated(do: Do) -> Simulated:
    changed = Changed(exact(0.0, do, 7), exact(0.0, do, None))
    return Simulated(exact(0.0, plain, 7), exact(0.0, plain, None), changed)


def laid(captured: np.ndarray, of: Simulated) -> np.ndarray:
    known = Known(dequantise.levels(captured), of.without, of.still)
    return laid_on(known, of.changed, ceiling=255)


def anew(captured: np.ndarray) -> np.ndarray:
    """What effects are laid onto: levels of the captured image, rounded."""
    return np.rint(dequantise.levels(captured))


def sharpness(image: np.ndarray) -> float:
    return float(np.sqrt(fine_power(image)).mean())


def fine_power(image: np.ndarray) -> np.ndarray:
    return cv2.Laplacian(image.astype(np.float32), cv2.CV_32F) ** 2


@pytest.mark.parametrize("do", [blurred, lower, smoothed, noisier, brighter])
def test_a_textured_image_answers_as_it_would_to_the_effect_itself(do):
    """In level and sharpness; what is not drawn anew pixel by pixel too."""
    captured, wanted = taken(1.0, plain, 5), taken(1.0, do, 5)
    found = laid(captured, simulated(do))
    np.testing.assert_array_equal(found, np.rint(found))
    assert found.dtype == np.float32
    assert found.mean() == pytest.approx(wanted.mean(), rel=0.01)
    assert sharpness(found) == pytest.approx(sharpness(wanted), rel=0.04)
    if do in {blurred, lower}:  # A lens leaves noise as it is: what is missing is made.
        one, other = found - exact(1.0, do, None), captured - exact(1.0, plain, None)
        assert one.std() == pytest.approx(other.std(), rel=0.05)
    elif do is not noisier:
        off, change = (
            float(np.sqrt(np.mean((one.astype(float) - wanted) ** 2))) for one in (found, captured)
        )
        assert off < 0.4 * change


def test_a_tone_curve_holds_of_levels_that_simulation_does_not_reach():
    """Texture has darker places than the ground that simulation has in its place."""
    captured, wanted = taken(1.0, plain, 5), taken(1.0, brighter, 5)
    found = laid(captured, simulated(brighter))
    dark = captured <= np.quantile(captured, 0.002)
    bright = captured >= np.quantile(captured, 0.998)
    assert captured[dark].max() < exact(0.0, plain, 7).min()
    assert (wanted[dark] - captured[dark].astype(float)).mean() > 10
    assert found[dark].mean() == pytest.approx(wanted[dark].mean(), abs=1.5)
    assert found[bright].mean() == pytest.approx(wanted[bright].mean(), abs=0.2)


def test_a_tone_curve_leaves_no_gaps_between_codes():
    captured, wanted = taken(1.0, plain, 5), taken(1.0, brighter, 5)
    found = np.rint(laid(captured, simulated(brighter)))
    comb = [_comb(one) for one in (wanted, found)]
    assert comb[1] < 1.5 * comb[0]
    curve = 255 * (captured / 255) ** (1 / 1.3)
    assert _comb(np.rint(curve)) > 5 * comb[0]


def test_what_hardly_does_anything_brings_no_noise():
    """Detection limits are told by how much the weakest strengths change."""
    captured = taken(1.0, plain, 5)
    change = laid(captured, simulated(hardly_brighter)) - anew(captured)
    wanted = 255 * (captured / 255) ** (1 / 1.002) - captured
    assert 0.05 < wanted.mean() < 0.3
    assert change.mean() == pytest.approx(wanted.mean(), abs=0.01)
    assert set(np.unique(change)) == {0, 1}


def test_the_finest_bits_of_an_averaged_image_are_no_scene():
    """Of these a filter would tell that the effect takes what differs by chance."""

    def fine(effect: float, seed: int | None) -> np.ndarray:
        glare = effect * np.linspace(0, 1, SHAPE[1])
        image = (1 - effect) * cv2.GaussianBlur(exact(0.0, plain, seed), (0, 0), 0.9) + glare
        return (np.rint(256 * image) / 256).astype(np.float32)

    captured = np.rint(fine(0.0, 5)).astype(np.uint8)
    without, still, *changed = (fine(by, seed) for by in (0.0, 0.001) for seed in (7, None))
    found = laid(captured, Simulated(without, still, Changed(*changed)))
    least = np.abs(changed[0] - without).mean()
    assert 0.02 < least < 0.06
    assert np.abs(found - anew(captured)).mean() < 1.5 * least


def test_a_tone_curve_gives_both_imagers_nothing_in_common():
    """A matcher finds what is alike in both images at no disparity, where dots are weaker."""
    shape = (160, 224)

    def even(seed: int | None, gain: float) -> tuple[np.ndarray, np.ndarray]:
        noise = np.zeros((2, *shape))
        if seed is not None:
            noise = np.random.default_rng(seed).normal(0, 0.3, (2, *shape))
        left, right = (gain * (6.3 + noise)).astype(np.float32)
        return left, right

    left, right = (dequantise.levels(np.rint(one).astype(np.uint8)) for one in even(5, 1.0))
    of = known((left[None], right[None]), Exposed([even(7, 1.0)], even(None, 1.0)))
    laid = pairs_laid_on(of, Exposed([even(7, 2.0)], even(None, 2.0)), ceiling=255)
    fine = (one[0] - cv2.GaussianBlur(one[0], (0, 0), 2) for one in laid)
    first, second = (one.ravel() for one in fine)
    assert first.std() > 0.3 and second.std() > 0.3
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.05


def _comb(codes: np.ndarray) -> float:
    """How far codes are off the mean of their neighbours in number."""
    count = np.bincount(codes.astype(int).ravel())
    return float(np.abs(count[1:-1] - 0.5 * (count[:-2] + count[2:])).sum() / count.sum())


def test_a_lens_blurs_texture_that_simulation_lacks_and_no_noise():
    """Texture as fine as noise is told from it by its power alone."""
    rng = np.random.default_rng(3)
    rough = scene(0.0) + 6 * rng.standard_normal(SHAPE)
    captured, wanted = (
        np.clip(np.rint(do(rough, np.random.default_rng(5))), 0, 255).astype(np.uint8)
        for do in (plain, blurred)
    )
    found = laid(captured, simulated(blurred))
    assert sharpness(wanted) < 0.6 * sharpness(captured)
    assert sharpness(found) == pytest.approx(sharpness(wanted), rel=0.05)


def test_whole_codes_are_off_as_those_of_what_is_laid_on():
    """A wall without texture is of one code: it is off by the same everywhere, a textured not."""
    rng = np.random.default_rng(3)
    texture = cv2.GaussianBlur(rng.standard_normal(SHAPE), (0, 0), 0.7)

    def wall(contrast: float, blur_px: float, seed: int | None) -> np.ndarray:
        image = cv2.GaussianBlur(0.2 + scene(0.0) + 3 * contrast * texture, (0, 0), blur_px)
        if seed is not None:
            image = image + np.random.default_rng(seed).normal(0, 0.2, SHAPE)
        return image.astype(np.float32)

    captured, wanted = (np.rint(wall(1.0, px, 5)).astype(np.uint8) for px in (0.05, 1.0))
    without, still, *changed = (wall(0.0, px, seed) for px in (0.05, 1.0) for seed in (7, None))
    found = laid(captured, Simulated(without, still, Changed(*changed)))
    bare = cv2.dilate(wall(0.0, 1.0, None), np.ones((5, 5))) < 30.4
    assert bare.mean() > 0.05
    before, after, by_it = (fine_power(image)[bare].mean() for image in (captured, wanted, found))
    assert after < 0.4 * before
    assert by_it == pytest.approx(after, rel=0.05)


@pytest.mark.parametrize("blur_px", [0.1, 0.2])
def test_what_hardly_filters_brings_no_noise(blur_px):

    def hardly(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
        return cv2.GaussianBlur(image, (0, 0), blur_px) + noise(rng)

    captured, made = taken(1.0, plain, 5), simulated(hardly)
    found = laid(captured, made)
    assert np.abs(found - anew(captured)).mean() < 0.1
    assert sharpness(found) == pytest.approx(sharpness(anew(captured)), rel=0.01)


def test_where_simulation_does_not_differ_nothing_does():
    captured = taken(1.0, plain, 5)
    np.testing.assert_array_equal(laid(captured, simulated(plain)), anew(captured))


def test_even_places_stay_even_for_a_matcher():
    """Light that falls on all of a wall of one code moves a share of it one code further."""
    captured = np.full(SHAPE, 6, np.uint8)
    flat = [np.full(SHAPE, level, np.float32) for level in (6.0, 6.0, 7.2, 7.2)]
    noise = 0.02 * np.random.default_rng(0).standard_normal(SHAPE).astype(np.float32)
    of = Simulated(flat[0] + noise, flat[1], Changed(flat[2] + noise, flat[3]))
    found = laid(captured, of)
    assert set(np.unique(found)) == {7.0, 8.0}
    assert (found == 8).mean() == pytest.approx(0.2, abs=0.05)
    assert (found[:, 1:] == found[:, :-1]).mean() > 0.9


def test_what_is_added_stays_where_it_is_and_codes_within_their_range():
    captured, made = taken(1.0, plain, 5), simulated(plain)
    changed, still = made.without.copy(), made.still.copy()
    changed[100, 200] = still[100, 200] = 255
    made_bright = dataclasses.replace(made, changed=Changed(changed, still))
    found = laid(captured, made_bright)
    added = 255 - made.without[100, 200]
    assert found[100, 200] == pytest.approx(captured[100, 200] + added, rel=0.03)
    off = np.abs(found - anew(captured))
    off[100, 200] = 0
    assert off.max() <= 2 and off.mean() < 0.1
    halved = Changed(made.without / 2 + 127, made.still / 2 + 127)
    brighter = dataclasses.replace(made, changed=halved)
    assert laid(captured, brighter).max() <= 255


def test_what_shifts_otherwise_to_either_side_is_told_block_by_block():
    """A magnification of one in a thousand moves dots by a third of a pixel at the sides."""

    def grown(image: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
        turn = cv2.getRotationMatrix2D((320, 120), 0, 1.001)
        return cv2.warpAffine(image, turn, SHAPE[::-1], flags=cv2.INTER_CUBIC) + noise(rng)

    captured, wanted = taken(1.0, plain, 5), taken(1.0, grown, 5)
    found = laid(captured, simulated(grown))
    off, change = (
        float(np.sqrt(np.mean((one.astype(float) - wanted) ** 2))) for one in (found, captured)
    )
    assert off < 0.75 * change
