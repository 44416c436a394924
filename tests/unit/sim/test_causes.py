"""Thresholds of the causes of missing depth, just below and just above, and their precedence."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

import starling
from starling.sim import causes
from starling.sim.reason import Reason, first_cause
from starling.sim.render.layers import Truth
from starling.sim.sensor.sensor import Imager, Sensor

SHAPE = (32, 40)
CENTRE = (16, 20)


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    edits = ("width=40", "height=32", "fx_px=40", "fy_px=40", "cx_px=19.5", "cy_px=15.5")
    return starling.load_sensor("d435", edits=edits)


@pytest.fixture(scope="module")
def device(sensor: Sensor) -> Imager:
    """An imager with read noise alone, so that the noise is known."""
    return dataclasses.replace(
        sensor.left, shot_noise=0.0, read_noise_e=50.0, dsnu_e=0.0, prnu=0.0, dark_current_e_s=0.0
    )


def truth(depth_m: float = 1.0, *, lit: bool = True, right_sees: bool = True) -> Truth:
    return Truth(
        depth_m=np.full(SHAPE, depth_m, np.float32),
        normal=np.zeros((*SHAPE, 3), np.float32),
        material=np.ones(SHAPE, np.uint32),
        lit=np.full(SHAPE, lit),
        right_sees=np.full(SHAPE, right_sees),
    )


def reasons(device: Imager, electrons: float, infrared: np.ndarray) -> dict[Reason, bool]:
    image = np.full(SHAPE, electrons, np.float32)
    masks = causes.photometric_causes(device, image, infrared, exposure_s=0.008)
    return {reason: bool(mask[CENTRE]) for reason, mask in masks.items()}


@pytest.mark.parametrize(("ratio", "dark"), [(1.99, True), (2.01, False)])
def test_signal_below_twice_the_noise_is_too_little(
    device: Imager, ratio: float, dark: bool
) -> None:
    step_e = 1 / device.dn_per_electron
    floor = np.zeros(SHAPE, np.float32)
    read_e = float(causes.imager.noise_e(device, floor, 0.008)[CENTRE])
    noise_e = float(np.hypot(read_e, step_e / np.sqrt(12)))
    result = reasons(device, ratio * noise_e, np.zeros(SHAPE, np.uint8))
    assert result[Reason.LOW_SIGNAL] == dark


@pytest.mark.parametrize(("ratio", "dark"), [(1.99, True), (2.01, False)])
def test_the_step_of_the_codes_is_noise(device: Imager, ratio: float, dark: bool) -> None:
    """Rounding to a step deviates by the step over the root of 12."""
    silent = dataclasses.replace(device, read_noise_e=0.0)
    step_e = 1 / silent.dn_per_electron
    electrons = ratio * step_e / np.sqrt(12)
    assert reasons(silent, electrons, np.zeros(SHAPE, np.uint8))[Reason.LOW_SIGNAL] == dark


@pytest.mark.parametrize(("full", "saturated"), [(20, False), (21, True)])
def test_a_quarter_of_full_pixels_saturates_a_window(
    device: Imager, full: int, saturated: bool
) -> None:
    """81 pixels in the window: 20 are 24.7 %, 21 are 25.9 %."""
    infrared = np.zeros(SHAPE, np.uint16)
    window = infrared[CENTRE[0] - 4 : CENTRE[0] + 5, CENTRE[1] - 4 : CENTRE[1] + 5]
    pixels = np.arange(81) < full
    window[...] = np.where(pixels.reshape(9, 9), np.ceil(device.saturation_dn), 0)
    assert reasons(device, 1e5, infrared)[Reason.SATURATED] == saturated


def test_one_code_below_the_ceiling_is_not_full(device: Imager) -> None:
    infrared = np.full(SHAPE, np.ceil(device.saturation_dn) - 1, np.uint16)
    assert not reasons(device, 1e5, infrared)[Reason.SATURATED]
    assert reasons(device, 1e5, infrared + np.uint16(1))[Reason.SATURATED]


@pytest.mark.parametrize(("match_px", "outside"), [(-0.51, True), (-0.49, False)])
def test_overlap_ends_half_a_pixel_left_of_the_right_image(
    sensor: Sensor, match_px: float, outside: bool
) -> None:
    """Column 3 of the left image matches at `match_px` in the right image."""
    baseline_m = sensor.baseline_m * (1 + sensor.baseline_error)
    depth_m = sensor.fx_px * baseline_m / (3 - match_px)
    masks = causes.geometric_causes(truth(depth_m), sensor)
    assert bool(masks[Reason.OUTSIDE_OVERLAP][0, 3]) == outside


def test_the_edge_of_the_right_image_is_inside(sensor: Sensor) -> None:
    """A point 1 m away has a disparity of 3.5 px exactly."""
    wide = dataclasses.replace(sensor, baseline_m=3.5 / sensor.fx_px, baseline_error=0.0)
    outside = causes.geometric_causes(truth(1.0), wide)[Reason.OUTSIDE_OVERLAP]
    assert outside[0, :3].all() and not outside[0, 3:].any()


def test_the_true_baseline_decides_the_overlap(sensor: Sensor) -> None:
    """The error of the stored baseline moves the right imager."""
    wide = dataclasses.replace(sensor, baseline_m=3.5 / sensor.fx_px, baseline_error=0.2)
    outside = causes.geometric_causes(truth(1.0), wide)[Reason.OUTSIDE_OVERLAP]
    assert outside[0, :4].all() and not outside[0, 4:].any()


def test_occlusion_counts_inside_the_overlap_alone(sensor: Sensor) -> None:
    masks = causes.geometric_causes(truth(0.5, right_sees=False), sensor)
    assert not (masks[Reason.OCCLUDED] & masks[Reason.OUTSIDE_OVERLAP]).any()
    assert (masks[Reason.OCCLUDED] | masks[Reason.OUTSIDE_OVERLAP]).all()


def test_unlit_and_hidden_surfaces_are_shadowed_and_occluded(sensor: Sensor) -> None:
    """A pixel without surface is neither; a pixel that both devices reach has no cause."""
    scene = truth(5.0)
    scene.depth_m[0] = np.nan
    for mask in (scene.lit, scene.right_sees):
        mask[:2] = False
    masks = causes.geometric_causes(scene, sensor)
    outside = masks[Reason.OUTSIDE_OVERLAP]
    rows = np.broadcast_to(np.arange(SHAPE[0])[:, None], SHAPE)
    np.testing.assert_array_equal(masks[Reason.NO_SURFACE], rows == 0)
    np.testing.assert_array_equal(masks[Reason.SHADOWED], rows == 1)
    np.testing.assert_array_equal(masks[Reason.OCCLUDED] | outside, (rows == 1) | outside)
    assert not outside[0].any() and masks[Reason.OCCLUDED][1, 10:].all()


def test_no_shadow_without_projector(sensor: Sensor) -> None:
    dark = dataclasses.replace(sensor, projector=dataclasses.replace(sensor.projector, power_w=0.0))
    assert causes.geometric_causes(truth(lit=False), sensor)[Reason.SHADOWED].all()
    assert not causes.geometric_causes(truth(lit=False), dark)[Reason.SHADOWED].any()


def test_structured_light_has_no_occlusion() -> None:
    kinect = starling.load_sensor("kinect-v1")
    assert {*causes.geometric_causes(truth(right_sees=False), kinect)} == {
        Reason.NO_SURFACE,
        Reason.SHADOWED,
    }


PRECEDENCE = [reason for reason in Reason if reason not in (Reason.VALID, Reason.UNKNOWN)]


def test_precedence_is_the_order_of_the_light() -> None:
    """Scene, light and view come before the matcher's checks, these before the filters."""
    assert [reason.name for reason in PRECEDENCE] == [
        "NO_SURFACE",
        "OUTSIDE_OVERLAP",
        "OCCLUDED",
        "SHADOWED",
        "LOW_SIGNAL",
        "SATURATED",
        "AMBIGUOUS",
        "LEFT_RIGHT",
        "SUPPORT",
        "SPECKLE",
        "POST_FILTER",
        "OUT_OF_RANGE",
    ]


@pytest.mark.parametrize(("first", "second"), list(pairwise(PRECEDENCE)))
def test_the_first_cause_wins(first: Reason, second: Reason) -> None:
    everywhere, invalid = np.ones((1, 1), bool), np.zeros((1, 1), bool)
    for masks in ({first: everywhere, second: everywhere}, {second: everywhere, first: everywhere}):
        assert first_cause(invalid, masks)[0, 0] == first


def test_without_a_cause_the_reason_is_unknown() -> None:
    assert first_cause(np.zeros((1, 1), bool), {})[0, 0] == Reason.UNKNOWN
    assert first_cause(np.ones((1, 1), bool), {Reason.SPECKLE: np.ones((1, 1), bool)})[0, 0] == 0
