"""Laws of the effects that no other file tests: light, codes, search, checks.

Rationale: each effect has a formula. It is measured without noise at the pipeline stage that acts,
so tolerances are those of single precision or of a pixel.
"""

import dataclasses

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from starling.patterns import Pattern, faults
from starling.patterns.dots import SIGMA_PER_FWHM
from starling.patterns.field import Field
from starling.sim import metrics
from starling.sim.geometry import frames
from starling.sim.imaging import imager
from starling.sim.imaging.lens_input import combine_light
from starling.sim.render import direct, emission, mitsuba_scene
from starling.sim.render.layers import Layers, ViewLayers
from starling.sim.scene.builtin import scenes, solids
from starling.sim.scene.scene import Ambient, Material, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.matcher import D4XX, Refinement
from starling.sim.sensor.sensor import Imager, Projector, Sensor
from starling.sim.stereo import census, checks
from starling.sim.stereo.matching import match

D435 = presets.load("d435")


def with_light(**changes) -> Sensor:
    return dataclasses.replace(D435, projector=dataclasses.replace(D435.projector, **changes))


def dots_on_a_wall(sensor: Sensor, distance_m: float) -> Layers:
    return direct.layers(mitsuba_scene.MitsubaScene(scenes.wall(distance_m)), sensor)


# Codes and electrons.


@given(level=st.integers(0, 64), bit_depth=st.sampled_from([8, 10, 12, 16]))
def test_a_black_level_adds_exactly(level, bit_depth):
    """The black level adds exactly to the codes, up to the ceiling.

    The level is whole, and signals lie a quarter above a code, to avoid rounding effects. Does not
    cover drift of the level, or clipping of dark noise at 0.
    """
    part = Imager(full_well_e=9000.0, bit_depth=bit_depth)
    wanted = np.random.default_rng(level).integers(0, part.ceiling_dn + 1, (40, 50))
    light = ((wanted + 0.25) / part.dn_per_electron).astype(np.float32)
    raised = imager.read_out(
        dataclasses.replace(part, black_level_dn=float(level)),
        light,
        exposure_s=0.01,
        unit=0,
        side="left",
        seed=0,
        frame=0,
    ).delivered
    assert np.array_equal(raised, np.minimum(wanted + level, part.ceiling_dn))


@given(
    exposure_s=st.floats(1e-4, 0.05),
    efficiency=st.floats(0.01, 1.0),
    wavelength_nm=st.floats(780, 1000),
    f_number=st.floats(1.2, 8.0),
    pitch_um=st.floats(1.0, 10.0),
)
def test_electrons_are_in_proportion(exposure_s, efficiency, wavelength_nm, f_number, pitch_um):
    """Electrons scale with time, quantum efficiency, wavelength, pixel area and 1 / N^2.

    The quantum efficiency is given at the laser's line. Its dependence on the wavelength is tested
    with `starling.sim.imaging.optics.bandpass`.
    """
    base = Imager(quantum_efficiency=0.5, pixel_pitch_m=3e-6)
    lens = dataclasses.replace(base.lens, f_number=f_number)
    part = dataclasses.replace(
        base, quantum_efficiency=efficiency, pixel_pitch_m=pitch_um * 1e-6, lens=lens
    )
    ratio = imager.electrons_per_radiance(part, wavelength_nm, exposure_s)
    ratio /= imager.electrons_per_radiance(base, 850.0, 0.01)
    light = (base.lens.f_number / f_number) ** 2 * (pitch_um / 3) ** 2 * (exposure_s / 0.01)
    assert ratio == pytest.approx(light * efficiency / 0.5 * wavelength_nm / 850, rel=1e-9)


# Light.


@given(power_w=st.floats(0, 3))
def test_power_scales_laser_light_alone(power_w):
    """Laser light is the power times the layer of 1 W; ambient light keeps its bits.

    Does not prove that a laser's power is linear in its control.
    """
    rng = np.random.default_rng(0)
    shape = (4, 6)
    ones = np.ones(shape, np.float32)
    view = ViewLayers(
        projector_direct=rng.random(shape, np.float32),
        projector_indirect=0 * ones,
        ambient=ones,
        other=0 * ones,
        depth_m=ones,
        body=ones.astype(np.uint32),
    )
    scene = dataclasses.replace(scenes.wall(), ambient=Ambient(irradiance_w_m2=0.3))
    light = combine_light(view, scene, with_light(power_w=power_w), seed=0, frame=0)
    np.testing.assert_allclose(light.laser, view.projector_direct * power_w, rtol=1e-6)
    assert np.array_equal(light.rest, np.float32(0.3) * ones)


