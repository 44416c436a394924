"""Generators: determinism, geometry and input checks."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from starling.patterns import InputError, lattice, quasirandom, tiled, uniform
from starling.patterns.field import unit_vectors

SMALL = {"fov_x_deg": 40.0, "fov_y_deg": 30.0, "width_px": 400}
GENERATORS = {
    "lattice": lambda **k: lattice(**(SMALL | {"fwhm_mrad": 4.0, "pitch_mrad": 20.0} | k)),
    "quasirandom": lambda **k: quasirandom(**(SMALL | k)),
    "tiled": lambda **k: tiled(**(SMALL | {"sites_x": 40, "sites_y": 32, "fwhm_mrad": 4.0} | k)),
    "uniform": lambda **k: uniform(**(SMALL | k)),
}
every_generator = pytest.mark.parametrize("make", GENERATORS.values(), ids=GENERATORS)


def tangents(pattern):
    return pattern.field.tangents(pattern.dots[:, 0], pattern.dots[:, 1], pattern.shape)


def cosines(pattern):
    rays = unit_vectors(*tangents(pattern))
    return rays[:, 0], rays[:, 1]


@every_generator
@settings(deadline=None, max_examples=8)
@given(seed=st.integers(0, 2**63 - 1), width=st.integers(300, 640))
def test_one_seed_makes_one_pattern(make, seed, width):
    first, again = make(seed=seed, width_px=width), make(seed=seed, width_px=width)
    assert first.image.tobytes() == again.image.tobytes()
    assert first.dots.tobytes() == again.dots.tobytes()
    assert first.image.shape == first.field.shape(width)
    assert first.image.mean(dtype=np.float64) == pytest.approx(1, abs=1e-5)
    assert first.image.min() >= 0
    assert first.field.holds(*tangents(first)).all()
    assert not np.array_equal(first.dots, make(seed=(seed + 1) % 2**63, width_px=width).dots)


@every_generator
def test_image_size_does_not_move_the_dots(make):
    near, far = make(width_px=300), make(width_px=600)
    np.testing.assert_allclose(tangents(near), tangents(far), atol=1e-12)


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    density=st.floats(0.1, 3.0),
    distance=st.floats(0.0, 0.78),
)
def test_quasi_random_dots_keep_count_and_distance(seed, density, distance):
    pattern = quasirandom(**SMALL, dots_per_deg2=density, min_distance=distance, seed=seed)
    n = round(density * pattern.field.solid_angle_deg2)
    assert len(pattern.dots) == n
    rays = unit_vectors(*tangents(pattern))
    chord = KDTree(rays).query(rays, k=2)[0]
    nearest = np.degrees(2 * np.arcsin(chord[:, 1].min() / 2))
    assert nearest >= distance / math.sqrt(density) * (1 - 1e-9)


@settings(deadline=None, max_examples=15)
@given(rotation=st.floats(-90, 90), pitch=st.floats(15, 40), seed=st.integers(0, 1000))
def test_a_unit_is_a_square_grid_in_direction_cosines(rotation, pitch, seed):
    """Source: grating equation, sin(theta_out) = sin(theta_in) + m wavelength / period."""
    pattern = GENERATORS["lattice"](
        units=1, rotation_deg=rotation, pitch_mrad=pitch, seed=seed, power_spread=0.0
    )
    a, b = cosines(pattern)
    angle = math.radians(rotation)
    u = (math.cos(angle) * a + math.sin(angle) * b) / (pitch * 1e-3)
    v = (-math.sin(angle) * a + math.cos(angle) * b) / (pitch * 1e-3)
    for order in (u, v):
        phase = np.exp(2j * np.pi * order)
        assert abs(phase.mean()) == pytest.approx(1, abs=1e-9)
    np.testing.assert_allclose(pattern.dots[:, 2], 1)


@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 2**63 - 1), stream=st.integers(1, 15))
def test_streams_of_a_seed_are_independent(seed, stream):
    """Offsets differ between streams; one stream of one seed is deterministic."""

    def offset(stream):
        grid_pattern = GENERATORS["lattice"](units=1, rotation_deg=0.0, seed=seed, stream=stream)
        turns = np.exp(2j * np.pi * np.stack(cosines(grid_pattern)) / 20e-3)
        return turns.mean(axis=1)

    assert np.array_equal(offset(stream), offset(stream))
    assert abs(offset(stream) - offset(0)).max() > 1e-3
    assert abs(offset(stream) - offset(stream - 1)).max() > 1e-3


def test_clusters_multiply_the_dots_and_jitter_moves_them():
    grid = GENERATORS["lattice"](units=1, pitch_mrad=30.0)
    five = GENERATORS["lattice"](units=1, pitch_mrad=30.0, emitters=5, cluster_mrad=24.0)
    assert len(five.dots) == pytest.approx(5 * len(grid.dots), rel=0.05)
    loose = GENERATORS["lattice"](units=1, rotation_deg=0.0, pitch_mrad=30.0, jitter_mrad=3.0)
    phase = np.exp(2j * np.pi * cosines(loose)[0] / 30e-3)
    # Gaussian jitter of s pitches reduces the comb to exp(-2 pi^2 s^2).
    assert abs(phase.mean()) == pytest.approx(math.exp(-2 * math.pi**2 * 0.1**2), abs=0.06)


def test_tiles_share_one_sub_pattern_with_a_bright_middle():
    """Sites by direction cosine; away from the corners, which the pincushion pushes out."""
    pattern = GENERATORS["tiled"](centre_gain=20.0, tile_spread=0.0)
    a, b = cosines(pattern)
    column = (a / math.sin(math.radians(20.0)) + 1) / 2 * 120 - 0.5
    row = (b / math.sin(math.radians(15.0)) + 1) / 2 * 96 - 0.5
    np.testing.assert_allclose(column, np.rint(column), atol=1e-6)
    np.testing.assert_allclose(row, np.rint(row), atol=1e-6)
    column, row = np.rint(column).astype(int), np.rint(row).astype(int)
    middle = row // 32 == 1
    sites = {
        tile: {
            (r % 32, c % 40): power
            for r, c, power in zip(
                row[middle], column[middle], pattern.dots[middle, 2], strict=True
            )
            if c // 40 == tile
        }
        for tile in (0, 1, 2)
    }
    assert sites[0] == sites[1] == sites[2]
    assert len(sites[1]) == round(0.11 * 40 * 32)
    assert max(sites[1], key=lambda site: sites[1][site]) == (16, 20)
    assert sites[1][16, 20] == 20.0
    lit = np.zeros((96, 120), int)
    lit[row, column] = 1
    for shift in ((0, 1), (1, 0), (1, 1), (1, -1)):
        assert not (lit & np.roll(lit, shift, (0, 1)))[1:-1, 1:-1].any()


def test_power_spread_is_what_it_says():
    for spread in (0.0, 0.3):
        powers = uniform(dots_per_deg2=2.0, fwhm_mrad=4.0, power_spread=spread).dots[:, 2]
        assert powers.std() / powers.mean() == pytest.approx(spread, abs=0.02)


@every_generator
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": -1}, r"seed must be an integer in \[0, \d+\]; got -1\."),
        ({"seed": 1.0}, r"seed must be an integer .*; got 1\.0\."),
        ({"seed": True}, r"seed must be an integer .*; got True\."),
        ({"fov_x_deg": 200.0}, r"fov_x_deg must be in \[1, 150\]; got 200\.0\."),
        ({"width_px": 0}, r"width_px must be an integer in .*; got 0\."),
        ({"fwhm_mrad": -1.0}, r"fwhm_mrad must be > 0; got -1\.0\."),
        ({"fwhm_mrad": 0.1}, r"fwhm_mrad must span .*\. Change fwhm_mrad or width_px\."),
        ({"background": 1.5}, r"background must be in \[0, 0\.99\]; got 1\.5\."),
        ({"power_spread": -0.1}, r"power_spread must be in \[0, 2\]; got -0\.1\."),
    ],
)
def test_common_refusals(make, changes, message):
    with pytest.raises(InputError, match=message):
        make(**changes)


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("lattice", {"units": 0}, r"units must be an integer in \[1, 4\]; got 0\."),
        ("lattice", {"units": 1.5}, r"units must be an integer in \[1, 4\]; got 1\.5\."),
        ("lattice", {"emitters": 100}, r"emitters must be an integer in \[1, 64\]; got 100\."),
        ("lattice", {"stream": 16}, r"stream must be an integer in \[0, 15\]; got 16\."),
        ("lattice", {"pitch_mrad": 0.0}, r"pitch_mrad must be in \[2, 200\]; got 0\.0\."),
        ("lattice", {"cluster_mrad": -1.0}, r"cluster_mrad must be in \[0, 200\]; got -1\.0\."),
        ("lattice", {"jitter_mrad": 90.0}, r"jitter_mrad must be in \[0, 50\]; got 90\.0\."),
        ("lattice", {"rotation_deg": math.inf}, r"rotation_deg must be in .*; got inf\."),
        ("lattice", {"twist_deg": 100.0}, r"twist_deg must be in \[-90, 90\]; got 100\.0\."),
        ("quasirandom", {"min_distance": 0.9}, r"min_distance must be in \[0, 0\.78\]; got 0\.9\."),
        ("quasirandom", {"dots_per_deg2": 0.0}, r"dots_per_deg2 must be in .*; got 0\.0\."),
        ("uniform", {"dots_per_deg2": 1e-4}, r"number of dots must be in \[1, 200000\]; got 0\."),
        (
            "uniform",
            {"dots_per_deg2": 1e4},
            r"number of dots .*\. Change dots_per_deg2 or the field",
        ),
        ("lattice", {"pitch_mrad": 2.0, "emitters": 9}, r"number of dots .*\. Raise pitch_mrad"),
        ("tiled", {"sites_x": 1024, "sites_y": 1024}, r"number of dots .*\. Lower lit_share"),
        ("tiled", {"tiles_x": 0}, r"tiles_x must be an integer in \[1, 9\]; got 0\."),
        ("tiled", {"tiles_y": 10}, r"tiles_y must be an integer in \[1, 9\]; got 10\."),
        ("tiled", {"sites_x": 4}, r"sites_x must be an integer in \[8, 1024\]; got 4\."),
        ("tiled", {"sites_y": 2000}, r"sites_y must be an integer in \[8, 1024\]; got 2000\."),
        ("tiled", {"lit_share": 0.5}, r"lit_share must be in \[0\.001, 0\.15\]; got 0\.5\."),
        ("tiled", {"centre_gain": 0.5}, r"centre_gain must be in \[1, 100\]; got 0\.5\."),
        ("tiled", {"tile_spread": 2.0}, r"tile_spread must be in \[0, 1\]; got 2\.0\."),
    ],
)
def test_input_checks(name, changes, message):
    with pytest.raises(InputError, match=message):
        GENERATORS[name](**changes)
