"""Laws of the optics on rendered walls: effect of each aberration on images and depth.

Rationale: correlation of noise-free pairs of a fronto-parallel wall is accurate to 0.01 px, without
a matcher.
"""

import dataclasses
from functools import cache
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from starling.sim import metrics
from starling.sim.arrays import Image
from starling.sim.imaging.lens_input import LensInput, combine_light
from starling.sim.imaging.optics import image
from starling.sim.render import direct, mitsuba_scene
from starling.sim.render.layers import Layers
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Alignment, Imager, Lens, Sensor
from starling.sim.stereo.depth import depth_from_disparity

D435 = presets.load("d435")
FB = D435.focal_baseline_px_m
_REAL = Imager(quantum_efficiency=0.25, pixel_pitch_m=4.49e-6)
DISTANCES_M = tuple(FB / d for d in (40, 20, 10, 5))  # Whole disparities: equal sampling.


def sensor_with(
    *,
    left: Alignment | None = None,
    right: Alignment | None = None,
    lens: Lens | None = None,
    contrast: float = 0.0,
) -> Sensor:
    lens = lens or Lens(blur_px=0.6)
    return dataclasses.replace(
        D435,
        left=dataclasses.replace(_REAL, lens=lens, alignment=left or Alignment()),
        right=dataclasses.replace(_REAL, lens=lens, alignment=right or Alignment()),
        projector=dataclasses.replace(D435.projector, speckle_contrast=contrast),
    )


@cache
def wall(distance_m: float) -> tuple[mitsuba_scene.MitsubaScene, Layers]:
    mi_scene = mitsuba_scene.MitsubaScene(scenes.wall(distance_m))
    return mi_scene, direct.layers(mi_scene, D435)


def form(
    light: LensInput, layers: Layers, sensor: Sensor, side: Literal["left", "right"] = "left"
) -> Image:
    view = layers.left if side == "left" else layers.right
    return image.image(light, view.depth_m, sensor, side, seed=3)


def pair(distance_m: float, sensor: Sensor) -> tuple[Image, Image]:
    mi_scene, layers = wall(distance_m)
    left, right = (
        combine_light(view, mi_scene.scene, sensor, seed=0, frame=0)
        for view in (layers.left, layers.right)
    )
    return form(left, layers, sensor), form(right, layers, sensor, "right")


HALF = (120, 70)  # Half size of the window along x and y [px].
MARGIN = 40  # Search range of the window [px].


def around(seen: NDArray, column: float, row: float) -> NDArray:
    x, y = round(column), round(row)
    return np.ascontiguousarray(seen[y - HALF[1] : y + HALF[1], x - HALF[0] : x + HALF[0]])


def shift(distance_m: float, sensor: Sensor, column: float, row: float) -> float:
    """Deviation of the measured disparity from the wall's disparity, by correlation [px]."""
    left, right = pair(distance_m, sensor)
    disparity = round(FB / distance_m)
    left, right = around(left, column, row), around(right, column - disparity, row)
    return metrics.shift_px(left, right, near_px=0, margin_px=MARGIN)


def rise(distance_m: float, sensor: Sensor, column: float, row: float) -> float:
    """Vertical shift of the right image against the left, by correlation [px]."""
    left, right = pair(distance_m, sensor)
    disparity = round(FB / distance_m)
    left, right = around(left, column, row).T, around(right, column - disparity, row).T
    return -metrics.shift_px(left, right, near_px=0, margin_px=MARGIN)


def weighted(
    moved: tuple[NDArray, NDArray], distance_m: float, column: float, row: float
) -> tuple[float, float]:
    """Least-squares fit of a shift along x alone and along y alone to a field of shifts.

    To first order the misfit of a shift s along x is sum (I_x (u - s) + I_y v)^2.
    """
    seen = around(pair(distance_m, sensor_with())[0], column, row).astype(np.float64)
    inside = (slice(MARGIN, -MARGIN), slice(MARGIN, -MARGIN))
    down, across = np.gradient(seen, axis=0)[inside], np.gradient(seen, axis=1)[inside]
    u, v = (around(field, column, row)[inside] for field in moved)
    change = across * u + down * v
    return (
        float((across * change).sum() / (across**2).sum()),
        float((down * change).sum() / (down**2).sum()),
    )


