"""Features: definitions, finite values, and independence of unused inputs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from starling.learning.features.features import GEOMETRY, REFLECTANCE, features, names
from starling.patterns.errors import InputError
from starling.sim.sensor import presets

from .seen import HEIGHT, WIDTH, box, example, flat, info

GREY = np.full((HEIGHT, WIDTH), 0.4, np.float32)


def test_features_and_definitions_correspond():
    seen = features(example(box(50, 90), reflectance=GREY), with_reflectance=True)
    assert seen.names == names(with_reflectance=True) == (*GEOMETRY, *REFLECTANCE)
    assert seen.values.shape == (HEIGHT, WIDTH, len(seen.names))
    assert seen.values.dtype == np.float32
    assert features(example(box(50, 90))).names == tuple(GEOMETRY)


def test_a_wall_that_faces_the_camera():
    seen = features(example(flat(5.25)))
    distance_m = 5 / 5.25
    assert_allclose(seen["disparity_px"], 5.25, rtol=1e-6)
    assert_allclose(seen["disparity_fraction_px"], 0.25, atol=1e-5)
    assert_allclose(seen["right_column_px"][7], np.arange(WIDTH) - 5.25, atol=1e-5)
    # Towards the corners cosine and squared range decrease: cos^3 / z^2.
    assert_allclose(seen["return_per_m2"], seen["incidence_cosine"] ** 3 / distance_m**2, rtol=1e-4)
    for name in ("occluded_px", "shadowed_px", "front_px", "back_px", "edge_left_step_px"):
        assert_array_equal(seen[name], 0)
    for name in ("roughness_fine_px", "roughness_coarse_px", "bump_fine_px", "bump_coarse_px"):
        assert_allclose(seen[name], 0, atol=1e-4)
    for name in ("edge_px", "unknown_px"):
        assert_array_equal(seen[name], 64)


def test_occlusion_and_shadow_are_left_of_a_box():
    seen = features(example(box(50, 90)), projector_x_m=0.02)
    assert_allclose(seen["occluded_px"][30, 41:50], np.arange(1, 10), atol=1e-4)
    assert_allclose(seen["shadowed_px"][30, 47:50], [1, 2, 3], atol=1e-4)  # 0.4 of 10 px.
    assert not seen["shadowed_px"][:, :46].any()
    assert (seen["front_px"][:, 46:50] == 10).all()
    assert (seen["back_px"][:, 50:54] == 10).all()
    assert (seen["edge_px"][:, 48:52] < 0).all()


def test_the_projector_position_is_from_the_preset_or_the_middle():
    step = box(50, 90)
    preset = presets.load("d435")
    part = preset.projector.position_m[0] / preset.baseline_m
    of_preset = dataclasses.replace(example(step), info=info("d435"))
    placed = features(example(step), projector_x_m=part * info().baseline_m)
    assert_array_equal(features(of_preset).values, placed.values)
    middle = features(example(step), projector_x_m=0.5 * info().baseline_m)
    assert_array_equal(features(example(step)).values, middle.values)
    assert (middle.values != placed.values).any()


@settings(max_examples=25)
@given(seed=st.integers(0, 2**16), unknown=st.floats(0, 0.99))
def test_features_are_finite_with_unknown_pixels(seed, unknown):
    rng = np.random.default_rng(seed)
    disparity = np.repeat(rng.uniform(2, 40, (HEIGHT, WIDTH // 8)), 8, axis=1)
    disparity[rng.random(disparity.shape) < unknown] = np.nan
    # Some pixels are always known, enough for a plane.
    disparity[30, 50:54] = [20.0, 20.5, 21.0, 21.5]
    disparity[31, 50:54] = 20.0
    seen = features(example(disparity))
    assert np.isfinite(seen.values).all()
    assert_array_equal(seen["unknown_px"] < 0, np.isnan(disparity))


@settings(max_examples=10)
@given(seed=st.integers(0, 2**16))
def test_a_vertical_flip_flips_the_features(seed):
    """A stereo rig has a left and a right but no up, so vertical flips are valid augmentations."""
    rng = np.random.default_rng(seed)
    disparity = np.repeat(rng.uniform(2, 40, (HEIGHT, WIDTH // 8)), 8, axis=1)
    upright = features(example(disparity)).values
    flipped = features(example(disparity[::-1])).values[::-1]
    assert_allclose(flipped, upright, atol=2e-3)


def test_device_depth_and_unrequested_reflectance_are_not_used():
    bare = features(example(box(50, 90)))
    report = features(example(box(50, 90), ndp=GREY > 0, counted=GREY > 0, reflectance=GREY))
    assert_array_equal(bare.values, report.values)


def test_features_of_reflectance():
    ramp = np.broadcast_to(np.linspace(0, 1, WIDTH, dtype=np.float32), GREY.shape).copy()
    ramp[10, 10] = np.nan  # Filled from its neighbour.
    seen = features(example(flat(), reflectance=ramp), with_reflectance=True)
    inside = (slice(None), slice(20, -20))
    slope = seen["reflectance_gradient_per_px"][inside]
    assert_allclose(slope, 1 / (WIDTH - 1), rtol=0.01)
    expected = seen["reflectance"] * seen["return_per_m2"]
    assert_allclose(seen["expected_return_per_m2"], expected)
    assert np.isfinite(seen.values).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: features(example(flat() * np.nan)), "reference depth must be known somewhere"),
        (lambda: features(example(flat()[:5])), "depth_m must be 120x60 as the geometry states"),
        (
            lambda: features(example(flat()), with_reflectance=True),
            "reflectance must be given for a method that uses it; got none for a",
        ),
        (
            lambda: features(example(flat(), reflectance=GREY[:5]), with_reflectance=True),
            "reflectance must be 120x60",
        ),
        (lambda: features(example(flat()))["warmth"], "feature must be a known name"),
        (lambda: features(example(flat()), projector_x_m=3.0), "fraction must be in"),
    ],
)
def test_invalid_examples_are_refused_in_one_line(call, message):
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)
