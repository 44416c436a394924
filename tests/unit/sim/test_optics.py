"""Single stages of the lens, on synthetic images."""

import dataclasses
from typing import Literal

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim.arrays import Image
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager.charge import Die
from starling.sim.imaging.lens_input import LensInput
from starling.sim.imaging.optics import alignment, image, shading, spot
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Alignment, Imager, Lens, Sensor

PINHOLE = Pinhole(width=161, height=121, fx_px=100.0, fy_px=110.0, cx_px=70.3, cy_px=50.8)
DIE = Die(0, "right")  # Selects waves, which no test here has.
SHAPE = (PINHOLE.height, PINHOLE.width)
SIGMA = st.floats(0.05, 3.0)


def point(column: int, row: int) -> np.ndarray:
    generated = np.zeros(SHAPE, np.float32)
    generated[row, column] = 1
    return generated


def moments(seen: np.ndarray) -> tuple[float, float, float, float]:
    """Centroid x, y and variances along x, y [px, px^2]."""
    rows, columns = np.indices(seen.shape)
    total = seen.sum(dtype=np.float64)
    x, y = (seen * columns).sum() / total, (seen * rows).sum() / total
    return x, y, (seen * (columns - x) ** 2).sum() / total, (seen * (rows - y) ** 2).sum() / total


def texture(seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).random(SHAPE, np.float32)
    return spot.blur(noise, 1.5)


# The spot.


@given(SIGMA)
def test_a_point_is_as_wide_as_set(sigma: float) -> None:
    """Second moment to 1 %, also far below a pixel; not that a real spot is Gaussian."""
    _, _, across, down = moments(spot.blur(point(80, 60), sigma))
    assert (across, down) == pytest.approx((sigma**2, sigma**2), rel=0.01)


@given(SIGMA, SIGMA)
def test_blurs_add_in_quadrature(first: float, second: float) -> None:
    """The same image as one blur of the summed variance, to 0.5 % of the peak."""
    twice = spot.blur(spot.blur(point(80, 60), first), second)
    once = spot.blur(point(80, 60), float(np.hypot(first, second)))
    np.testing.assert_allclose(twice, once, atol=0.005 * once.max())


@given(SIGMA, st.integers(0, 99))
def test_blur_keeps_the_light(sigma: float, seed: int) -> None:
    seen = texture(seed)
    blurred = spot.blur(seen, sigma)
    assert blurred.mean(dtype=float) == pytest.approx(seen.mean(dtype=float), rel=1e-5)


@given(
    st.floats(0, 1.5),
    st.floats(0.1, 2),
    st.floats(0, 2),
    st.floats(0.1, 10),
    st.sampled_from([(20, 25), (70, 51), (130, 90)]),
)
def test_spots_variance_is_the_sum(
    even: float, corner: float, defocus: float, depth: float, place: tuple[int, int]
) -> None:
    """Even blur, corner blur and defocus together, second moment to 2 %.

    Does not show the spot's shape, nor what happens at depth edges, where each pixel gathers by
    its own spot.
    """
    lens = Lens(blur_px=even, corner_blur_px=corner, defocus_px_m=defocus, focus_m=1.3)
    depth_m = np.full(SHAPE, depth, np.float32)
    column, row = place
    wanted = even**2 + defocus**2 * (1 / depth - 1 / 1.3) ** 2
    radius = np.hypot(column - PINHOLE.cx_px, row - PINHOLE.cy_px)
    wanted += corner**2 * (radius / PINHOLE.half_diagonal_px) ** 2
    assert spot.variance(depth_m, lens, PINHOLE)[row, column] == pytest.approx(wanted, rel=1e-3)
    # A pixel's blurred square of the distance from it is the second moment of its spot.
    rows, columns = np.indices(SHAPE, np.float32)
    squares = ((columns - column) ** 2, (rows - row) ** 2)
    for square in spot.blur_by_spot(squares, depth_m, lens, PINHOLE):
        reached = 4 * np.sqrt(wanted) + 2 < min(column, row, 160 - column, 120 - row)
        if reached:  # Otherwise the mirrored border counts.
            assert square[row, column] == pytest.approx(wanted, rel=0.02, abs=2e-3)


def test_missing_depth_counts_as_far_and_focus_is_sharp() -> None:
    lens = Lens(defocus_px_m=0.8, focus_m=0.5)
    depth_m = np.full(SHAPE, 0.5, np.float32)
    (seen,) = spot.blur_by_spot((texture(),), depth_m, lens, PINHOLE)
    assert np.array_equal(seen, texture())
    nothing, far = np.full(SHAPE, np.nan, np.float32), np.full(SHAPE, np.inf, np.float32)
    wanted = spot.variance(nothing, lens, PINHOLE)
    assert np.array_equal(wanted, spot.variance(far, lens, PINHOLE))
    assert wanted[0, 0] == pytest.approx((0.8 / 0.5) ** 2)


