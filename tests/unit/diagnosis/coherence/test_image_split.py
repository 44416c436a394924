"""Shares of drawn pairs: each part that was drawn is attributed with its own share."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.diagnosis.where.coherence import scene_split
from starling.diagnosis.where.coherence.image_split import split_powers
from starling.diagnosis.where.coherence.shares import CoherenceSplit, ImageShares
from starling.diagnosis.where.coherence.spectra import BANDS
from starling.diagnosis.where.coherence.split import coherence_split
from starling.diagnosis.where.coherence.views import PairSpectra
from tests.unit.diagnosis.coherence import made_pairs
from tests.unit.diagnosis.coherence.made_pairs import WALLS, Amplitudes, Wall

pytestmark = pytest.mark.slow

PARTS = ("explained", "pattern", "camera", "scene", "imager", "noise")
TOLERANCE = 0.02  # Four rooms of 60 windows; a pattern's share has a standard error of 0.004.
ALL_PARTS = Amplitudes(explained=4, pattern=3, camera=2, scene=2.5, imager=1.5, noise=2)
DRAWN = {part: getattr(ALL_PARTS, part) ** 2 / ALL_PARTS.total for part in PARTS}
FILLED = ("2-4 px", "4-8 px", "all")  # Bands in which `made_pairs.field` has power.


@lru_cache
def split_of(amplitudes: Amplitudes, walls: tuple[Wall, ...] = WALLS) -> CoherenceSplit:
    return coherence_split(*made_pairs.rooms_of(amplitudes, walls))


def shares_of(split: CoherenceSplit, band: str = "all") -> ImageShares:
    (shares,) = [each for each in split.images if each.band == band]
    return shares


@pytest.mark.parametrize("band", FILLED)
@pytest.mark.parametrize("part", PARTS)
def test_drawn_shares_are_recovered(part: str, band: str) -> None:
    value, low, high = getattr(shares_of(split_of(ALL_PARTS), band), part)
    assert value == pytest.approx(DRAWN[part], abs=TOLERANCE)
    assert low is not None and high is not None and low <= value <= high


def test_shares_sum_to_one() -> None:
    for amplitudes in (ALL_PARTS, Amplitudes(noise=3)):
        for shares in split_of(amplitudes).images:
            parts = [*PARTS, "unseparated"]
            assert sum(getattr(shares, part)[0] for part in parts) == pytest.approx(1)
    for room in split_of(ALL_PARTS).rooms.values():
        total = sum(getattr(room, part) for part in (*PARTS, "unseparated"))
        assert total == pytest.approx(1)


def test_rooms_have_their_shares() -> None:
    rooms = split_of(ALL_PARTS).rooms
    assert [*rooms] == [f"room {number}" for number in range(len(WALLS))]
    for room in rooms.values():
        assert room.explained == pytest.approx(DRAWN["explained"], abs=2 * TOLERANCE)
        assert room.pattern == pytest.approx(DRAWN["pattern"], abs=2 * TOLERANCE)
        assert room.windows >= 40


def test_noise_alone_is_not_coherent() -> None:
    shares = shares_of(split_of(Amplitudes(noise=3)))
    assert abs(shares.coherent[0]) < 0.01 and shares.noise[0] == pytest.approx(1, abs=TOLERANCE)
    assert abs(shares.explained[0]) < 0.01 and abs(shares.pattern[0]) < 0.01


@pytest.mark.parametrize("part", ["pattern", "camera", "scene", "imager"])
def test_each_part_goes_to_its_frame(part: str) -> None:
    shares = shares_of(split_of(Amplitudes(**{part: 3.0}, noise=1)))
    for name in PARTS:
        drawn = {part: 0.9, "noise": 0.1}.get(name, 0.0)
        assert getattr(shares, name)[0] == pytest.approx(drawn, abs=TOLERANCE), name


def test_other_gain_of_the_right_imager_is_no_noise() -> None:
    shares = shares_of(split_of(dataclasses.replace(ALL_PARTS, imager=0, noise=0, right_gain=1.3)))
    assert shares.coherent[0] == pytest.approx(1, abs=0.01)


def test_rooms_of_equal_depth_are_not_separated() -> None:
    walls = (Wall(offset_px=20.0), Wall(offset_px=20.2), Wall(offset_px=19.9))
    amplitudes = Amplitudes(pattern=2, camera=2, noise=1)
    shares = shares_of(split_of(amplitudes, walls), "8-16 px")
    assert shares.pattern[0] == shares.camera[0] == shares.scene[0] == 0
    assert shares.unseparated[0] == pytest.approx(8 / 9, abs=TOLERANCE)


def test_single_room_is_split_by_scene_alone() -> None:
    split = split_of(ALL_PARTS, WALLS[:1])
    shares = shares_of(split)
    assert shares.pattern == shares.camera == (0.0, None, None)
    assert shares.explained[0] == pytest.approx(DRAWN["explained"], abs=2 * TOLERANCE)
    coherent = sum(DRAWN[part] for part in ("pattern", "camera", "scene"))
    assert shares.unseparated[0] == pytest.approx(coherent, abs=2 * TOLERANCE)


@pytest.mark.parametrize("ratio", [0.5, 1.5])
def test_noise_ratio_is_that_of_the_variances(ratio: float) -> None:
    amplitudes = Amplitudes(explained=3, noise=1, simulated_noise=float(np.sqrt(ratio)))
    shares = shares_of(split_of(amplitudes))
    assert shares.noise_ratio[0] == pytest.approx(ratio, rel=0.05)
    assert shares.simulated_noise[0] == pytest.approx(ratio / (9 + ratio), abs=0.01)
    assert shares.explained[0] == pytest.approx(0.9, abs=0.01)


def test_noise_of_the_simulation_takes_nothing_from_the_explained_share() -> None:
    loud = Amplitudes(explained=3, noise=1, simulated_noise=3)
    assert shares_of(split_of(loud)).explained[0] == pytest.approx(0.9, abs=TOLERANCE)


@pytest.mark.parametrize("offset_px", [20.0, 20.25, 20.5])
def test_interpolation_loses_no_coherence(offset_px: float) -> None:
    """Disparity of a whole pixel, of a quarter and of a half gives the same share."""
    wall = Wall(offset_px=offset_px)
    real, base = made_pairs.pair(wall, Amplitudes(scene=3), seed=0)
    split = scene_split.split_scene(real, base, made_pairs.strata_of(wall))
    assert split is not None
    powers = split.powers
    unexplained = powers.coherent + powers.incoherent
    np.testing.assert_allclose((powers.coherent / unexplained)[:3], 1, atol=0.005)


@pytest.mark.parametrize(("error_px", "down_px"), [(0.4, 0.0), (-0.6, 0.3), (0.0, -0.5)])
def test_wrong_reference_is_no_noise(error_px: float, down_px: float) -> None:
    wall = WALLS[0]
    real, base = made_pairs.pair(wall, Amplitudes(scene=3, noise=1), seed=0, down_px=down_px)
    split = scene_split.split_scene(real, base, made_pairs.strata_of(wall, error_px=error_px))
    assert split is not None
    shift = np.array(split.shift_px)
    np.testing.assert_allclose(shift, (error_px, -down_px), atol=0.05)
    powers = split.powers
    share = powers.coherent[:3].sum() / (powers.coherent + powers.incoherent)[:3].sum()
    assert share == pytest.approx(0.9, abs=0.01)


def test_too_small_images_have_no_split() -> None:
    wall = WALLS[0]
    real, base = made_pairs.pair(wall, ALL_PARTS, seed=0)
    strata = made_pairs.strata_of(wall)
    none_counted = dataclasses.replace(strata, counted=np.zeros_like(strata.counted))
    assert scene_split.split_scene(real, base, none_counted) is None
    assert coherence_split([base], [real], [none_counted], ["room"], [1.0]) == CoherenceSplit()


def test_saturated_pixels_do_not_count() -> None:
    rng = np.random.default_rng(0)
    left = rng.uniform(0, 200, (256, 256)).astype(np.float32)
    bright = left.copy()
    bright[:8, :8] = 255
    free = scene_split.unsaturated(((left, left), (left, left)))
    assert free.all()
    assert not scene_split.unsaturated(((left, left), (bright, left)))[:8, :8].any()


@given(st.integers(0, 10**6), st.integers(1, 12))
@settings(deadline=None, max_examples=20)
def test_parts_of_any_pair_sum_to_its_power(seed: int, windows: int) -> None:
    rng = np.random.default_rng(seed)

    def spectra() -> np.ndarray:
        values = rng.standard_normal((2, windows, 64, 33))
        return (values[0] + 1j * values[1]).astype(np.complex64)

    ones = np.ones((64, 33))
    common = spectra()
    real, base = (
        PairSpectra(
            left=common + spectra(), right=common + spectra(), left_power=ones, right_power=ones
        )
        for _ in range(2)
    )
    powers = split_powers(real, base)
    np.testing.assert_allclose(
        powers.explained + powers.coherent + powers.incoherent, powers.total, rtol=1e-5
    )
    assert powers.total.shape == (len(BANDS),)
