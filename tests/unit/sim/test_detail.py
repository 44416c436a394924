"""Reflectance in full detail from a pair of images, made here without a renderer."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from starling.sim.scene.captured import detail
from starling.sim.scene.captured.detail import SeenView
from starling.sim.sensor import presets

SHAPE = (160, 240)
DISPARITY_PX = 20.25
IMAGER = presets.load("d415").left
INNER = (slice(20, -20), slice(50, -50))
LEVEL_DN = 25.0


def blurred(image: np.ndarray, sigma_px: float) -> np.ndarray:
    return cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma_px)


def grain(seed: int, contrast: float, sigma_px: float) -> np.ndarray:
    """Relative reflectance of a contrast, with structures of a size."""
    noise = blurred(np.random.default_rng(seed).standard_normal(SHAPE), sigma_px)
    noise -= blurred(noise, 4 * sigma_px)
    return np.asarray(1 + contrast * noise / noise.std(), np.float32)


def dots(seed: int, height: float) -> np.ndarray:
    """Round spots on a grid, 8 px apart, each at a place of its own."""
    light = np.zeros(SHAPE, np.float32)
    places = np.random.default_rng(seed).integers(-2, 3, (2, SHAPE[0] // 8, SHAPE[1] // 8))
    rows, columns = np.indices(places.shape[1:]) * 8 + 4
    light[rows + places[0], columns + places[1]] = 1
    light = blurred(light, 1.5)
    return light * (height / light.max())


def shifted(image: np.ndarray) -> np.ndarray:
    """The left view's image as the right imager sees it."""
    matrix = np.array([[1, 0, -DISPARITY_PX], [0, 1, 0]], np.float32)
    flags, border = cv2.INTER_CUBIC, cv2.BORDER_REFLECT
    return cv2.warpAffine(
        image.astype(np.float32), matrix, SHAPE[::-1], flags=flags, borderMode=border
    )


def views(
    reflectance: np.ndarray, lit: np.ndarray, believed: np.ndarray, noise_dn: float = 0.7
) -> list[SeenView]:
    """A pair that shows a reflectance under dots, and the dots that a sensor believes in."""
    rng = np.random.default_rng(7)
    blur_px = float(np.hypot(IMAGER.lens.blur_px, IMAGER.smoothing_px))
    seen = []
    for move in (np.asarray, shifted):
        image = LEVEL_DN * blurred(move(reflectance * (1 + lit)), blur_px)
        noise = blurred(rng.standard_normal(SHAPE), IMAGER.smoothing_px)
        seen.append(
            SeenView(
                image=np.maximum(image + noise_dn * noise / noise.std(), 0).astype(np.float32),
                laser=np.asarray(move(believed), np.float32),
                ambient=np.ones(SHAPE, np.float32),
                disparity_px=np.full(SHAPE, DISPARITY_PX, np.float32),
                imager=IMAGER,
            )
        )
    return seen


def estimated(seen: list[SeenView], *, dots_known: bool = True) -> np.ndarray:
    base = np.full(SHAPE, 0.4, np.float32)
    return detail.refine(base, seen, dots_known=dots_known)[INNER] / 0.4


def similarity(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.corrcoef(first.ravel(), second.ravel())[0, 1])


@pytest.mark.parametrize("size_px", [1.5, 3.0])
def test_texture_returns_with_its_contrast(size_px):
    """Texture finer than the base's 12 px is refined under known dots, with its own contrast.

    The texture is a random field; edges of print are not tested.
    """
    truth, light = grain(1, 0.2, size_px), dots(2, 0.5)
    refined = estimated(views(0.4 * truth, light, light))
    assert similarity(refined, truth[INNER]) > 0.9
    assert refined.std() == pytest.approx(truth[INNER].std(), rel=0.15)


def test_the_right_image_halves_the_noise():
    """The error of the pair's estimate is below that of the left image alone."""
    truth, light = grain(1, 0.1, 1.5), dots(2, 0.5)
    seen = views(0.4 * truth, light, light, noise_dn=1.5)
    errors = [np.std(estimated(part) - truth[INNER]) for part in (seen, seen[:1])]
    assert errors[0] < 0.9 * errors[1]


def test_noise_is_no_texture():
    """Of the images' noise, 3 % of their level, less than 1 % is in the reflectance."""
    light = dots(2, 0.5)
    refined = estimated(views(np.full(SHAPE, 0.4), light, light))
    assert refined.std() < 0.01


def test_dots_of_other_strengths_are_no_texture():
    """Dots that differ by 20 % from the known ones leave 1 %, although both imagers see them."""
    light = dots(2, 0.5)
    strengths = cv2.resize(
        np.random.default_rng(3).normal(1, 0.2, (20, 30)).astype(np.float32),
        SHAPE[::-1],
        interpolation=cv2.INTER_NEAREST,
    )
    refined = estimated(views(np.full(SHAPE, 0.4), light * strengths, light))
    assert refined.std() < 0.01


def test_unknown_dots_are_no_texture():
    """Dots of another pattern, which brighten by up to 50 %, leave less than 2 %."""
    refined = estimated(views(np.full(SHAPE, 0.4), dots(2, 0.5), dots(5, 0.5)), dots_known=False)
    assert refined.std() < 0.02


def test_print_among_unknown_dots_is_texture():
    """A board's squares, of contrast 3, come out of an image with another pattern's dots."""
    rows, columns = np.indices(SHAPE) // 16
    truth = np.where((rows + columns) % 2, 1.5, 0.5)
    refined = estimated(views(0.4 * truth, dots(2, 0.3), dots(5, 0.3)), dots_known=False)
    assert similarity(refined, truth[INNER]) > 0.9


def test_a_hidden_point_takes_the_left_image_alone():
    """Where the right image shows another surface, its values have no weight."""
    truth, light = grain(1, 0.2, 3.0), dots(2, 0.5)
    left, right = views(0.4 * truth, light, light)
    wrong = replace(
        right,
        image=right.image[::-1].copy(),
        disparity_px=np.full(SHAPE, DISPARITY_PX + 5, np.float32),
    )
    assert similarity(estimated([left, wrong]), truth[INNER]) > 0.8