CENTRE = (D435.cx_px, D435.cy_px)
ROWS, COLUMNS = np.indices((D435.height, D435.width), np.float64)


@pytest.mark.parametrize("offset", [-0.5, -0.13, 0.0, 0.3, 0.5])
@pytest.mark.parametrize("blur_px", [0.0, 0.6])
def test_a_vertical_offset_moves_the_correlation_peak(offset: float, blur_px: float) -> None:
    """The vertical shift is the offset to 0.002 px; the disparity is unchanged.

    Does not show the effect on a matcher.
    """
    sensor = sensor_with(right=Alignment(offset_y_px=offset), lens=Lens(blur_px=blur_px))
    assert rise(DISTANCES_M[1], sensor, *CENTRE) == pytest.approx(offset, abs=0.002)
    both = dataclasses.replace(sensor, left=sensor.right)
    assert rise(DISTANCES_M[1], both, *CENTRE) == pytest.approx(0, abs=0.002)
    assert shift(DISTANCES_M[1], both, *CENTRE) == pytest.approx(0, abs=0.002)


@pytest.mark.parametrize("roll_deg", [-0.1, 0.15])
def test_roll_tilts_the_rows(roll_deg: float) -> None:
    """dy = -roll x to 0.005 px: opposite at the left and the right edge.

    Does not show that a device rotates about its principal point.
    """
    sensor, distance = sensor_with(right=Alignment(roll_deg=roll_deg)), DISTANCES_M[1]
    angle = np.deg2rad(roll_deg)
    field = (angle * (ROWS - D435.cy_px), -angle * (COLUMNS - FB / distance - D435.cx_px))
    measured = {}
    for column in (200, 700):
        measured[column] = rise(distance, sensor, column, CENTRE[1])
        _, expected = weighted(field, distance, column, CENTRE[1])
        assert measured[column] == pytest.approx(expected, abs=0.005)
    assert measured[200] * measured[700] < -0.1


def test_pitch_moves_rows_apart_and_more_so_off_the_middle() -> None:
    """dy = f pitch (1 + y^2 / f^2) to 0.005 px; equal to a vertical offset but for the square."""
    pitch_deg, distance = 0.05, DISTANCES_M[1]
    sensor = sensor_with(right=Alignment(pitch_deg=pitch_deg))
    angle, down = np.deg2rad(pitch_deg), (ROWS - D435.cy_px) / D435.fy_px
    across = COLUMNS - FB / distance - D435.cx_px
    field = (angle * across * down, D435.fy_px * angle * (1 + down**2))
    for row in (90, 235, 390):
        _, expected = weighted(field, distance, 425, row)
        assert rise(distance, sensor, 425, row) == pytest.approx(expected, abs=0.005)
    assert np.ptp([rise(distance, sensor, 425, row) for row in (90, 235)]) > 0.03


def depths_m(sensor: Sensor) -> NDArray[np.float64]:
    """Depth from the wall's measured disparity at each distance [m]."""
    measured = [FB / z + shift(z, sensor, *CENTRE) for z in DISTANCES_M]
    return depth_from_disparity(np.array(measured), focal_px=FB, baseline_m=1.0).astype(np.float64)


