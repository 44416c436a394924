"""Plausibility checks on synthetic captures with deliberate errors.

The projector is at the left imager, so its pattern is fixed in the left image and shifted by the
disparity in the right one. Tests with simulated and real captures add texture, shadows and noise.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import cv2
import numpy as np
import pytest

from starling.calibration.observation import Observation
from starling.calibration.plausibility import (
    checks,
    correspondence,
    preset_fit,
    reference_scale,
)
from starling.calibration.plausibility.dots_seen import (
    covered_cells,
    detect_dots,
    expected_per_deg2,
)
from starling.patterns.errors import InputError
from starling.sim.captures.writer import info_of
from starling.sim.render import emission
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

NEAR_PX, FAR_PX = 30.0, 14.0  # Disparity of the upper and the lower half.


def _sensor(name: str = "d435") -> Sensor:
    """A preset at 640 x 360, its projector in the left imager."""
    preset = presets.load(name)
    scale = 640 / preset.width
    return dataclasses.replace(
        preset,
        width=640,
        height=360,
        fx_px=preset.fx_px * scale,
        fy_px=preset.fx_px * scale,
        cx_px=319.5,
        cy_px=179.5,
        projector=dataclasses.replace(preset.projector, position_m=(0.0, 0.0, 0.0)),
    )


D435 = _sensor()


def _drawn(sensor: Sensor) -> np.ndarray:
    """Return the left image of the pattern on a white surface (h, w) [DN]."""
    part = sensor.projector
    half_x, half_y = emission.half_tangents(part)
    size = (round(2 * half_x * sensor.fx_px), round(2 * half_y * sensor.fy_px))
    light = sum(
        emission.irradiance_at_unit_distance(part, number)
        for number in range(len(emission.emitters(part)))
    )
    seen = cv2.resize(np.asarray(light), size, interpolation=cv2.INTER_AREA)
    lost_x, lost_y = seen.shape[1] - sensor.width, seen.shape[0] - sensor.height
    pad = max(0, -lost_x, -lost_y)
    seen = np.pad(seen, pad)
    top, first = pad + lost_y // 2, pad + lost_x // 2
    return 20 + 60 * seen[top : top + sensor.height, first : first + sensor.width]


def _texture(sensor: Sensor) -> np.ndarray:
    """Return texture without dots: symmetric smooth noise (h, w) [DN]."""
    noise = np.random.default_rng(0).normal(size=(sensor.height, sensor.width))
    return 60 + 60 * cv2.GaussianBlur(noise, (0, 0), 1.5)


def _observation(
    name: str,
    sensor: Sensor = D435,
    *,
    image: np.ndarray | None = None,
    near_px: float = NEAR_PX,
    far_px: float = FAR_PX,
    **changes: Any,
) -> Observation:
    """Return an observation of two walls, one above the other, at constant disparity each."""
    left = _drawn(sensor) if image is None else image
    disparity = np.full(left.shape, far_px, np.float32)
    disparity[: sensor.height // 2] = near_px
    x, y = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in left.shape[::-1]))
    right = cv2.remap(left.astype(np.float32), x + disparity, y, cv2.INTER_LINEAR)
    depth = np.float32(sensor.focal_baseline_px_m) / disparity
    noise = np.random.default_rng(len(name)).normal(size=(2, *left.shape)).astype(np.float32)
    drawn: dict[str, Any] = {
        "name": name,
        "room": name,
        "info": info_of(sensor, source="drawn", licence="Apache-2.0", notes=""),
        "left": left.astype(np.float32) + noise[0],
        "right": right + noise[1],
        "left_off": None,
        "right_off": None,
        "depth_m": depth,
        "truth_m": depth,
        "scene": None,
        "metric": False,
        "repeats": None,
    }
    return Observation(**{**drawn, **changes})


def _refusal(*observations: Observation, sensor: Sensor = D435) -> str:
    with pytest.raises(InputError) as caught:
        checks.check(observations, sensor)
    assert "\n" not in str(caught.value)
    return str(caught.value)


A, B = _observation("a"), _observation("b", near_px=26.0, far_px=17.0)


@pytest.mark.parametrize("name", ["d435", "d415"])
def test_valid_captures_pass(name: str) -> None:
    sensor = _sensor(name)
    assert checks.check([_observation("a", sensor)], sensor) == ()


def test_disparity_is_found_to_sub_pixels() -> None:
    correspondences = correspondence.find(*_pair(_observation("a", near_px=30.4, far_px=14.3)))
    upper, lower = (
        correspondences.disparity_px[correspondences.row < 160],
        correspondences.disparity_px[correspondences.row > 200],
    )
    assert len(correspondences) > 0.8 * correspondences.tried
    assert np.median(upper) == pytest.approx(30.4, abs=0.05)
    assert np.median(lower) == pytest.approx(14.3, abs=0.05)


def _pair(observation: Observation) -> tuple[np.ndarray, np.ndarray]:
    assert observation.left is not None and observation.right is not None
    return observation.left, observation.right


def test_noise_gives_no_matches() -> None:
    """Noise gives at most 1 % of chance matches."""
    noise = np.random.default_rng(1).normal(size=(2, 360, 640))
    correspondences = correspondence.find(noise[0], noise[1])
    assert len(correspondences) <= 0.01 * correspondences.tried
    assert correspondences.patch.shape[1:] == (31, 31)


@pytest.mark.parametrize("shapes", [((360, 640), (360, 600)), ((40, 640), (40, 640))])
def test_pairs_that_cannot_be_searched_are_refused(shapes: Any) -> None:
    with pytest.raises(InputError, match="must share one shape of at least 64x64"):
        correspondence.find(np.zeros(shapes[0]), np.zeros(shapes[1]))


def test_swapped_images() -> None:
    left, right = _pair(A)
    swapped = dataclasses.replace(A, left=right, right=left)
    assert "left and right images of scene a must not be swapped; got " in _refusal(swapped)
    same = dataclasses.replace(B, right=B.left)
    assert "images of scene b must be two views" in _refusal(A, same)


@pytest.mark.parametrize("factor", [1000.0, 10.0, 2.54, 1 / 10, 1 / 1000])
def test_reference_off_by_a_factor(factor: float) -> None:
    wrong = [
        dataclasses.replace(item, truth_m=np.float32(factor) * item.truth_m) for item in (A, B)
    ]
    message = _refusal(*wrong)
    reported = float(message.split("got depths ")[1].split(" times")[0])
    assert reported == pytest.approx(factor, rel=0.005)
    assert f"{1e-3 / factor:.3g} would fit"[:3] in message


def test_a_small_scale_error_gives_a_warning() -> None:
    wrong = dataclasses.replace(A, truth_m=np.float32(1.0254) * A.truth_m)
    (message,) = checks.check([wrong], D435)
    assert message.startswith("disparities are 1.02")
    close = dataclasses.replace(A, truth_m=np.float32(1.01) * A.truth_m)
    assert checks.check([close], D435) == ()


def test_a_scene_with_another_scale_is_refused() -> None:
    odd_scene = dataclasses.replace(B, name="odd", truth_m=np.float32(1.2) * B.truth_m)
    for order in ([A, B, odd_scene], [odd_scene, A, B], [A, odd_scene], [odd_scene, A]):
        assert _refusal(*order).startswith("reference depth of scene odd must have the scale")


def test_a_reference_of_another_pose_is_refused() -> None:
    ramp = np.tile(np.linspace(0.3, 3, 640, dtype=np.float32), (360, 1))
    wrong = dataclasses.replace(B, truth_m=ramp)
    assert _refusal(A, wrong).startswith(
        "reference depth of scene b must show the same scene as its infrared pair; got "
    )


def test_a_partly_wrong_reference_gives_a_warning() -> None:
    """A part of the scene has moved between reference and images."""
    assert A.truth_m is not None
    moved = A.truth_m.copy()
    moved[250:330] *= 1.5
    (message,) = checks.check([dataclasses.replace(A, truth_m=moved)], D435)
    assert message.startswith("reference depth of scene a disagrees with its infrared pair in 2")


def test_another_camera_is_refused() -> None:
    foreign = dataclasses.replace(B, info=dataclasses.replace(B.info, baseline_m=0.095))
    message = _refusal(A, foreign)
    assert (
        message.startswith("scene b must come from the same camera as scene a; got ")
        and "95" in message
    )


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_images_without_the_projector_are_darker(factor: float) -> None:
    """They are copies of the others, or overexposed."""
    left, right = _pair(A)
    off = {"left_off": 0.8 * left, "right_off": factor * right}
    message = _refusal(dataclasses.replace(A, **off))
    assert message.startswith(
        "scene a must be darker in ir_right_off.png than in ir_right.png; got"
    )
    dark = dataclasses.replace(A, left_off=0.8 * left, right_off=0.8 * right)
    assert checks.check([dark, B], D435) == ()
    without = dataclasses.replace(D435, projector=dataclasses.replace(D435.projector, power_w=0.0))
    checks.check([dataclasses.replace(A, **off), B], without)


def test_too_few_places_give_no_warning() -> None:
    few = np.arange(1, reference_scale.FEWEST, dtype=np.float64)
    assert reference_scale.compare("a", few, few, 640.0) is None
    assert reference_scale.check((), 1e-3) == ()
    unknown = dataclasses.replace(A, truth_m=None, depth_m=None)
    assert checks.check([unknown, B], D435) == ()


@pytest.mark.parametrize("image", [_texture(D435), np.full((360, 640), 40.0)])
def test_no_dots(image: np.ndarray) -> None:
    """Neither texture nor a blank wall counts as dots."""
    dark = _observation("dark", image=image)
    assert _refusal(dark).startswith("captures must show the projector's dots; got dots in at")
    off = dataclasses.replace(D435, projector=dataclasses.replace(D435.projector, power_w=0.0))
    assert checks.check([dark], off) == ()
    (message,) = checks.check([A, dark], D435)
    assert message == "scene dark shows almost no dots; check that the emitter was on."


def test_too_few_dots() -> None:
    """The pattern has 82 dots, and the image shows most of them."""
    part = dataclasses.replace(D435.projector, dot_density=0.03)
    sparse = dataclasses.replace(D435, projector=part)
    message = _refusal(_observation("a", sparse), sensor=sparse)
    assert message.startswith("captures must show at least 100 dots; got about ")
    assert 40 < float(message.split("about ")[1].split(" in")[0]) < 100


def test_dots_in_a_part_of_the_field() -> None:
    half = _drawn(D435)
    half[:, 200:] = 40
    (message,) = checks.check([_observation("a", image=half)], D435)
    assert message.startswith("dots cover ") and "of the projector's field" in message


@pytest.mark.parametrize("name", ["d435", "d415"])
def test_coverage_is_of_the_projector_s_field(name: str) -> None:
    """A projector rotated by a quarter of its field is covered by about three quarters."""
    sensor = _sensor(name)
    item = _observation("a", sensor)
    dots = detect_dots(correspondence.find(*_pair(item)), item.info)
    straight = covered_cells(sensor.projector, dots, item.info)
    turned = dataclasses.replace(sensor.projector, rotation_deg=(0.0, 25.0, 0.0))
    assert straight.mean() > 0.8
    aside = covered_cells(turned, dots, item.info)
    assert aside[:, :6].any() and not aside[:, 9:].any()


@pytest.mark.parametrize("name", ["d435", "d415"])
def test_counted_density_matches_the_pattern(name: str) -> None:
    """Counts in a capture and in the pattern agree within 10 %, including merged dots."""
    sensor = _sensor(name)
    item = _observation("a", sensor)
    dots = detect_dots(correspondence.find(*_pair(item)), item.info)
    stated = expected_per_deg2(sensor.projector, sensor.fx_px)
    assert float(dots.per_deg2.mean()) == pytest.approx(stated, rel=0.1)
    sparse = dataclasses.replace(sensor.projector, dot_density=0.5)
    assert expected_per_deg2(sparse, sensor.fx_px) == pytest.approx(0.5 * stated, rel=0.3)


@pytest.mark.parametrize(("claimed", "real"), [("d435", "d415"), ("d415", "d435")])
def test_the_wrong_preset(claimed: str, real: str) -> None:
    item = _observation("a", _sensor(real))
    message = _refusal(item, sensor=item.info.geometry_into(presets.load(claimed)))
    assert message.startswith(f"sensor {claimed} must fit the captures; got ")
    assert "dots per square degree; its pattern has" in message
    assert message.endswith(f"Preset {real} fits better.")


def test_the_wrong_preset_without_infrared() -> None:
    """Without dots, the sensor named by the captures decides between refusal and warning."""
    blind = dataclasses.replace(_observation("a", _sensor("d415")), left=None, right=None)
    sensor = blind.info.geometry_into(presets.load("d435"))
    message = _refusal(blind, sensor=sensor)
    assert "a field 71 deg wide; the preset has 89" in message and "d415 fits" in message
    unnamed = dataclasses.replace(blind.info, sensor="mine")
    (warned,) = checks.check([dataclasses.replace(blind, info=unnamed)], sensor)
    assert warned.endswith("preset d415 fits better.")
    wide = dataclasses.replace(unnamed, baseline_m=0.2, fx_px=5000.0)
    (warned,) = preset_fit.check(wide, sensor, None)
    assert "a baseline of 200.0 mm; the preset has 50.1; no preset fits better" in warned


def test_an_unknown_pattern_gives_a_warning() -> None:
    dense = dataclasses.replace(D435.projector, dot_density=2.2)
    item = _observation("a", dataclasses.replace(D435, projector=dense))
    (message,) = checks.check([item], dataclasses.replace(D435, name="mine"))
    assert message.startswith("sensor mine may differ from the captures' model: 0.7")


def test_one_wall() -> None:
    wall = _observation("a", near_px=20.0, far_px=20.0)
    (message,) = checks.check([wall], D435)
    assert "one distance only: disparities around 20.0 px vary by 0 px" in message
    assert "Capture a wall at a second distance" in message
    second = _observation("b", near_px=10.0, far_px=10.0)
    assert checks.check([wall, second], D435) == ()


def test_spread_is_a_standard_deviation() -> None:
    """The limit is 2 px for a normal distribution; unknown disparities give no warning."""
    normal = np.random.default_rng(0).normal(30, 1, (400, 400))
    assert checks.check_depth_range([30 + 2.1 * (normal - 30)]) == ()
    (message,) = checks.check_depth_range([30 + 1.9 * (normal - 30)])
    assert "30.0 px vary by 1.9 px" in message
    assert checks.check_depth_range([np.full((8, 8), np.nan)]) == () == checks.check_depth_range([])


def test_depth_alone() -> None:
    """Without infrared images, the device's depth is compared with the reference and the range."""
    blind = dataclasses.replace(A, left=None, right=None)
    assert checks.check([blind], D435) == ()
    wrong = dataclasses.replace(blind, truth_m=np.float32(10) * blind.truth_m)
    assert "got depths 10 times" in _refusal(wrong)
    metres = dataclasses.replace(blind, depth_m=np.float32(1000) * blind.depth_m, truth_m=None)
    assert _refusal(metres).startswith("depth of scene a must lie within the sensor's 0.17 to")
    empty = dataclasses.replace(blind, depth_m=np.full((360, 640), np.nan, np.float32))
    assert checks.check([empty], D435) == ()
    nothing = dataclasses.replace(blind, depth_m=None, truth_m=None)
    assert checks.check([nothing], D435) == ()
