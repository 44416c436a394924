"""Each feature is monotone in the effect that it is meant for, from its low to its high value.

**Rationale.** A feature with a pole, a fold or a change of sign inside the range of an effect gives
the search a wrong strength. All settings are simulated in one scene of clutter at 320 x 180 pixels.
`docs/design/diagnosis.md` lists what is not monotone.
"""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from starling.diagnosis.scenes import observation
from starling.diagnosis.scenes.observation import SceneObservation
from starling.diagnosis.scenes.request import Source, simulation
from starling.diagnosis.scenes.scene_model import SceneModel, build_scene_model
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.table import FeatureTable, build_feature_table
from starling.sim.effects import setting
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values

VALUES = 6  # Of a range.
REVERSAL = 0.05  # Largest change against the trend, over the whole change.
LEAST_CHANGE = 0.05  # Least change over the range; 0.02 is the noise floor of a feature.
SHIFT = 0.02  # Largest error of a reading of `vertical_offset` [px].

MEANT = {
    Segment.IMAGE: {
        "disparity_offset": ("pair.shift x.all", "error.bias.all"),
        "yaw": ("pair.shift x.all",),
        "vertical_offset": ("pair.shift y.all",),
        "pitch": ("pair.shift y.all",),
        "roll": ("pair.shift y.x.left", "pair.shift y.x.right"),
        "distortion": ("pair.shift x.x.left", "pair.shift x.x.right"),
        "focal_scale": ("dots.shift x.x.left", "dots.shift y.y.top"),
        "exposure": ("level.x.centre.dots.on dots", "level.full"),
        "gain": ("level.x.centre.dots.on dots", "level.full"),
        "projector_power": ("level.x.centre.dots.on dots",),
        "saturation": ("level.x.centre.dots.on dots", "level.full"),
        "ambient": ("level.x.centre.dots.between",),
        "black_level": ("level.percentile 1",),
        "dark_current": ("level.percentile 1",),
        "veil": ("level.percentile 1",),
        "gamma": ("level.x.centre.dots.between",),
        "vignetting": ("level.radius.corner.dots.on dots",),
        "lens_blur": ("texture.laplacian.radius.centre.dots.on dots", "dots.width x.all"),
        "spot_shape": ("texture.laplacian.radius.centre.dots.on dots",),
        "corner_blur": ("texture.laplacian.radius.corner.dots.on dots",),
        "near_defocus": ("texture.laplacian.depth.far.dots.on dots",),
        "smoothing": ("texture.laplacian.radius.centre.dots.on dots", "noise.alike 1,0"),
        "crosstalk": ("texture.laplacian.radius.centre.dots.on dots",),
        "subsurface": ("texture.laplacian.depth.near.dots.on dots",),
        "blooming": ("texture.direction.radius.centre.dots.on dots",),
        "laser_speckle": ("noise.expected.4/4",),
        "read_noise": ("time.noise.expected.1/4", "noise.expected.1/4"),
        "shot_noise": ("time.noise.expected.4/4", "noise.expected.4/4"),
        "noise_colour": ("noise.alike 1,0",),
        "row_noise": ("noise.rows", "time.rows"),
        "column_noise": ("noise.columns",),
        "dsnu": ("noise.expected.1/4",),
        "prnu": ("noise.expected.4/4",),
        "fixed_pattern": ("noise.expected.4/4", "noise.alike 2,0"),
        "hot_pixels": ("noise.bright outliers",),
        "flicker": ("time.flicker",),
    },
    Segment.DEPTH: {
        "pixel_locking": ("error.fraction.fraction.1/8", "error.fraction.fraction.2/8"),
        "smoothing_mean": ("surface.alike x4", "surface.rough x"),
        "spatial_filter": ("surface.alike x4", "surface.rough x"),
        "subpixel_steps": ("surface.equal x", "surface.values"),
        "depth_unit": ("surface.equal x", "surface.values"),
        "range": ("range.near", "holes.all"),
        "range.far_m": ("range.far", "holes.all"),
        "overlap_border": ("surface.columns",),
        "disparity_shift": ("holes.all",),
        "left_right_threshold": ("holes.all",),
        "edge_jump": ("holes.all",),
        "large_penalty": ("holes.all",),
    },
}
CASES = [(segment, effect) for segment, effects in MEANT.items() for effect in effects]


@cache
def table(segment: Segment) -> FeatureTable:
    small = dataclasses.replace(
        presets.load("d435"), width=320, height=180, cx_px=160, cy_px=90, fx_px=200, fy_px=200
    )
    sensor = with_values(small, [("imager.auto_exposure_level", 0.0), ("imager.exposure_s", 0.008)])

    def model(real: SceneObservation) -> SceneModel:
        return build_scene_model(
            scenes.clutter(1), sensor, name="a", room="a", truth_m=None, real=real, frames=2
        )

    plain = model(observation.NOT_CAPTURED)
    device = plain.observe(simulation(Source.BOTH, {}))
    return build_feature_table([model(device) if segment is Segment.DEPTH else plain], segment)


def values(effect: str) -> NDArray[np.float64]:
    """Return values of the effect's range, geometric if it is positive."""
    _, parameter = setting.parameter_of(effect)
    if parameter.choices:
        return np.array(parameter.choices, float)
    assert parameter.low is not None and parameter.high is not None
    space = np.geomspace if parameter.low > 0 else np.linspace
    spaced = space(parameter.low, parameter.high, VALUES)
    return np.unique(np.rint(spaced)) if isinstance(parameter.low, int) else spaced


def read(segment: Segment, effect: str, strengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the features (values, meant features) of the effect."""
    features = table(segment)
    columns = [features.names.index(name) for name in MEANT[segment][effect]]
    requests = [features.request({effect: float(value)}) for value in strengths]
    return np.concatenate([features.rows(request)[:, columns] for request in requests])


@pytest.mark.long
@pytest.mark.parametrize(("segment", "effect"), CASES)
def test_a_feature_is_monotone_in_its_effect(segment: Segment, effect: str):
    readings = read(segment, effect, values(effect))
    against = np.minimum(
        (np.maximum.accumulate(readings) - readings).max(axis=0),
        (readings - np.minimum.accumulate(readings)).max(axis=0),
    )
    change = np.ptp(readings, axis=0)
    assert (change > LEAST_CHANGE).all()
    assert (against <= REVERSAL * change).all()


@pytest.mark.long
def test_a_vertical_offset_is_read_in_pixels():
    strengths = values("vertical_offset")
    readings = read(Segment.IMAGE, "vertical_offset", strengths)[:, 0]
    np.testing.assert_allclose(readings, strengths, atol=SHIFT)
