"""Shares of drawn disparity errors: a warp, errors that follow the image, edges, and noise."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import ndimage

from starling.diagnosis.scenes.observation import (
    DepthObservation,
    FullObservation,
    SceneObservation,
)
from starling.diagnosis.scenes.strata import Strata, stratify
from starling.diagnosis.where.coherence.disparity_split import DISPARITY_BANDS, SIDES
from starling.diagnosis.where.coherence.shares import DisparityShares
from starling.diagnosis.where.coherence.split import coherence_split
from tests.unit.diagnosis.coherence import made_pairs
from tests.unit.diagnosis.coherence.made_pairs import HEIGHT, INFO, WALLS, WIDTH, field

Y, X = np.indices((HEIGHT, WIDTH), np.float64)
STRATA = [made_pairs.strata_of(wall) for wall in WALLS]
ROOMS = [f"room {number}" for number in range(len(WALLS))]
TOLERANCE = 0.05


def noise(seed: int) -> np.ndarray:
    return made_pairs.at(field(5000 + seed), X, Y)


def observations(
    errors: list[np.ndarray], images: list[np.ndarray] | None = None
) -> list[SceneObservation]:
    """Return device depth with these errors, and left images [DN]."""
    result: list[SceneObservation] = []
    for number, (error, strata) in enumerate(zip(errors, STRATA, strict=True)):
        device_px = (strata.disparity_px + error).astype(np.float32)[None]
        if images is None:
            result.append(DepthObservation(device_px=device_px))
            continue
        left = np.rint(256 * images[number]).astype(np.uint16)[None]
        result.append(
            FullObservation(left=left, right=left, ours_px=device_px, device_px=device_px)
        )
    return result


def bands_of(
    errors: list[np.ndarray], images: list[np.ndarray] | None = None, side: str = "real"
) -> dict[str, DisparityShares]:
    real = observations(errors, images)
    base = observations([0.1 * noise(50 + number) for number in range(len(errors))], images)
    split = coherence_split(base, real, STRATA, ROOMS, [1.0] * 4)
    assert [*split.disparity] == [*split.edges] == [*SIDES]
    return {shares.band: shares for shares in split.disparity[side]}


@pytest.mark.parametrize("side", ["real", "gap"])
def test_warp_repeats_in_the_camera_image(side: str) -> None:
    warp = 0.3 * made_pairs.at(field(7), X, Y)
    shares = bands_of([warp + 0.1 * noise(number) for number in range(4)], side=side)
    drawn = 0.09 / (0.09 + 0.01 + 0.01 * (side == "gap"))
    for band in ("2-4 px", "4-8 px", "all"):
        assert shares[band].camera[0] == pytest.approx(drawn, abs=TOLERANCE)
        assert shares[band].image[0] == 0.0
    assert shares["all"].rms_px[0] == pytest.approx(0.3 / np.sqrt(drawn), rel=0.1)


def test_waves_longer_than_a_window_have_a_band() -> None:
    waves = 0.3 * np.sin(2 * np.pi * X / 180)
    shares = bands_of([waves + 0.1 * noise(number) for number in range(4)])
    assert [*shares] == [*DISPARITY_BANDS, "all"]
    assert shares["> 64 px"].camera[0] > 0.9
    assert shares["> 64 px"].rms_px[0] > 2 * shares["> 33 px"].rms_px[0]


def test_errors_of_each_room_alone_are_the_rest() -> None:
    shares = bands_of([0.2 * noise(number) for number in range(4)])
    for band in ("2-4 px", "4-8 px", "all"):
        assert shares[band].rest[0] == pytest.approx(1, abs=TOLERANCE)


def test_errors_that_follow_the_image_are_predicted_from_other_rooms() -> None:
    """The errors are the image's slope along rows, and noise of the same power."""
    images = [64 + 4 * made_pairs.at(field(300 + number), X, Y) for number in range(4)]
    slopes = [ndimage.sobel(image, axis=1) for image in images]
    errors = [
        0.2 * slope / slope.std() + 0.2 * noise(number) for number, slope in enumerate(slopes)
    ]
    shares = bands_of(errors, images)
    assert shares["all"].image[0] == pytest.approx(0.5, abs=TOLERANCE)
    assert abs(shares["all"].camera[0]) < TOLERANCE
    flipped = bands_of([*(-error for error in errors[:2]), *errors[2:]], images)
    assert flipped["all"].image[0] < TOLERANCE


def test_parts_sum_to_one() -> None:
    for shares in bands_of([0.2 * noise(number) for number in range(4)]).values():
        total = shares.camera[0] + shares.image[0] + shares.rest[0]
        assert total == pytest.approx(1)


def test_errors_near_edges_have_a_share() -> None:
    """Half of the squared errors lie on a box's rim, which no window contains."""
    disparity = np.full((HEIGHT, WIDTH), 12.0, np.float32)
    disparity[80:140, 60:120] = 24.0
    strata: Strata = stratify(
        disparity,
        STRATA[0].expected,
        INFO,
        body=STRATA[0].body,
        projector=STRATA[0].projector,
    )
    near = strata.counted & ~strata.interior
    error = 0.3 * np.random.default_rng(0).standard_normal(disparity.shape)
    ratio = np.sqrt(np.count_nonzero(strata.interior) / np.count_nonzero(near))
    error = np.clip(np.where(near, error * ratio / 3, error / 3), -1.5, 1.5)
    real = DepthObservation(device_px=(disparity + error).astype(np.float32)[None])
    base = DepthObservation(device_px=disparity[None])
    split = coherence_split([base], [real], [strata], ["room"], [1.0])
    assert split.edges["real"][0] == pytest.approx(0.5, abs=TOLERANCE)
    assert split.edges["real"][1:] == (None, None) and split.images == ()


def test_holes_and_wrong_matches_do_not_count() -> None:
    rng = np.random.default_rng(3)
    errors = []
    for number in range(4):
        error = 0.2 * noise(number)
        spoilt = rng.random(error.shape)
        errors.append(np.where(spoilt < 0.02, np.nan, np.where(spoilt > 0.98, 40.0, error)))
    shares = bands_of(errors)
    assert shares["all"].rms_px[0] == pytest.approx(0.2, rel=0.1)
    sparse = [np.where(rng.random(error.shape) < 0.5, np.nan, error) for error in errors]
    split = coherence_split(
        observations([0 * X] * 4), observations(sparse), STRATA, ROOMS, [1.0] * 4
    )
    assert split.disparity == {} and split.edges == {}


def test_uncounted_scenes_are_left_out() -> None:
    strata = dataclasses.replace(STRATA[0], counted=np.zeros_like(STRATA[0].counted))
    (real,) = observations([noise(0), *[0 * X] * 3])[:1]
    assert not coherence_split([real], [real], [strata], ["room"], [1.0]).disparity
