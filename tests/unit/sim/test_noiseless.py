"""Expected images without random noise."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from starling.sim import simulate
from starling.sim.imaging.noiseless import noiseless
from starling.sim.render import direct
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values

SENSOR = with_values(
    dataclasses.replace(
        presets.load("d415"), width=160, height=96, cx_px=80.0, cy_px=48.0, fx_px=110.0, fy_px=110.0
    ),
    [
        ("imager.black_level_dn", 4.0),
        ("imager.crosstalk", 0.1),
        ("imager.auto_exposure_level", 0.0),
        ("imager.exposure_s", 0.02),
        ("imager.prnu", 0.0),  # A device's own pattern has no mean to be compared with.
        ("imager.dsnu_e", 0.0),
    ],
)
SCENE = scenes.clutter(1)
LAYERS = direct.layers(MitsubaScene(SCENE), SENSOR)


def test_noiseless_image_is_the_mean_of_draws():
    """It is the mean over captures and frames, including averaging and crosstalk."""
    result = noiseless(LAYERS, SCENE, SENSOR)
    count = 60
    pairs = [simulate.infrared(LAYERS, SCENE, SENSOR, seed=seed) for seed in range(count)]
    for side, image in result.items():
        drawn = np.stack([getattr(pair, side) for pair in pairs]).astype(float)
        off = drawn.mean(axis=0) - SENSOR.left.black_level_dn - image
        # Whole codes bend the mean of what is noisier by less.
        error = np.maximum(drawn.std(axis=0), 0.6) / np.sqrt(count)
        dark = image < SENSOR.left.ceiling_dn / 2
        assert abs(np.mean(off[dark] / error[dark])) < 0.1
        assert np.mean(np.abs(off[dark] / error[dark]) < 3) > 0.98


def test_noiseless_image_has_no_random_part():
    drawn = [
        ("projector.speckle_contrast", 0.0),
        ("projector.flicker", 0.2),
        ("imager.read_noise_e", 90.0),
        ("imager.prnu", 0.05),
        ("imager.pattern_contrast", 0.05),
    ]
    second = noiseless(LAYERS, SCENE, with_values(SENSOR, drawn))
    for side, image in noiseless(LAYERS, SCENE, SENSOR).items():
        assert_array_equal(image, second[side])


def test_noiseless_image_is_relative_to_the_black_level():
    without = with_values(SENSOR, [("imager.black_level_dn", 0.0)])
    level, second = (noiseless(LAYERS, SCENE, item)["left"] for item in (SENSOR, without))
    assert level.max() > 20
    assert_allclose(level, second, atol=0.01)