def test_defocus_of_a_surface_in_the_lens_is_finite() -> None:
    """It is that at 1 mm; a scene can touch the camera."""
    lens = Lens(defocus_px_m=0.1, focus_m=1.0)
    depths = (np.full(SHAPE, depth_m, np.float32) for depth_m in (0.0, 1e-30, 1e-3))
    spots = [spot.variance(depth_m, lens, PINHOLE) for depth_m in depths]
    assert np.array_equal(spots[0], spots[1]) and np.allclose(spots[1], spots[2])
    assert np.isfinite(spots[0]).all()


# Alignment.


def seen_at(settings: Alignment, column: int, row: int) -> tuple[float, float]:
    (moved,) = alignment.misalign((spot.blur(point(column, row), 1.0),), settings, PINHOLE, DIE)
    x, y, *_ = moments(moved)
    return x, y


@pytest.mark.parametrize("place", [(40, 40), (70, 50), (120, 30), (110, 90)])
@pytest.mark.parametrize("angles", [(2.0, 0, 0), (0, -3.0, 0), (0, 0, 5.0), (1.0, 2.0, -3.0)])
def test_a_turned_imager_agrees_with_opencv(
    place: tuple[int, int], angles: tuple[float, float, float]
) -> None:
    pitch, yaw, roll = angles
    magnification = 1.03
    result = seen_at(
        Alignment(pitch_deg=pitch, yaw_deg=yaw, roll_deg=roll, magnification=magnification), *place
    )
    across = (place[0] - PINHOLE.cx_px) / PINHOLE.fx_px
    down = (place[1] - PINHOLE.cy_px) / PINHOLE.fy_px
    ray = np.array([[across, down, 1.0]])
    camera = np.array(
        [
            [PINHOLE.fx_px * magnification, 0, PINHOLE.cx_px],
            [0, PINHOLE.fy_px * magnification, PINHOLE.cy_px],
            [0, 0, 1],
        ]
    )
    imager_from_ideal = -np.deg2rad([pitch, yaw, roll])
    expected, _ = cv2.projectPoints(ray, imager_from_ideal, np.zeros(3), camera, None)
    assert result == pytest.approx(tuple(expected.ravel()), abs=0.01)


@pytest.mark.parametrize(
    ("settings", "direction"),
    [
        (Alignment(pitch_deg=1.0), (0, 1)),
        (Alignment(yaw_deg=1.0), (-1, 0)),
        (Alignment(offset_x_px=1.7), (1, 0)),
        (Alignment(offset_y_px=1.7), (0, 1)),
        (Alignment(roll_deg=5.0), (0, -1)),  # Of a point right of the centre.
        (Alignment(magnification=1.05), (1, 0)),
        (Alignment(distortion_px=9.0), (1, 0)),
    ],
)
def test_signs_are_as_documented(settings: Alignment, direction: tuple[int, int]) -> None:
    place = (100, 51)
    x, y = seen_at(settings, *place)
    moved = np.array([x - place[0], y - place[1]])
    assert moved @ direction > 0.2
    assert abs(moved @ (direction[1], -direction[0])) < 0.35 * (moved @ direction)


@given(st.floats(-5, 5), st.floats(-5, 5))
def test_a_shifted_dot_is_as_wide_as_before(dx: float, dy: float) -> None:
    """Interpolation moves by exactly the offset and adds no blur (first and second moment).

    Does not show that fine texture keeps its contrast: near the pixels' limit it loses some.
    """
    dot = spot.blur(point(80, 60), 0.8)
    (moved,) = alignment.misalign((dot,), Alignment(offset_x_px=dx, offset_y_px=dy), PINHOLE, DIE)
    x, y, across, down = moments(moved)
    assert (x - 80, y - 60) == pytest.approx((dx, dy), abs=1e-3)
    assert (across, down) == pytest.approx((0.64, 0.64), rel=0.01)


def test_whole_pixels_are_exact_and_the_edge_repeats() -> None:
    seen = texture()
    (moved,) = alignment.misalign((seen,), Alignment(offset_x_px=3, offset_y_px=-2), PINHOLE, DIE)
    assert np.array_equal(moved[:-2, 3:], seen[2:, :-3])
    assert np.array_equal(moved[:-2, 0], seen[2:, 0])
    assert np.array_equal(moved[-1, 3:], seen[-1, :-3])


@pytest.mark.parametrize(
    ("place", "shift"), [((120, 30), 0.5), ((40, 90), -0.5), ((80, 30), 0.25), ((120, 90), 0.3)]
)
def test_a_warp_shifts_right_by_its_cells(place: tuple[int, int], shift: float) -> None:
    """At the middles of cells as stated, between two of them by their mean."""
    x, y = seen_at(Alignment(warp_px=((0.0, 0.5), (-0.5, 0.3))), *place)
    assert x - place[0] == pytest.approx(shift, abs=0.02)
    assert y == pytest.approx(place[1], abs=0.02)


