"""Laws of the optics on rendered walls: what each departure does to images and to depth.

Rationale: noise-free pairs of a fronto-parallel wall correlate to a hundredth of a pixel without a
matcher, so geometric laws can be held to that.
"""

import dataclasses
from functools import cache
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from starling.sim import metrics
from starling.sim.imaging.lens_input import Received, received
from starling.sim.imaging.optics import image
from starling.sim.render import direct, mitsuba_scene
from starling.sim.render.layers import Image, Layers
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
def wall(distance_m: float) -> tuple[mitsuba_scene.Stage, Layers]:
    made = mitsuba_scene.Stage(scenes.wall(distance_m))
    return made, direct.layers(made, D435)


def form(
    light: Received, layers: Layers, sensor: Sensor, side: Literal["left", "right"] = "left"
) -> Image:
    view = layers.left if side == "left" else layers.right
    return image.image(light, view.depth_m, sensor, side, seed=3)


def pair(distance_m: float, sensor: Sensor) -> tuple[Image, Image]:
    made, layers = wall(distance_m)
    left, right = (
        received(view, made.scene, sensor, seed=0, frame=0) for view in (layers.left, layers.right)
    )
    return form(left, layers, sensor), form(right, layers, sensor, "right")


HALF = (120, 70)  # Of a window about a pixel, along x and y [px].
MARGIN = 40  # Of the window, for the search [px].


def around(seen: NDArray, column: float, row: float) -> NDArray:
    x, y = round(column), round(row)
    return np.ascontiguousarray(seen[y - HALF[1] : y + HALF[1], x - HALF[0] : x + HALF[0]])


def shift(distance_m: float, sensor: Sensor, column: float, row: float) -> float:
    """How far left of a thing's column less the wall's disparity the right imager sees it."""
    left, right = pair(distance_m, sensor)
    disparity = round(FB / distance_m)
    left, right = around(left, column, row), around(right, column - disparity, row)
    return metrics.shift_px(left, right, near_px=0, margin_px=MARGIN)


def rise(distance_m: float, sensor: Sensor, column: float, row: float) -> float:
    """How far below its row in the left image the right one sees a thing, by correlation."""
    left, right = pair(distance_m, sensor)
    disparity = round(FB / distance_m)
    left, right = around(left, column, row).T, around(right, column - disparity, row).T
    return -metrics.shift_px(left, right, near_px=0, margin_px=MARGIN)


def weighted(
    moved: tuple[NDArray, NDArray], distance_m: float, column: float, row: float
) -> tuple[float, float]:
    """Shift along x alone and along y alone that fit a field (x, y) of shifts by least squares.

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
    """By the offset to 0.002 px, and the disparity not at all.

    Does not show what a matcher makes of rows that do not correspond.
    """
    sensor = sensor_with(right=Alignment(offset_y_px=offset), lens=Lens(blur_px=blur_px))
    assert rise(DISTANCES_M[1], sensor, *CENTRE) == pytest.approx(offset, abs=0.002)
    both = dataclasses.replace(sensor, left=sensor.right)
    assert rise(DISTANCES_M[1], both, *CENTRE) == pytest.approx(0, abs=0.002)
    assert shift(DISTANCES_M[1], both, *CENTRE) == pytest.approx(0, abs=0.002)


@pytest.mark.parametrize("roll_deg", [-0.1, 0.15])
def test_roll_tilts_the_rows(roll_deg: float) -> None:
    """dy = -roll x to 0.005 px: opposite at the left and the right edge.

    Does not show that a device turns about its principal point.
    """
    sensor, distance = sensor_with(right=Alignment(roll_deg=roll_deg)), DISTANCES_M[1]
    angle = np.deg2rad(roll_deg)
    field = (angle * (ROWS - D435.cy_px), -angle * (COLUMNS - FB / distance - D435.cx_px))
    found = {}
    for column in (200, 700):
        found[column] = rise(distance, sensor, column, CENTRE[1])
        _, expected = weighted(field, distance, column, CENTRE[1])
        assert found[column] == pytest.approx(expected, abs=0.005)
    assert found[200] * found[700] < -0.1


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
    """Depth that the wall's disparity gives, at each of the distances [m]."""
    found = [FB / z + shift(z, sensor, *CENTRE) for z in DISTANCES_M]
    return depth_from_disparity(np.array(found), focal_px=FB, baseline_m=1.0).astype(np.float64)


@pytest.mark.parametrize(
    "alignment",
    [Alignment(offset_x_px=0.2), Alignment(yaw_deg=-float(np.rad2deg(0.2 / D435.fx_px)))],
)
def test_a_disparity_offset_errs_with_the_square_of_depth(alignment: Alignment) -> None:
    """d' = d - o, so z' - z = z z' o / (f b): z^2 to first order, to 1 % (yaw: 3 %, for it grows
    off the axis by 1 + x^2 / f^2).

    Does not show that matched depth errs alike: a matcher adds its own bias.
    """
    true = np.array(DISTANCES_M)
    seen = depths_m(sensor_with(right=alignment))
    tolerance = 0.03 if alignment.yaw_deg else 0.01
    np.testing.assert_allclose((seen - true) / (true * seen), 0.2 / FB, rtol=tolerance)
    slope = np.polyfit(np.log(true), np.log((seen - true) * true / seen), 1)[0]
    assert slope == pytest.approx(2, abs=0.01)


