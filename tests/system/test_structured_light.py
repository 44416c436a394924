"""A structured-light camera obeys the laws of its geometry; real frames: tests/real/test_kinect."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim import simulate
from starling.sim.geometry import frames
from starling.sim.imaging.optics import speckle
from starling.sim.scene import materials
from starling.sim.scene.builtin import scenes, solids
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets
from starling.sim.sensor.matcher import CensusSemiGlobal, named
from starling.sim.stereo import structured_light
from tests.oracles.speckle import looks_in_pixel

EIGHTHS = 8


def seen(sensor, scene):
    """Return the shot, its disparities and the true disparities [px]."""
    shot = simulate.simulate(scene, sensor)
    true_px = sensor.focal_baseline_px_m / shot.layers.truth.depth_m
    return shot, structured_light.match_reference(shot.ir_left, sensor), true_px


@pytest.fixture(scope="module")
def slanted():
    """A wall turned by 40 deg about the vertical at 1 m: every fraction of a disparity."""
    sensor = presets.load("kinect-v1")
    sheet = solids.plane(4.0, 4.0)
    body = solids.body("wall", sheet, materials.PAPER, frames.pose((0, 0, 1.0), (0, 40, 0)))
    return sensor, *seen(sensor, Scene(name="slanted", bodies=(body,)))


@pytest.mark.parametrize("name", ["kinect-v1", "xtion"])
@pytest.mark.parametrize("distance_m", [0.6, 0.9, 1.5, 3.0])
def test_disparity_is_unbiased_up_to_the_left_border(name, distance_m):
    """f b / z to 0.1 px, filled to 95 %, in the first 60 columns to 80 % (there light is dimmest).

    A wall has one fraction of disparity, whose rounding alone may be 1/16 px off. It does not prove
    that a device's own interpolation is as good.
    """
    sensor = presets.load(name)
    _, result, true_px = seen(sensor, scenes.wall(distance_m))
    assert result.valid[20:-20, :60].mean() > 0.8
    assert result.valid[20:-20].mean() > 0.95
    assert np.nanmedian(result.disparity_px - true_px) == pytest.approx(0, abs=0.1)


def test_disparities_are_eighths_so_depths_are_discrete(slanted):
    """z = f b / (n / 8), n whole; between 0.9 and 1.1 m there are 8 f b (1/0.9 - 1/1.1) of them."""
    sensor, _, result, _ = slanted
    counts = result.disparity_px[result.valid] * EIGHTHS
    assert np.array_equal(counts, np.rint(counts))
    low, high = (EIGHTHS * sensor.focal_baseline_px_m / z for z in (1.1, 0.9))
    between = np.unique(counts[(counts > low) & (counts < high)])
    assert len(between) == pytest.approx(high - low, abs=1)


def test_interpolation_does_not_pull_to_whole_pixels(slanted):
    """Mean error by fraction of disparity stays below 0.04 px; the plain fit pulls by 0.06 or more.

    It does not prove anything of other dots: the correction is for dots as wide as these.
    """
    sensor, shot, result, true_px = slanted
    plain = dataclasses.replace(
        sensor.matcher,
        refinement=dataclasses.replace(sensor.matcher.refinement, locking_px=0.0),
    )
    pulled = structured_light.match_reference(
        shot.ir_left, dataclasses.replace(sensor, matcher=plain)
    )
    eighth = np.floor(true_px % 1 * EIGHTHS)

    def largest(disparity_px):
        off = disparity_px - true_px
        off[np.abs(off) > 0.5] = np.nan
        return max(abs(np.nanmean(off[eighth == part])) for part in range(EIGHTHS))

    assert largest(result.disparity_px) < 0.04
    assert largest(pulled.disparity_px) > 0.06


def test_noise_grows_with_the_square_of_distance():
    """Disparity noise is equal at 0.7 and 1.4 m (to 50 %), so depth noise grows fourfold.

    Far below what distance would do. It does not prove the size of the noise.
    """
    sensor = presets.load("kinect-v1")
    spread = []
    for distance_m in (0.7, 1.4):
        deviations = []
        for near in (0.97, 0.985, 1.0, 1.015, 1.03):
            _, result, true_px = seen(sensor, scenes.wall(near * distance_m))
            off = (result.disparity_px - true_px)[40:-40, 40:-40]
            deviations.append(np.nanvar(off[np.abs(off) < 0.5]))
        spread.append(np.sqrt(np.mean(deviations)))
    assert spread[1] / spread[0] == pytest.approx(1, abs=0.5)
    assert 0.04 < spread[0] < 0.15


def test_wider_reference_only_adds_columns_on_the_left():
    sensor = presets.load("kinect-v1")
    narrow, wide = (
        structured_light.reference_image(sensor, beyond_px=n).astype(int) for n in (0, 100)
    )
    assert wide.shape == (480, 740)
    assert (
        np.abs(wide[:, 108:] - narrow[:, 8:]).max() <= 1
    )  # The lens's spot mirrors at the border.
    assert wide[:, 40:100].std() > 0.5 * narrow.std()


def test_converter_with_more_bits_gives_equal_matches():
    """12 bits are matched as 10: images agree within a level, so depth agrees within its noise."""
    sensor = presets.load("kinect-v1")
    shot, ten, _ = seen(sensor, scenes.wall(1.0))
    finer = dataclasses.replace(sensor.left, bit_depth=12)
    twelve = structured_light.match_reference(shot.ir_left, dataclasses.replace(sensor, left=finer))
    both = ten.valid & twelve.valid
    assert both.mean() > 0.95
    assert np.abs(ten.disparity_px - twelve.disparity_px)[both].mean() < 1 / 16


@pytest.mark.parametrize("beyond_px", [-1, 10_000])
def test_a_reference_of_absurd_width_is_refused(beyond_px):
    with pytest.raises(InputError, match="beyond_px must be in"):
        structured_light.reference_image(presets.load("kinect-v1"), beyond_px=beyond_px)


@pytest.mark.parametrize("name", ["kinect-v1", "xtion"])
def test_speckle_follows_the_aperture(name):
    """C = 1 / sqrt(2 M): a pixel averages M looks of each of two polarisations (Goodman 2007)."""
    sensor = presets.load(name)
    grain_px = speckle.grain_size_px(
        wavelength_nm=sensor.projector.wavelength_nm,
        f_number=sensor.left.lens.f_number,
        pixel_pitch_m=sensor.left.pixel_pitch_m,
    )
    looks = 2 * looks_in_pixel(grain_px)
    assert sensor.projector.speckle_contrast == pytest.approx(looks**-0.5, rel=0.01)


def test_the_window_is_nine_pixels():
    """As documented for the device; a wider census would widen the window."""
    engine = named("kinect").engine
    assert isinstance(engine, CensusSemiGlobal)
    assert (engine.support_px, engine.census_px) == (9, 3)