def test_an_undone_alignment_brings_a_dot_back() -> None:
    """Offset, roll and warp, to first order: a dot returns to its place within 0.02 px."""
    shifted = Alignment(offset_x_px=0.6, offset_y_px=-0.4, roll_deg=0.1, warp_px=((0.3,),))
    dot = spot.blur(point(80, 60), 1.0)
    seen = alignment.misalign((dot,), shifted, PINHOLE, DIE)
    (back,) = alignment.misalign(seen, alignment.undone(shifted), PINHOLE, DIE)
    assert moments(back)[:2] == pytest.approx((80, 60), abs=0.02)
    assert moments(seen[0])[0] > 80.5


def test_a_warp_of_one_value_is_an_offset() -> None:
    dot = spot.blur(point(80, 60), 1.0)
    warped = alignment.misalign((dot,), Alignment(warp_px=((0.37,),)), PINHOLE, DIE)
    shifted = alignment.misalign((dot,), Alignment(offset_x_px=0.37), PINHOLE, DIE)
    np.testing.assert_allclose(warped, shifted, atol=1e-6)


@pytest.mark.parametrize(
    ("cells", "rule"),
    [
        (((0.0, 1.0), (0.0,)), "rows of one length"),
        (((),), "rows of one length"),
        (((0.0, 60.0),), "must be in"),
    ],
)
def test_invalid_warps_are_refused(cells: tuple[tuple[float, ...], ...], rule: str) -> None:
    with pytest.raises(InputError, match=f"alignment.warp_px.*{rule}"):
        Alignment(warp_px=cells)


@pytest.mark.parametrize("strength", [-4.0, 2.0])
def test_distortion_is_cubic_in_the_radius(strength: float) -> None:
    for place in [(20, 20), (70, 100), (140, 90), (150, 51)]:
        offset = np.array(place) - (PINHOLE.cx_px, PINHOLE.cy_px)
        moved = np.array(seen_at(Alignment(distortion_px=strength), *place)) - place
        radius = np.hypot(*offset)
        landed = radius + moved @ offset / radius
        expected = strength * (landed / PINHOLE.half_diagonal_px) ** 3
        assert moved @ offset / radius == pytest.approx(expected, abs=0.02)
        assert abs(moved @ (-offset[1], offset[0]) / radius) < 0.01


# Vignetting, filter, veil.


@pytest.mark.parametrize("exponent", [1.0, 2.5, 4.0])
def test_vignetting_is_a_power_of_the_cosine(exponent: float) -> None:
    """To 0.5 %. Does not show that a real lens follows any such power."""
    result = shading.vignetting(exponent, PINHOLE)
    for column, row in [(0, 0), (70, 51), (160, 120), (160, 0)]:
        ray = ((column - PINHOLE.cx_px) / 100, (row - PINHOLE.cy_px) / 110, 1.0)
        cosine = 1 / np.linalg.norm(ray)
        assert result[row, column] == pytest.approx(cosine**exponent, rel=0.005)


def test_the_filter_dims_the_laser_in_corners_and_not_the_rest() -> None:
    lens = Lens(filter_width_nm=30.0, vignetting=2.0)
    imager = Imager(lens=lens, quantum_efficiency=0.25)
    even = shading.vignetting(2.0, PINHOLE)
    laser = shading.laser(imager.lens, 850.0, PINHOLE) / even
    rest = shading.rest(imager.lens, imager.quantum_efficiency, 850.0, PINHOLE) / even
    # The band has moved from 850 to 850 sqrt(1 - (sin a / n)^2) nm.
    angle = PINHOLE.angle()[120, 160]
    left_nm = 850 - 850 / np.sqrt(1 - (np.sin(angle) / 2) ** 2)
    assert laser[120, 160] == pytest.approx(1 / (1 + (2 * left_nm / 30) ** 6), rel=1e-3)
    assert laser[51, 70] == pytest.approx(1, abs=1e-3)
    assert laser[120, 160] < 0.01
    assert 1 < rest[120, 160] < 1.35


@given(st.floats(0.001, 1.0), st.integers(0, 99))
def test_veiling_glare_keeps_the_mean_and_adds_no_structure(share: float, seed: int) -> None:
    seen = texture(seed)
    veiled = image.add_veiling_glare(seen, share)
    assert veiled.mean(dtype=float) == pytest.approx(seen.mean(dtype=float), rel=1e-5)
    pedestal = veiled.astype(float) - (1 - share) * seen
    assert np.ptp(pedestal) < 1e-6
    assert pedestal.mean() == pytest.approx(share * seen.mean(dtype=float), rel=1e-4, abs=1e-7)


