"""Statistics from dots agree with the image, and uniqueness ranks the patterns."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.patterns import (
    Field,
    InputError,
    Pattern,
    lattice,
    quasirandom,
    tiled,
    uniform,
)
from tests.oracles.pattern_statistics import measure, stated_statistics, unique_share

# Focal lengths [px] at 1280 px width; the D455 is assumed to equal the D435.
DEFAULTS = {
    "D415": (lattice, 896.0),
    "D435": (quasirandom, 640.0),
    "Kinect": (tiled, 1160.0),
    "uniform": (uniform, 640.0),
}


def hold(stated, measured):
    """Tolerances: count 3 %, neighbour distance 5 %, width 5 %, shares 0.01."""
    assert measured.dots == pytest.approx(stated.dots, rel=0.03)
    assert measured.dots_per_deg2 == pytest.approx(stated.dots_per_deg2, rel=0.03)
    assert measured.neighbour_mrad == pytest.approx(stated.neighbour_mrad, rel=0.05)
    assert measured.fwhm_mrad == pytest.approx(stated.fwhm_mrad, rel=0.05)
    assert measured.dot_share == pytest.approx(stated.dot_share, abs=0.01)
    assert measured.unique_share == pytest.approx(stated.unique_share, abs=0.01)


def both(pattern, focal_px):
    angles = {"fov_x_deg": pattern.fov_x_deg, "fov_y_deg": pattern.fov_y_deg}
    # Another scale: `measure` must not depend on the normalisation.
    return (
        stated_statistics(pattern, focal_px=focal_px),
        measure(pattern.image * np.float32(37), **angles, focal_px=focal_px),
    )


@pytest.mark.parametrize("name", DEFAULTS)
def test_defaults_are_what_they_state(name):
    generator, focal_px = DEFAULTS[name]
    hold(*both(generator(seed=3), focal_px))


@settings(deadline=None, max_examples=6)
@given(
    seed=st.integers(0, 10**6),
    density=st.floats(0.2, 1.0),
    fwhm=st.floats(6.0, 9.0),
    spread=st.floats(0.0, 0.4),
    background=st.floats(0.0, 0.6),
)
def test_quasi_random_matches_its_statistics(seed, density, fwhm, spread, background):
    pattern = quasirandom(
        width_px=900,
        dots_per_deg2=density,
        fwhm_mrad=fwhm,
        power_spread=spread,
        background=background,
        seed=seed,
    )
    hold(*both(pattern, 500.0))


def test_the_documented_numbers():
    """docs/design/patterns.md quotes these numbers (defaults, seed 0)."""
    documented = {
        "D415": (8458, 3.31, 5.9, 3.4, 0.646),
        "D435": (2733, 0.55, 18.2, 8.3, 0.273),
        "Kinect": (32504, 14.1, 3.33, 1.75, 0.992),
        "uniform": (2208, 0.444, 14.9, 8.3, 0.334),
    }
    for name, (dots, density, neighbour, fwhm, unique) in documented.items():
        generator, focal_px = DEFAULTS[name]
        statistics = stated_statistics(generator(), focal_px=focal_px)
        assert statistics.dots == dots
        assert statistics.dots_per_deg2 == pytest.approx(density, rel=0.005)
        assert statistics.neighbour_mrad == pytest.approx(neighbour, rel=0.005)
        assert statistics.fwhm_mrad == fwhm
        assert statistics.unique_share == pytest.approx(unique, abs=0.002)
        assert statistics.focal_px == focal_px


def test_uniqueness_ranks_patterns_of_one_density():
    """One unit's grid repeats, two units form a moire, random dots hardly repeat."""
    same = {"fov_x_deg": 67.0, "fov_y_deg": 41.0, "fwhm_mrad": 3.4}
    density = 3.74
    patterns = [
        lattice(**same, units=1, pitch_mrad=12.3 / 2**0.5),
        lattice(**same),
        quasirandom(**same, dots_per_deg2=density),
    ]
    shares = [unique_share(p.image, p.field, focal_px=896.0) for p in patterns]
    assert shares[0] < 0.05
    assert shares[1] == pytest.approx(0.65, abs=0.03)
    assert shares[2] > shares[1] + 0.05


def test_uniqueness_grows_with_the_window():
    pattern = quasirandom()
    shares = [
        unique_share(pattern.image, pattern.field, focal_px=640.0, window_px=w) for w in (7, 11, 21)
    ]
    assert shares == sorted(shares)
    assert shares[-1] > 0.6