@pytest.mark.parametrize("gradient", [0.3, 1.0])
@pytest.mark.parametrize(("tilt_deg", "upwards"), [(0, 0.0), (45, -(0.5**0.5)), (-45, 0.5**0.5)])
def test_a_tilted_sky_lights_by_the_normal(gradient, tilt_deg, upwards):
    """L = rho / pi (1 + 2/3 g n . up) on a slanted wall, to 0.1 %.

    Ambient light has no shadows.
    """
    sheet = solids.body(
        "wall",
        solids.plane(9, 9),
        Material(name="grey", reflectance=0.5),
        frames.pose((0, 0, 1.5), (tilt_deg, 0, 0)),
    )
    scene = Scene(name="wall", bodies=(sheet,), ambient=Ambient(gradient=gradient))
    view = direct.layers(mitsuba_scene.MitsubaScene(scene), D435, subpixels=1)
    middle = (slice(220, 250), slice(410, 440))
    assert view.truth.normal[middle][..., 1].mean() == pytest.approx(-upwards, abs=1e-3)
    expected = 0.5 / np.pi * (1 + 2 / 3 * gradient * upwards)
    assert view.left.ambient[middle].mean() == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("distance_m", [0.6, 2.0])
def test_a_moved_projector_moves_the_pattern_by_its_parallax(distance_m):
    """A shift of 4 mm to the right moves the left image's dots by f t / z, to 0.02 px.

    Does not cover shadows.
    """
    x, y, z = D435.projector.position_m
    before, after = (
        dots_on_a_wall(with_light(position_m=(place, y, z)), distance_m).left.projector_direct
        for place in (x, x + 0.004)
    )
    expected = D435.fx_px * 0.004 / distance_m
    # The image shifted to the right is the left one of a pair.
    measured = metrics.shift_px(after, before, near_px=expected, margin_px=30)
    assert measured == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("distance_m", [0.6, 2.0])
def test_a_rotated_projector_moves_the_pattern_equally_at_all_distances(distance_m):
    """A rotation of 0.3 deg moves dots by f phi (1 + x^2 / f^2) in the middle, to 2 %.

    Does not cover the growth off the axis.
    """
    before, after = (
        dots_on_a_wall(with_light(rotation_deg=(0.0, turn, 0.0)), distance_m)
        .left.projector_direct[175:295, 345:505]
        .copy()
        for turn in (0.0, 0.3)
    )
    expected = D435.fx_px * np.deg2rad(0.3)
    measured = metrics.shift_px(after, before, near_px=expected, margin_px=20)
    assert measured == pytest.approx(expected, rel=0.02)


def test_another_pattern_changes_both_imagers():
    """Patterns of different seeds are uncorrelated; left and right images are correlated.

    Does not prove that patterns of two devices differ as much.
    """
    disparity = round(D435.focal_baseline_px_m / 1.0)
    distance_m = D435.focal_baseline_px_m / disparity
    first, second = (dots_on_a_wall(with_light(pattern_seed=seed), distance_m) for seed in (0, 1))
    assert second.right is not None

    def alike(image, reference):
        return np.corrcoef(image.ravel(), reference.ravel())[0, 1]

    left, right = second.left.projector_direct, second.right.projector_direct
    dots, others = (
        light - cv2.blur(light, (31, 31)) for light in (first.left.projector_direct, left)
    )
    assert (
        abs(alike(dots, others)) < 0.05
    )  # Both are darker off the axis, which is not a correlation of dots.
    assert alike(left[:, disparity:], right[:, :-disparity]) > 0.98


@given(x_deg=st.sampled_from([60.0, 80.0, 100.0]), y_deg=st.sampled_from([40.0, 63.0]))
def test_a_wider_field_spreads_the_same_power(x_deg, y_deg):
    """Mean irradiance at unit distance is 1 W over 4 tan(x/2) tan(y/2), to 0.1 %.

    Does not prove that a real lens has equally bright dots over the field.
    """
    part = Projector(fov_x_deg=x_deg, fov_y_deg=y_deg)
    area = 4 * np.tan(np.deg2rad(x_deg / 2)) * np.tan(np.deg2rad(y_deg / 2))
    mean = emission.irradiance_at_unit_distance(part).mean(dtype=np.float64)
    assert mean == pytest.approx(1 / area, rel=1e-3)


# Matcher.