@pytest.mark.parametrize(
    "alignment",
    [Alignment(offset_x_px=0.2), Alignment(yaw_deg=-float(np.rad2deg(0.2 / D435.fx_px)))],
)
def test_a_disparity_offset_gives_a_depth_error_quadratic_in_depth(alignment: Alignment) -> None:
    """d' = d - o, so z' - z = z z' o / (f b), to 1 %. To first order it grows with z^2.

    For yaw the tolerance is 3 %, since its shift grows off the axis by 1 + x^2 / f^2. Does not show
    the error of matched depth, to which a matcher adds its bias.
    """
    true = np.array(DISTANCES_M)
    seen = depths_m(sensor_with(right=alignment))
    tolerance = 0.03 if alignment.yaw_deg else 0.01
    np.testing.assert_allclose((seen - true) / (true * seen), 0.2 / FB, rtol=tolerance)
    slope = np.polyfit(np.log(true), np.log((seen - true) * true / seen), 1)[0]
    assert slope == pytest.approx(2, abs=0.01)


def test_a_focal_scale_gives_a_depth_error_proportional_to_depth() -> None:
    """d' = m d, so z' - z = z (1 / m - 1) to 1 %. A baseline error does just the same."""
    m = 0.99
    true = np.array(DISTANCES_M)
    both = Alignment(magnification=m)
    errors = depths_m(sensor_with(left=both, right=both)) - true
    np.testing.assert_allclose(errors / true, 1 / m - 1, rtol=0.01)


@pytest.mark.parametrize("distance_m", DISTANCES_M)
def test_distortion_shifts_disparity_equally_at_all_depths(distance_m: float) -> None:
    """Distortion moves x in the right image by s r^2 x / r_h^3, to 0.005 px."""
    sensor = sensor_with(right=Alignment(distortion_px=1.0))
    half_diagonal = np.hypot(D435.width, D435.height) / 2
    across = COLUMNS - FB / distance_m - D435.cx_px
    down = ROWS - D435.cy_px
    outwards = (across**2 + down**2) / half_diagonal**3
    for column, row in ((240, 110), (700, 390)):
        expected, _ = weighted((outwards * across, outwards * down), distance_m, column, row)
        assert abs(expected) > 0.04
        assert shift(distance_m, sensor, column, row) == pytest.approx(-expected, abs=0.005)


# Light.


def test_vignetting_stays_with_the_camera_and_dims_all_light() -> None:
    """The same map on two walls, near and far, lit by dots or by the room: cos^4 to 0.5 %.

    Does not show that a lens has this profile.
    """
    perfect, dimmed = sensor_with(lens=Lens()), sensor_with(lens=Lens(vignetting=4.0))
    square = ((COLUMNS - D435.cx_px) / D435.fx_px) ** 2 + ((ROWS - D435.cy_px) / D435.fy_px) ** 2
    for distance in (DISTANCES_M[0], DISTANCES_M[2]):
        mi_scene, layers = wall(distance)
        light = combine_light(layers.left, mi_scene.scene, D435, seed=0, frame=0)
        none = np.zeros_like(light.rest)
        for lit in (dataclasses.replace(light, laser=none), dataclasses.replace(light, rest=none)):
            before, after = (form(lit, layers, sensor) for sensor in (perfect, dimmed))
            bright = before > 0
            assert bright.mean() > 0.05
            expected = (1 + square[bright]) ** -2
            np.testing.assert_allclose(after[bright] / before[bright], expected, rtol=0.005)


@pytest.mark.parametrize(("width_nm", "lost"), [(60.0, 0.3), (30.0, 0.9)])
def test_the_filters_blue_shift_dims_dots_but_not_ambient_light(
    width_nm: float, lost: float
) -> None:
    """Towards the corner laser light falls; ambient light does not.

    The amount follows `starling.sim.scene.spectra`. Does not cover lamps with uneven spectra.
    """
    mi_scene, layers = wall(DISTANCES_M[1])
    light = combine_light(layers.left, mi_scene.scene, D435, seed=0, frame=0)
    none = np.zeros_like(light.laser)
    corner, middle = (slice(0, 60), slice(0, 60)), (slice(205, 265), slice(395, 455))
    for lit in (dataclasses.replace(light, rest=none), dataclasses.replace(light, laser=none)):
        bare = form(lit, layers, sensor_with(lens=Lens()))
        seen = form(lit, layers, sensor_with(lens=Lens(filter_width_nm=width_nm)))
        assert seen[middle].sum() / bare[middle].sum() == pytest.approx(1, abs=0.01)
        share = seen[corner].sum() / bare[corner].sum()
        assert share < 1 - lost if lit.rest is none else 1 < share < 1.4