def test_exact_repetition_has_no_unique_window():
    tile = np.random.default_rng(0).random((64, 50))
    assert unique_share(np.tile(tile, (1, 8)), Field(60.0, 12.0)) == 0


def test_noise_is_unique_and_darkness_is_not():
    field = Field(60.0, 20.0)
    noise = np.random.default_rng(0).random((120, 400))
    assert unique_share(noise, field) > 0.999
    noise[:, :200] = 0
    assert unique_share(noise, field) < 0.5


def slow_unique_share(image, window, search, threshold):
    """Reference implementation, window by window, of `unique_share`."""
    image = image - image.mean()
    floor = 0.05**2 * image.var()
    unique = []
    height, width = image.shape
    tops = np.unique(np.linspace(0, height - window, 48).astype(int))
    for top in tops:
        for left in range(width - window + 1 - search):
            patch = image[top : top + window, left : left + window]
            similarity = []
            for shift in range(window // 2 + 1, search + 1):
                candidate = image[top : top + window, left + shift : left + shift + window]
                covariance = ((patch - patch.mean()) * (candidate - candidate.mean())).mean()
                similarity.append(
                    covariance / np.sqrt((patch.var() + floor) * (candidate.var() + floor))
                )
            unique.append(max(similarity) < threshold and patch.var() > floor)
    return np.mean(unique)


def test_the_fast_path_equals_the_definition():
    pattern = quasirandom(fov_x_deg=30.0, fov_y_deg=13.0, width_px=80, fwhm_mrad=12.0)
    fast = unique_share(pattern.image, pattern.field, window_px=5, search_px=16)
    image = pattern.image.astype(np.float64)
    assert fast == pytest.approx(slow_unique_share(image, 5, 16, 0.8), abs=1e-9)


def test_isolated_spots_are_measured_exactly():
    """The logarithm of an isolated Gaussian is a parabola, so the fit is exact up to projection."""
    pattern = quasirandom(fov_x_deg=40.0, fov_y_deg=30.0, width_px=600, min_distance=0.75)
    assert pattern.dots is not None
    statistics = measure(pattern.image, fov_x_deg=40.0, fov_y_deg=30.0)
    assert statistics.dots == len(pattern.dots)
    assert statistics.fwhm_mrad == pytest.approx(8.3, rel=0.002)


def test_a_plateau_is_one_spot():
    image = np.zeros((64, 200))
    image[30:33, 40:44] = 1
    statistics = measure(image, fov_x_deg=60.0, fov_y_deg=20.0)
    assert statistics.dots == 1
    assert np.isnan(statistics.neighbour_mrad)


def test_statistics_are_frozen():
    statistics = stated_statistics(uniform(width_px=640), focal_px=400.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        statistics.dots = 1  # type: ignore[misc]


FLAT = Pattern(image=np.ones((60, 320), np.float32), fov_x_deg=60.0, fov_y_deg=12.0, name="flat")


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (
            lambda: stated_statistics(FLAT),
            r"pattern must carry its dots; got flat\. Use measure on its image",
        ),
        (
            lambda: measure(FLAT.image, fov_x_deg=60.0, fov_y_deg=12.0),
            r"image must hold a spot; got none\.",
        ),
        (
            lambda: measure(np.ones((8, 8)), fov_x_deg=60.0, fov_y_deg=12.0),
            r"image must be \(h, w\) with both sides >= 32; got \(8, 8\)\.",
        ),
        (
            lambda: unique_share(FLAT.image, FLAT.field, window_px=1),
            r"window_px must be an integer in \[3, 31\]; got 1\.",
        ),
        (
            lambda: unique_share(FLAT.image, FLAT.field, search_px=5),
            r"search_px must be an integer in \[11, 1024\]; got 5\.",
        ),
        (
            lambda: unique_share(FLAT.image, FLAT.field, threshold=2.0),
            r"threshold must be in \[0, 1\]; got 2\.0\.",
        ),
        (
            lambda: unique_share(FLAT.image, FLAT.field, search_px=310),
            r"image must be at least 332 px wide at the camera's scale; got 320x58\.",
        ),
        (
            lambda: unique_share(FLAT.image, FLAT.field, focal_px=0.0),
            r"focal_px must be > 0; got 0\.0\.",
        ),
        (
            lambda: unique_share(FLAT.image, FLAT.field, focal_px=1e5),
            r"focal_px must be in \[16, .*\]; got 100000\.0\.",
        ),
    ],
)
def test_refusals(act, message):
    with pytest.raises(InputError, match=message):
        act()