def test_a_focal_scale_errs_in_proportion_to_depth() -> None:
    """d' = m d, so z' - z = z (1 / m - 1) to 1 %. A baseline error does just the same."""
    m = 0.99
    true = np.array(DISTANCES_M)
    both = Alignment(magnification=m)
    errors = depths_m(sensor_with(left=both, right=both)) - true
    np.testing.assert_allclose(errors / true, 1 / m - 1, rtol=0.01)


@pytest.mark.parametrize("distance_m", DISTANCES_M)
def test_distortion_shifts_disparity_alike_at_every_depth(distance_m: float) -> None:
    """In the right image x moves by s r^2 x / r_h^3, whatever is seen there, to 0.005 px."""
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
        made, layers = wall(distance)
        light = received(layers.left, made.scene, D435, seed=0, frame=0)
        none = np.zeros_like(light.rest)
        for lit in (dataclasses.replace(light, laser=none), dataclasses.replace(light, rest=none)):
            before, after = (form(lit, layers, sensor) for sensor in (perfect, dimmed))
            bright = before > 0
            assert bright.mean() > 0.05
            expected = (1 + square[bright]) ** -2
            np.testing.assert_allclose(after[bright] / before[bright], expected, rtol=0.005)


@pytest.mark.parametrize(("width_nm", "lost"), [(60.0, 0.3), (30.0, 0.9)])
def test_the_filters_blue_shift_takes_the_dots_and_leaves_the_room(
    width_nm: float, lost: float
) -> None:
    """Towards the corner laser light falls by more than the ambient light, which does not fall.

    How much is the law of `starling.sim.scene.spectra`. Does not show what a lamp of uneven spectrum does.
    """
    made, layers = wall(DISTANCES_M[1])
    light = received(layers.left, made.scene, D435, seed=0, frame=0)
    none = np.zeros_like(light.laser)
    corner, middle = (slice(0, 60), slice(0, 60)), (slice(205, 265), slice(395, 455))
    for lit in (dataclasses.replace(light, rest=none), dataclasses.replace(light, laser=none)):
        bare = form(lit, layers, sensor_with(lens=Lens()))
        seen = form(lit, layers, sensor_with(lens=Lens(filter_width_nm=width_nm)))
        assert seen[middle].sum() / bare[middle].sum() == pytest.approx(1, abs=0.01)
        kept = seen[corner].sum() / bare[corner].sum()
        assert kept < 1 - lost if lit.rest is none else 1 < kept < 1.4


def test_the_veil_is_a_pedestal_without_the_scenes_structure() -> None:
    """L' = (1 - v) L + v mean: an even pedestal, though albedo is not even; the mean unchanged.

    Does not show ghosts or the veil that light from outside the image makes.
    """
    made = mitsuba_scene.Stage(scenes.tabletop())
    layers = direct.layers(made, D435)
    light = received(layers.left, made.scene, D435, seed=0, frame=0)
    clear = form(light, layers, sensor_with()).astype(np.float64)
    veiled = form(light, layers, sensor_with(lens=Lens(blur_px=0.6, veil=0.05))).astype(np.float64)
    assert veiled.mean() == pytest.approx(clear.mean(), rel=1e-5)
    pedestal = veiled - 0.95 * clear
    assert pedestal.mean() == pytest.approx(0.05 * clear.mean(), rel=1e-5)
    assert np.ptp(pedestal) < 1e-6 * clear.max()  # Rounding of float32.


@pytest.mark.parametrize("distance_m", DISTANCES_M)
def test_defocus_widens_by_depth(distance_m: float) -> None:
    """Sigma of a wall's defocus is k |1/z - 1/z_f| to 5 %; none at all in focus.

    Measured by the best fit among Gaussian blurs made in the frequency domain. Does not show that
    the spot is Gaussian (a real one is nearly a disc), nor what happens at depth edges.
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
    """Contrast as set to 3 %; the imagers' grains are unrelated; frames share them; ambient light
    has none.

    Does not show the grain's size against a real device, nor that grains move with scene or camera.
    """
    _, layers = wall(DISTANCES_M[1])
    even = np.ones((D435.height, D435.width), np.float32)
    none = np.zeros_like(even)
    sensor = sensor_with(contrast=contrast)
    laser, room = Received(laser=even, rest=none), Received(laser=none, rest=even)
    left, right = form(laser, layers, sensor), form(laser, layers, sensor, "right")
    for seen in (left, right):
        assert seen.mean(dtype=float) == pytest.approx(1, abs=0.01)
        assert seen.std() / seen.mean() == pytest.approx(contrast, rel=0.03)
    assert abs(np.corrcoef(left.ravel(), right.ravel())[0, 1]) < 0.01
    assert np.array_equal(form(laser, layers, sensor), left)
    np.testing.assert_allclose(form(room, layers, sensor), even, rtol=1e-5)
