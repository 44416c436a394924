"""Corrupted depth images: against rendered layers, and all refusals."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import starling
from starling.patterns.errors import InputError
from starling.sim import corrupt
from starling.sim.corrupt import Corruptor
from starling.sim.reason import Reason
from starling.sim.render import direct
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import sources, spectra
from starling.sim.scene.scene import Ambient
from starling.sim.sensor import edits, presets
from starling.sim.warp import conversions, depth_input
from starling.sim.warp import layers as warp_layers
from starling.sim.warp.layers import DepthScene, layers

WIDTH, HEIGHT, FOCAL = 160, 120, 150.0
MATRIX = np.array([[FOCAL, 0, 79.5], [0, FOCAL, 59.5], [0, 0, 1]])
SENSOR = dataclasses.replace(
    presets.load("d435"),
    width=WIDTH,
    height=HEIGHT,
    fx_px=FOCAL,
    fy_px=FOCAL,
    cx_px=79.5,
    cy_px=59.5,
)
WALL = np.full((HEIGHT, WIDTH), 1.0, np.float32)


class _Unreadable:
    """An array of a type that NumPy lacks, such as bfloat16."""

    def __array__(self, *arguments: Any, **options: Any) -> None:
        raise TypeError("no such type")


def step(near_m: float = 0.8, far_m: float = 1.2) -> np.ndarray[Any, Any]:
    depth = np.full((HEIGHT, WIDTH), far_m, np.float32)
    depth[:, 60:100] = near_m
    return depth


@pytest.mark.parametrize("name", ["wall", "wall:2"])
def test_light_of_a_wall_is_that_of_rays(name: str) -> None:
    """A plane has no shadow and no edge; only the footprint of a pixel is approximated."""
    scene = sources.load(name, SENSOR)
    traced = direct.layers(MitsubaScene(scene), SENSOR)
    truth = traced.truth
    warped = layers(
        DepthScene(
            depth_m=truth.depth_m,
            reflectance=np.full(truth.depth_m.shape, scene.bodies[0].material.reflectance),
            ambient=Ambient(gradient=0.0),
        ),
        SENSOR,
    )
    for ours, rays in ((warped.left, traced.left), (warped.right, traced.right)):
        assert ours is not None
        assert rays is not None
        means = ours.projector_direct.mean(), rays.projector_direct.mean()
        assert means[0] == pytest.approx(means[1], rel=0.02)
        inner = np.s_[:, 40:-40]
        light = ours.projector_direct[inner].ravel(), rays.projector_direct[inner].ravel()
        assert np.corrcoef(*light)[0, 1] > 0.97
    assert (warped.truth.lit == truth.lit).mean() > 0.99
    assert (warped.truth.right_sees == truth.right_sees).mean() > 0.98


@pytest.mark.parametrize(("width", "largest_px"), [(64, 0.26), (160, 0.12)])
def test_disparities_of_small_images_are_off_as_documented(width: int, largest_px: float) -> None:
    """Bounds are those of docs/tutorial/12-mujoco.md: median of a wall, 0.6 to 2 m."""
    height, focal = 3 * width // 4, 0.875 * width
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    sensor = edits.with_camera(presets.load("d435"), matrix, (width, height))
    camera = Corruptor(sensor, matrix)
    errors_px = []
    for distance_m in np.linspace(0.6, 2, 15):
        depth_m = camera(np.full((height, width), distance_m)).depth_m
        off_px = sensor.focal_baseline_px_m * (1 / depth_m - 1 / distance_m)
        errors_px.append(abs(float(np.nanmedian(off_px))))
    assert 0.5 * largest_px < max(errors_px) < largest_px


def test_a_step_hides_its_left_side_from_the_right_imager() -> None:
    """The hidden strip is as wide as the two disparities differ."""
    scene = DepthScene(
        depth_m=step(), reflectance=np.full(WALL.shape, 0.5, np.float32), ambient=Ambient()
    )
    hidden = ~layers(scene, SENSOR).truth.right_sees
    width_px = SENSOR.focal_baseline_px_m * (1 / 0.8 - 1 / 1.2)
    assert hidden[60, 60 - round(width_px) : 60].mean() >= 0.5
    assert not hidden[60, 20:50].any()
    assert not hidden[60, 61:].any()


def test_reading() -> None:
    depth = step()
    depth[:20] = np.inf
    reading = Corruptor(SENSOR, MATRIX)(depth, seed=1)
    again = Corruptor(SENSOR, MATRIX)(depth, seed=1)
    known = np.isfinite(reading.depth_m)
    assert np.array_equal(reading.depth_m, again.depth_m, equal_nan=True)
    assert np.array_equal(known, reading.reason == Reason.VALID)
    assert np.array_equal(known, reading.depth_u16 > 0)
    assert (reading.reason[:16][~known[:16]] == Reason.NO_SURFACE).all()
    middle = reading.depth_m[40:100, 65:95]
    assert np.nanmedian(middle) == pytest.approx(0.8, rel=0.02)


def test_resampling_keeps_a_tilted_plane() -> None:
    """Inverse depth is linear on planes, so another camera sees the same plane."""
    wide = np.array([[100.0, 0, 99.5], [0, 100.0, 79.5], [0, 0, 1]])
    x = (np.arange(200) - 99.5) / 100
    plane = np.repeat((1 / (1 + 0.3 * x))[None].astype(np.float32), 160, axis=0)
    moved = depth_input.resampled(plane, depth_input.InputCamera(wide, plane.shape), SENSOR)
    seen_x = (np.arange(WIDTH) - 79.5) / FOCAL
    np.testing.assert_allclose(moved[60], 1 / (1 + 0.3 * seen_x), rtol=1e-5)
    matrix = np.array([[400.0, 0, 19.5], [0, 400.0, 19.5], [0, 0, 1]])
    narrow = depth_input.InputCamera(matrix, (40, 40))
    outside = depth_input.resampled(np.ones((40, 40), np.float32), narrow, SENSOR)
    assert np.isnan(outside[0, 0])
    assert np.isfinite(outside[60, 80])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"depth_m": WALL * 1000},
            r"depth_m must be in metres; got a median of 1000\. .* set sky and far plane to NaN",
        ),
        ({"depth_m": -WALL}, "depth_m must be >= 0"),
        ({"depth_m": WALL * np.nan}, "depth_m must hold a surface"),
        ({"depth_m": WALL[0]}, r"depth_m must be \(h, w\) numbers"),
        ({"right_depth_m": WALL * 1000}, "right_depth_m must be in metres"),
        ({"right_depth_m": WALL[:5]}, r"right_depth_m must be \(120, 160\), as depth_m"),
        ({"projector_depth_m": WALL[:5]}, r"projector_depth_m must be \(120, 160\)"),
        ({"reflectance": 200.0}, r"reflectance must be in \[0, 1\]"),
        ({"reflectance": WALL[:5]}, "reflectance must be .*, as the depth"),
        ({"ambient_lux": -1.0}, "ambient_lux must be in"),
        ({"up": (0, 0, 0)}, r"up must be a direction \(3,\); got \[0.0, 0.0, 0.0\]"),
        ({"up": (0, 1)}, "up must be a direction"),
        ({"up": (0, np.inf, 0)}, "up must be a direction"),
        ({"up": "sky"}, "up must be an array of real numbers"),
        ({"reflectance": np.zeros((0, 0))}, "reflectance must be .*, as the depth"),
        ({"reflectance": "bright"}, "reflectance must be an array of real numbers"),
        ({"depth_m": [[1, 2], [1]]}, "depth_m must be an array of real numbers; got list"),
        ({"depth_m": WALL > 0}, "depth_m must be an array of real numbers; got .* bool"),
        ({"depth_m": WALL * 1e-30}, "depth_m must be 0 or >= 0.001 m; got 1e-30"),
        ({"right_depth_m": WALL * 1e-30}, "right_depth_m must be 0 or >= 0.001 m"),
        ({"depth_m": _Unreadable()}, "got _Unreadable: no such type. Convert it to an array"),
        ({"seed": -1}, "seed must be an integer"),
        ({"seed": 1.5}, "seed must be an integer"),
        ({"frame": -1}, "frame must be an integer"),
    ],
)
def test_refused_images(change: dict[str, Any], message: str) -> None:
    values: dict[str, Any] = {"depth_m": WALL, **change}
    with pytest.raises(InputError, match=message):
        Corruptor(SENSOR, MATRIX)(values.pop("depth_m"), **values)


@pytest.mark.parametrize(("depth_m", "accepted"), [(49.9, True), (50.1, False)])
def test_a_median_above_50_m_is_in_millimetres(depth_m: float, accepted: bool) -> None:
    image = WALL * np.float32(depth_m)
    image[:40] = 0.5
    if accepted:
        assert np.nanmax(depth_input.checked_depth("depth_m", image)) == np.float32(depth_m)
        return
    with pytest.raises(InputError, match=r"depth_m must be in metres; got a median of 50\.1"):
        depth_input.checked_depth("depth_m", image)


def test_the_nearest_surface_is_at_one_millimetre() -> None:
    image = WALL.copy()
    image[0, 0] = 0.001
    assert depth_input.checked_depth("depth_m", image)[0, 0] == np.float32(0.001)
    image[0, 0] = 0.00099
    with pytest.raises(InputError, match=r"depth_m must be 0 or >= 0\.001 m; got 0\.00099"):
        depth_input.checked_depth("depth_m", image)


@pytest.mark.parametrize(("jump", "seen"), [(0.018, "between"), (0.022, "nearest")])
def test_resampling_interpolates_on_surfaces_alone(jump: float, seen: str) -> None:
    """Neighbours whose inverse depths differ by more than 2 % are two surfaces."""
    depth = np.ones((40, 40), np.float32)
    depth[:, 20:] = 1 / (1 - jump)
    shifted = np.array([[FOCAL, 0, 19.75], [0, FOCAL, 19.5], [0, 0, 1]])
    sensor = edits.with_camera(SENSOR, shifted - [[0, 0, 0.35], [0, 0, 0], [0, 0, 0]], (40, 40))
    moved = depth_input.resampled(depth, depth_input.InputCamera(shifted, (40, 40)), sensor)
    levels = np.unique(np.round(1 / moved[20, 2:-2], 4))
    assert len(levels) == (3 if seen == "between" else 2)


def test_light_from_above_brightens_surfaces_that_face_it() -> None:
    camera = Corruptor(SENSOR, MATRIX)
    even = camera.light(WALL).layers.left.ambient
    for up, factor in (
        ((0, 0, -2), 1 + 0.5 * 2 / 3),
        ((0, -1, 0), 1),
        ((0, 0, 1), 1 - 0.5 * 2 / 3),
    ):
        lit = camera.light(WALL, up=up).layers.left.ambient
        np.testing.assert_allclose(lit, even * factor, rtol=1e-5)


@pytest.mark.parametrize(("name", "width_nm"), [("d435", 0), ("xtion", 80), ("oak-d", 300)])
def test_daylight_is_what_the_filter_passes(name: str, width_nm: int) -> None:
    """ASTM G173 through the sensor's filter, as for all ambient light (decision 0007)."""
    sensor = edits.with_camera(presets.load(name), MATRIX, (WIDTH, HEIGHT))
    assert sensor.left.lens.filter_width_nm == width_nm
    band = spectra.Band.from_imager(sensor.left, sensor.projector)
    lit = Corruptor(sensor, MATRIX).light(WALL, ambient_lux=5000.0)
    expected = spectra.ambient_w_m2("sun", illuminance_lx=5000.0, band=band)
    assert lit.scene.ambient.irradiance_w_m2 == pytest.approx(expected)