def texture(shape: tuple[int, int]) -> np.ndarray:
    noise = ndimage.gaussian_filter(np.random.default_rng(4).normal(size=shape), 1.0)
    return np.clip(110 + 150 * noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("least", "count"), [(0, 32), (24, 32), (16, 64)])
def test_search_ends_are_depths(least, count):
    """A wall has depth where least < d < least + count - 1: from f b / (least + count - 1) on.

    Does not cover false matches beyond the ends.
    """
    checked = dataclasses.replace(D4XX.checks, uniqueness=20.0)
    setting = dataclasses.replace(
        D4XX, min_disparity_px=least, search_px=count, checks=checked, refinement=Refinement()
    )
    wide = texture((60, 420))
    right_part = np.s_[10:-10, 130:-20]
    for disparity in (least + 1, least + 2, least + count - 3, least + count - 2):
        measured = match(wide[:, :300], wide[:, disparity : disparity + 300], setting)
        assert np.isfinite(measured.disparity_px[right_part]).mean() > 0.95
        assert np.nanmedian(measured.disparity_px[right_part]) == pytest.approx(disparity, abs=0.05)
    for disparity in (least - 4, least + count + 3):
        if disparity < 0:
            continue
        measured = match(wide[:, :300], wide[:, disparity : disparity + 300], setting)
        right = np.abs(measured.disparity_px[right_part] - disparity) < 1
        assert not right.any()


@given(deviation=st.floats(0.5, 8.0), least=st.floats(0.5, 8.0))
def test_texture_counts_by_its_deviation(deviation, least):
    """On a chequerboard all pixels are removed if its deviation is below the threshold, else none.

    A device uses another measure, which counts steps between neighbours.
    """
    board = np.indices((40, 40)).sum(0) % 2
    level = np.where(board, 60 + deviation, 60 - deviation).round().astype(np.uint8)
    real = level.astype(float).std()
    if abs(real - least) < 0.1:  # A window of odd side has one more pixel of one kind.
        return
    refused = checks.texture(checks.moments(level)[1], least_dn=least)[8:-8, 8:-8]
    assert refused.all() if real < least else not refused.any()


@given(count=st.integers(2, 400), more=st.integers(-1, 1))
def test_islands_are_removed_by_their_size(count, more):
    """An island is removed at n <= count pixels, and kept with one more."""
    size = count + more
    disparity = np.full((24, 24), np.nan, np.float32)
    disparity.ravel()[np.arange(size) + 24] = 7.25
    refused = checks.speckle(disparity, count=count, step_px=1.0)
    assert refused.sum() == (size if size <= count else 0)


@pytest.mark.parametrize("sigma_px", [0.5, 1.0, 2.0])
def test_presmoothing_is_a_gaussian(sigma_px):
    """A point becomes a Gaussian of that deviation, sampled at the pixels, to 1 % of its peak.

    The deviation of the samples is slightly smaller: 0.46 px for 0.5 px.
    """
    point = np.zeros((41, 41), np.uint8)
    point[20, 20] = 255
    weights = np.exp(-((np.arange(41) - 20.0) ** 2) / (2 * sigma_px**2))
    weights /= weights.sum()
    expected = 255 * census.SUBLEVELS * np.outer(weights, weights)
    np.testing.assert_allclose(
        census.levels(point, presmooth_px=sigma_px), expected, atol=0.01 * expected.max()
    )


# Pattern.


@pytest.mark.parametrize("sigma_mrad", [2.0, 6.0])
def test_shifted_dots_move_by_normal_deviates(sigma_mrad):
    """Dots at one position spread by the set deviation on both axes, in quadrature to their width.

    To 5 %, with 4000 dots. Does not prove that a device's dots move independently.
    """
    ahead = np.zeros(4000)
    pattern = Pattern.from_dots(
        ahead,
        ahead,
        ahead + 1,
        field=Field(30.0, 30.0),
        width_px=960,
        fwhm_mrad=3.0,
        background=0.0,
        name="many in one",
    )
    light = faults.irradiance(pattern, shifted_mrad=sigma_mrad, rng=np.random.default_rng(1))
    for axis, focal_px in enumerate(pattern.field.focal_px(pattern.shape)):
        profile = light.sum(axis=axis, dtype=np.float64)
        away = 1e3 * (np.arange(len(profile)) - (len(profile) - 1) / 2) / focal_px
        spread = np.sqrt((profile * away**2).sum() / profile.sum())
        assert spread == pytest.approx(np.hypot(sigma_mrad, 3.0 * SIGMA_PER_FWHM), rel=0.05)
