"""Dot lattices: positions of their dots, and their detection in a pattern."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling import patterns
from starling.calibration.pattern import lattice
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.unprojected import PatternImage

GRID = Grid(half_a=0.6, half_b=0.4, step=1.6e-3)
SIGMA = 2e-3  # Width of a dot, in cosines.

keystones = st.tuples(st.floats(-0.03, 0.03), st.floats(-0.03, 0.03)).map(np.array)
lattices = st.builds(
    lambda pitch, ratio, angle, phase: _lattice(pitch, ratio, angle, phase),
    st.floats(0.01, 0.02),
    st.floats(0.8, 1.25),
    st.floats(0, 90),
    st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
)


def _lattice(
    pitch: float, ratio: float, angle_deg: float, phase: tuple[float, float] = (0.1, -0.3)
) -> Lattice:
    """Return a lattice with rectangular cells, `pitch` by `ratio * pitch`."""
    angle = np.radians(angle_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return Lattice(
        frequencies=np.diag([1 / pitch, 1 / (ratio * pitch)]) @ turn.T, phase=np.array(phase)
    )


def _pattern(dots: np.ndarray, noise: float = 0.3, missing: bool = True) -> PatternImage:
    """Return a noisy image of Gaussian dots (n, 2), without coverage in one corner."""
    a, b = GRID.cosines()
    image = np.zeros(GRID.shape)
    reach = int(np.ceil(4 * SIGMA / GRID.step))
    for x, y in dots:
        i = np.arange(*np.clip(np.searchsorted(a, x) + np.array([-reach, reach]), 0, len(a)))
        j = np.arange(*np.clip(np.searchsorted(b, y) + np.array([-reach, reach]), 0, len(b)))
        across = np.exp(-((a[i] - x) ** 2) / (2 * SIGMA**2))
        down = np.exp(-((b[j] - y) ** 2) / (2 * SIGMA**2))
        image[np.ix_(j, i)] += down[:, None] * across[None, :]
    image = (image - image.mean()) / image.std()
    image += noise * np.random.default_rng(0).standard_normal(image.shape)
    sd = np.full(image.shape, noise)
    if missing:
        sd[: len(b) // 5, : len(a) // 5] = np.inf
        image[np.isinf(sd)] = 0
    return PatternImage(
        grid=GRID, value=image.astype(np.float32), sd=sd, views=np.isfinite(sd).astype(np.float32)
    )


def _same_dots(fitted: Lattice, truth: Lattice) -> None:
    """Assert that two lattices have the same dots.

    Bases of a lattice are related by an integer matrix of determinant +-1.
    """
    whole = fitted.frequencies @ truth.pitch
    np.testing.assert_allclose(whole, np.rint(whole), atol=2e-3)
    assert abs(np.linalg.det(whole)) == pytest.approx(1, abs=4e-3)
    basis = np.rint(whole) @ truth.frequencies
    off = np.linalg.norm(fitted.frequencies - basis, axis=1) / np.linalg.norm(basis, axis=1)
    assert off.max() < 1e-3
    phase = fitted.phase - np.rint(whole) @ truth.phase
    assert np.abs(phase - np.rint(phase)).max() < 0.02


@given(lattices, keystones)
def test_dots_have_integer_lattice_coordinates(example: Lattice, keystone: np.ndarray) -> None:
    example = dataclasses.replace(example, keystone=keystone)
    dots = example.dots(0.3, 0.2)
    even = dots * (1 - dots @ keystone)[:, None]
    steps = even @ example.frequencies.T - example.phase
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert len(np.unique(np.rint(steps), axis=0)) == len(dots)
    # The count equals area over cell area, except for dots at the border.
    area, cell = 0.6 * 0.4, abs(np.linalg.det(example.pitch))
    border = 2 * (0.6 + 0.4) * np.linalg.norm(example.pitch, axis=0).max()
    assert abs(len(dots) - area / cell) < 1.1 * border / cell


@given(lattices, keystones, st.tuples(st.floats(-0.2, 0.2), st.floats(-0.15, 0.15)))
def test_nearest_returns_the_dot_and_the_offset(
    example: Lattice, keystone: np.ndarray, direction: tuple[float, float]
) -> None:
    """Offset and distance refer to the lattice without keystone."""
    example = dataclasses.replace(example, keystone=keystone)
    cosines = np.array([direction])
    number, way = example.nearest(cosines)
    even = cosines * (1 - cosines @ keystone)
    np.testing.assert_allclose(
        (even - way) @ example.frequencies.T - example.phase, number, atol=1e-9
    )
    dots = example.dots(0.3, 0.3)
    dots = dots * (1 - dots @ keystone)[:, None]
    nearest = np.linalg.norm(dots - even, axis=1).min()
    assert np.linalg.norm(way) == pytest.approx(nearest, abs=1e-6)


@given(keystones)
def test_a_keystone_widens_towards_its_side(keystone: np.ndarray) -> None:
    """Two opposite dots have the local scale 1 + k . a, to first order."""
    plain = dataclasses.replace(_lattice(0.0123, 1.0, 0.0), phase=np.zeros(2))
    wide = dataclasses.replace(plain, keystone=keystone)
    place = plain.pitch @ np.array([10, 0])
    for way in (place, -place):
        dots = wide.dots(0.3, 0.3)
        off = np.linalg.norm(dots - way, axis=1).argmin()
        scale = np.linalg.norm(dots[off]) / np.linalg.norm(way)
        assert scale == pytest.approx(1 + keystone @ way, abs=1e-4)


@given(lattices)
@settings(max_examples=4)
def test_one_lattice_is_found(example: Lattice) -> None:
    """Noise and a missing corner allow 1e-3 of a frequency and 0.02 of a phase."""
    detected = lattice.find(_pattern(example.dots(0.6, 0.4)))
    assert len(detected) == 1
    _same_dots(detected[0], example)


@pytest.mark.parametrize("twist_deg", [5.0, 11.0, 30.0])
def test_two_twisted_lattices_are_found(twist_deg: float) -> None:
    """Neither combination frequencies nor multiples give a third lattice."""
    first = _lattice(0.0123, 1.0, 49.0)
    second = _lattice(0.0123, 1.0, 49.0 + twist_deg, phase=(0.4, 0.2))
    dots = np.concatenate([first.dots(0.6, 0.4), second.dots(0.6, 0.4)])
    detected = lattice.find(_pattern(dots))
    assert len(detected) == 2
    for truth in (first, second):
        angles = [_angle(fitted, truth) for fitted in detected]
        _same_dots(detected[int(np.argmin(angles))], truth)


def _angle(fitted: Lattice, truth: Lattice) -> float:
    whole = fitted.frequencies @ truth.pitch
    return float(np.abs(whole - np.rint(whole)).max())


@pytest.mark.parametrize("seed", range(3))
def test_irregular_dots_give_no_lattice(seed: int) -> None:
    drawn = patterns.quasirandom(fov_x_deg=74.0, fov_y_deg=48.0, seed=seed)
    assert drawn.dots is not None
    height, width = drawn.image.shape
    x, y = drawn.field.tangents(drawn.dots[:, 0], drawn.dots[:, 1], (height, width))
    far = np.sqrt(1 + x**2 + y**2)
    assert lattice.find(_pattern(np.stack([x / far, y / far], axis=1))) == ()


def test_noise_gives_no_lattice() -> None:
    """White noise of unit deviation gives no lattice."""
    rng = np.random.default_rng(1)
    sd = np.ones(GRID.shape)
    noise = rng.standard_normal(GRID.shape).astype(np.float32)
    assert lattice.find(PatternImage(grid=GRID, value=noise, sd=sd, views=sd)) == ()


def test_a_pattern_without_coverage_gives_no_lattice() -> None:
    nothing = np.zeros(GRID.shape, np.float32)
    blind = PatternImage(grid=GRID, value=nothing, sd=nothing + np.inf, views=nothing)
    assert lattice.find(blind) == ()