def test_veiling_glare_is_an_even_pedestal() -> None:
    """L' = (1 - v) L + v mean: an even pedestal for any albedo, with unchanged mean.

    Does not cover ghosts, or glare from light outside the image.
    """
    mi_scene = mitsuba_scene.MitsubaScene(scenes.tabletop())
    layers = direct.layers(mi_scene, D435)
    light = combine_light(layers.left, mi_scene.scene, D435, seed=0, frame=0)
    clear = form(light, layers, sensor_with()).astype(np.float64)
    veiled = form(light, layers, sensor_with(lens=Lens(blur_px=0.6, veil=0.05))).astype(np.float64)
    assert veiled.mean() == pytest.approx(clear.mean(), rel=1e-5)
    pedestal = veiled - 0.95 * clear
    assert pedestal.mean() == pytest.approx(0.05 * clear.mean(), rel=1e-5)
    assert np.ptp(pedestal) < 1e-6 * clear.max()  # Rounding of float32.


@pytest.mark.parametrize("distance_m", DISTANCES_M)
def test_defocus_widens_by_depth(distance_m: float) -> None:
    """Sigma of a wall's defocus is k |1/z - 1/z_f| to 5 %, and 0 in focus.

    It is measured by the best-fitting Gaussian blur in the frequency domain. Does not show that the
    spot is Gaussian (a real one is nearly a disc), nor the effect at depth edges.
    """
    k, focus_m = 0.6, DISTANCES_M[1]
    sharp, soft = (
        pair(distance_m, sensor_with(lens=lens))[0].astype(np.float64)
        for lens in (Lens(blur_px=0.6), Lens(blur_px=0.6, defocus_px_m=k, focus_m=focus_m))
    )
    wanted = k * abs(1 / distance_m - 1 / focus_m)
    if distance_m == focus_m:
        np.testing.assert_allclose(soft, sharp, rtol=1e-4, atol=1e-6 * sharp.max())
        return
    assert wanted > 0.2
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(soft.shape[1]), np.fft.fftfreq(len(soft))))
    spectrum, inside = np.fft.fft2(sharp), (slice(60, -60), slice(120, -120))
    sigmas = wanted * np.arange(0.9, 1.1, 0.01)
    misfits = [
        (
            (np.fft.ifft2(spectrum * np.exp(-2 * (np.pi * s * frequency) ** 2)).real - soft)[inside]
            ** 2
        ).sum()
        for s in sigmas
    ]
    assert sigmas[int(np.argmin(misfits))] == pytest.approx(wanted, rel=0.05)


@pytest.mark.parametrize("contrast", [0.05, 0.2, 0.5])
def test_speckle_through_the_optics(contrast: float) -> None:
    """Speckle has the set contrast to 3 %; ambient light has none.

    It is independent in the imagers and equal in all frames.

    Does not cover a real device's grain size, or motion of the grains with scene or camera.
    """
    _, layers = wall(DISTANCES_M[1])
    even = np.ones((D435.height, D435.width), np.float32)
    none = np.zeros_like(even)
    sensor = sensor_with(contrast=contrast)
    laser, room = LensInput(laser=even, rest=none), LensInput(laser=none, rest=even)
    left, right = form(laser, layers, sensor), form(laser, layers, sensor, "right")
    for seen in (left, right):
        assert seen.mean(dtype=float) == pytest.approx(1, abs=0.01)
        assert seen.std() / seen.mean() == pytest.approx(contrast, rel=0.03)
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.01
    assert np.array_equal(form(laser, layers, sensor), left)
    np.testing.assert_allclose(form(room, layers, sensor), even, rtol=1e-5)