@pytest.mark.parametrize("name", ["d435", "oak-d-pro"])
def test_the_brightest_daylight_is_accepted(name: str) -> None:
    sensor = edits.with_camera(presets.load(name), MATRIX, (WIDTH, HEIGHT))
    camera = Corruptor(sensor, MATRIX)
    assert camera.light(WALL, ambient_lux=1.5e5).seen
    with pytest.raises(InputError, match=r"ambient_lux must be in \[0, 150000\]"):
        camera.light(WALL, ambient_lux=1.51e5)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (MATRIX.T, "Is it transposed"),
        (np.linalg.inv(MATRIX), "must have focal lengths > 1 px"),
        (MATRIX[:2], "must be .*, finite"),
        ("K", "camera_matrix must be an array of real numbers"),
        (MATRIX + np.array([[0, 5, 0], [0, 0, 0], [0, 0, 0]]), "Rectify the image first"),
    ],
)
def test_refused_matrices(matrix: np.ndarray[Any, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Corruptor(SENSOR, matrix)


def test_images_outside_the_view_are_refused() -> None:
    aside = MATRIX - np.array([[0, 0, 1e4], [0, 0, 0], [0, 0, 0]])
    with pytest.raises(InputError, match="depth_m must cover part of the sensor's image; got none"):
        Corruptor(SENSOR, aside)(WALL)


@pytest.mark.parametrize(
    ("row", "column", "value", "message"),
    [
        (0, 0, 6e301, r"camera_matrix: fx must be in \[3.2, 1.6e\+06\]; got 6e\+301"),
        (1, 1, 2.0, "camera_matrix: fy must be in"),
        (0, 2, 1e9, r"camera_matrix: cx must be in \[-100000, 100000\]"),
        (1, 2, -1e9, "camera_matrix: cy must be in"),
    ],
)
def test_implausible_cameras_are_refused(row: int, column: int, value: float, message: str) -> None:
    matrix = MATRIX.copy()
    matrix[row, column] = value
    with pytest.raises(InputError, match=message):
        Corruptor(SENSOR, matrix)(WALL)
    with pytest.raises(InputError, match=message):
        conversions.depth_from_range(WALL, matrix)


def test_the_function_sets_the_effects_of_a_corruptor() -> None:
    effects = {"lens_blur": 2.0}
    changed = starling.corrupt(step(), MATRIX, SENSOR, effects=effects)
    np.testing.assert_array_equal(
        changed.ir_left, Corruptor(SENSOR, MATRIX, effects=effects)(step()).ir_left
    )
    assert (changed.ir_left != starling.corrupt(step(), MATRIX, SENSOR).ir_left).any()


def test_effects_on_surfaces_are_refused_by_name() -> None:
    with pytest.raises(InputError, match="effect specular must not need surfaces"):
        Corruptor(SENSOR, MATRIX, effects={"specular": 0.5})


def test_masked_pixels_have_no_surface() -> None:
    hidden = np.zeros(WALL.shape, bool)
    hidden[:, :80] = True
    masked = np.ma.masked_array(np.where(hidden, -1, WALL), hidden)
    seen = depth_input.checked_depth("depth_m", masked)
    assert np.array_equal(np.isnan(seen), hidden)


def test_whole_numbers_of_numpy_are_seeds() -> None:
    seeds: tuple[Any, Any] = (3, np.int64(3))
    plain, numpy = (Corruptor(SENSOR, MATRIX)(WALL, seed=seed) for seed in seeds)
    assert np.array_equal(plain.ir_left, numpy.ir_left)


def test_rgb_is_a_hint_of_reflectance() -> None:
    """Black dyes reflect a quarter, white 0.85."""
    camera = depth_input.InputCamera(MATRIX, WALL.shape)
    picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    picture[:, 80:] = 255
    seen = depth_input.reflectance(picture, camera, SENSOR)
    np.testing.assert_allclose(seen[0, [0, -1]], [0.25, 0.85], rtol=1e-6)


def test_a_passive_camera_sees_the_luminance_of_rgb() -> None:
    """Rec. 709: red, green and blue of full level reflect 0.2126, 0.7152 and 0.0722."""
    camera = depth_input.InputCamera(MATRIX, WALL.shape)
    picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    for channel in range(3):
        picture[:, channel, channel] = 255
    visible = edits.with_values(SENSOR, [("projector.wavelength_nm", 550.0)])
    seen = depth_input.reflectance(picture, camera, visible)
    np.testing.assert_allclose(seen[0, :4], [0.2126, 0.7152, 0.0722, 0.0], rtol=1e-6)


@pytest.mark.parametrize("disparity_px", [8.0, 8.25, 8.5, 8.75])
def test_texture_moves_by_fractions_of_a_pixel(disparity_px: float) -> None:
    """Whole pixels would pull disparities to whole numbers."""
    columns = np.broadcast_to(np.arange(WIDTH, dtype=np.float32), WALL.shape)
    depth = WALL * (FOCAL * SENSOR.true_baseline_m / disparity_px)
    warped = layers(
        DepthScene(
            depth_m=depth, reflectance=columns / np.float32(WIDTH), ambient=Ambient(gradient=0.0)
        ),
        SENSOR,
    )
    assert warped.right is not None
    seen = warped.right.ambient * np.float32(np.pi * WIDTH) - columns
    np.testing.assert_allclose(seen[:, : WIDTH - 10], disparity_px, atol=1e-2)


def test_reflectances_of_two_surfaces_do_not_mix() -> None:
    """Left of the near surface, the right imager sees what the left one does not."""
    depth = step()
    warped = layers(
        DepthScene(
            depth_m=depth,
            reflectance=np.where(depth < 1, np.float32(0.9), np.float32(0.1)),
            ambient=Ambient(gradient=0.0),
        ),
        SENSOR,
    )
    assert warped.right is not None
    levels = np.unique(np.round(warped.right.ambient * np.pi, 4))
    assert levels.tolist() == pytest.approx([0.1, 0.9])


@pytest.mark.parametrize("variance", [0.01, 0.15, 0.499, 0.501, 2.0, 9.0])
def test_filter_of_the_pattern_has_the_variance_of_a_pixel(variance: float) -> None:
    taps = warp_layers._taps(variance).ravel()
    places = np.arange(len(taps)) - len(taps) // 2
    assert taps.sum() == pytest.approx(1, abs=1e-6)
    assert (taps * places**2).sum() == pytest.approx(variance, rel=0.02)


@given(far_px=st.floats(0.5, 140), step_px=st.floats(0, 139), least=st.integers(0, 40))
def test_the_search_holds_all_disparities_that_the_sensor_searches(
    far_px: float, step_px: float, least: int
) -> None:
    own = dataclasses.replace(SENSOR.matcher, min_disparity_px=least)
    sensor = dataclasses.replace(SENSOR, matcher=own)
    disparity = np.array([[far_px, far_px + step_px]])
    depth = (SENSOR.fx_px * SENSOR.true_baseline_m / disparity).astype(np.float32)
    search = corrupt.narrow_search(sensor, depth).matcher
    end, own_end = search.min_disparity_px + search.search_px, least + own.search_px
    assert least <= search.min_disparity_px and end <= own_end and search.search_px % 16 == 0
    assert search.min_disparity_px <= max(far_px - 7, least)
    assert end >= min(far_px + step_px + 7, own_end)


def test_the_search_without_a_surface_is_the_sensor_s() -> None:
    assert corrupt.narrow_search(SENSOR, np.full((2, 2), np.nan, np.float32)) == SENSOR