# The whole.


def sensor_with(
    lens: Lens | None = None, alignment: Alignment | None = None, contrast: float = 0.0
) -> Sensor:
    base = presets.load("d435")
    imager = Imager(lens=lens or Lens(), alignment=alignment or Alignment(), pixel_pitch_m=4.49e-6)
    return dataclasses.replace(
        base,
        width=PINHOLE.width,
        height=PINHOLE.height,
        fx_px=PINHOLE.fx_px,
        fy_px=PINHOLE.fy_px,
        cx_px=PINHOLE.cx_px,
        cy_px=PINHOLE.cy_px,
        left=imager,
        right=imager,
        projector=dataclasses.replace(base.projector, speckle_contrast=contrast),
    )


def form(
    sensor: Sensor,
    laser: Image,
    rest: Image,
    side: Literal["left", "right"] = "left",
    seed: int = 0,
) -> Image:
    depth_m = np.full(SHAPE, 0.7, np.float32)
    return image.image(LensInput(laser=laser, rest=rest), depth_m, sensor, side, seed=seed)


def test_neutral_stages_return_the_input() -> None:
    parts = (texture(), texture(1))
    depth_m = np.ones(SHAPE, np.float32)
    focused = Lens(focus_m=0.3, filter_index=1.7, filter_centre_nm=870.0)
    assert all(
        a is b
        for a, b in zip(spot.blur_by_spot(parts, depth_m, focused, PINHOLE), parts, strict=True)
    )
    assert alignment.misalign(parts, Alignment(), PINHOLE, DIE) is parts
    assert image.add_veiling_glare(parts[0], 0.0) is parts[0]
    assert spot.blur(parts[0], 0.0) is parts[0]
    formed = form(sensor_with(focused), *parts)
    assert np.array_equal(formed, parts[0] + parts[1])


def test_sum_of_lights_does_not_depend_on_separation() -> None:
    """A filter that passes all light gives the same image as no filter."""
    lens = Lens(blur_px=0.7, corner_blur_px=0.5, vignetting=3.0, veil=0.02)
    settings = Alignment(roll_deg=0.3, offset_y_px=0.4)
    apart = dataclasses.replace(lens, filter_width_nm=500.0, filter_index=5.0)
    parts = (texture(), texture(1))
    together = form(sensor_with(lens, settings), *parts)
    summed = form(sensor_with(apart, settings), *parts)
    np.testing.assert_allclose(summed, together, rtol=0.02)


def test_invalid_filters_are_refused() -> None:
    with pytest.raises(InputError, match="filter width"):
        form(sensor_with(Lens(filter_width_nm=1.0)), texture(), texture())


def test_speckle_is_the_lasers_alone_and_stays() -> None:
    """Ambient light keeps its bits; frames share the grains; seeds and sides do not.

    Does not show that the grains move with scene or camera; a motion needs a new draw.
    """
    ones, none = np.ones(SHAPE, np.float32), np.zeros(SHAPE, np.float32)
    sensor = sensor_with(contrast=0.3)
    laser = form(sensor, ones, none)
    assert np.array_equal(form(sensor, none, texture()), texture())
    assert np.array_equal(form(sensor, ones, none), laser)
    assert not np.array_equal(form(sensor, ones, none, seed=1), laser)
    assert not np.array_equal(form(sensor, ones, none, side="right"), laser)
    half = form(sensor, np.float32(0.5) * ones, none)
    np.testing.assert_allclose(half, 0.5 * laser, rtol=1e-6)


def test_vignetting_applies_together_with_speckle() -> None:
    ones = np.ones(SHAPE, np.float32)
    dimmed, plain = (
        form(sensor_with(Lens(vignetting=exponent), contrast=0.2), ones, ones, seed=4)
        for exponent in (3.0, 0.0)
    )
    np.testing.assert_allclose(dimmed / plain, shading.vignetting(3.0, PINHOLE), rtol=1e-4)


def test_each_side_has_its_own_lens() -> None:
    ones, sensor = np.ones(SHAPE, np.float32), sensor_with(Lens())
    dim = dataclasses.replace(sensor.right, lens=Lens(vignetting=4.0))
    sensor = dataclasses.replace(sensor, right=dim)
    left, right = (form(sensor, ones, ones, side) for side in ("left", "right"))
    assert left[0, 0] == pytest.approx(2) and right[0, 0] < 1.9


def test_a_warp_is_cubic_between_cells() -> None:
    cells = ((0.0, 1.0, 1.0, 0.0),) * 4
    result = alignment.warp(Alignment(warp_px=cells), (9, 9))
    np.testing.assert_allclose(result[:, 4], 1.1875, atol=1e-5)  # A line would have 1 there.
