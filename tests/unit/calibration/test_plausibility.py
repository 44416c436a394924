"""Captures made wrong on purpose, drawn rather than rendered: each is told for what it is.

The projector stands in the left imager, so its pattern lies still in the left image and moves by
the disparity in the right one. What a room adds (texture, shadows, noise) is in the simulated and
the real captures' tests.
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
    depth_spread,
    preset_fit,
    reference_scale,
)
from starling.calibration.plausibility.dots_seen import covered, see, stated_per_deg2
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
    """What the left imager sees of the pattern on white (h, w) [DN]."""
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
    """Texture instead of dots: smooth noise, as dark as it is bright (h, w) [DN]."""
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
    """Two walls, one above the other, each shifting its half of the image as a whole."""
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
def test_what_is_right_passes(name: str) -> None:
    sensor = _sensor(name)
    assert checks.check([_observation("a", sensor)], sensor) == ()


def test_disparity_is_found_to_sub_pixels() -> None:
    found = correspondence.find(*_pair(_observation("a", near_px=30.4, far_px=14.3)))
    upper, lower = found.disparity_px[found.row < 160], found.disparity_px[found.row > 200]
    assert len(found) > 0.8 * found.tried
    assert np.median(upper) == pytest.approx(30.4, abs=0.05)
    assert np.median(lower) == pytest.approx(14.3, abs=0.05)


def _pair(observation: Observation) -> tuple[np.ndarray, np.ndarray]:
    assert observation.left is not None and observation.right is not None
    return observation.left, observation.right


def test_nothing_is_found_in_noise() -> None:
    """Chance finds one window in a hundred at most: else every count here would mean little."""
    noise = np.random.default_rng(1).normal(size=(2, 360, 640))
    found = correspondence.find(noise[0], noise[1])
    assert len(found) <= 0.01 * found.tried
    assert found.patch.shape[1:] == (31, 31)


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
    said = _refusal(*wrong)
    found = float(said.split("got depths ")[1].split(" times")[0])
    assert found == pytest.approx(factor, rel=0.005)
    assert f"{1e-3 / factor:.3g} would fit"[:3] in said


def test_reference_off_by_a_little_is_said() -> None:
    wrong = dataclasses.replace(A, truth_m=np.float32(1.0254) * A.truth_m)
    (said,) = checks.check([wrong], D435)
    assert said.startswith("disparities are 1.02")
    close = dataclasses.replace(A, truth_m=np.float32(1.01) * A.truth_m)
    assert checks.check([close], D435) == ()


def test_a_scene_that_contradicts_the_others_is_named() -> None:
    other = dataclasses.replace(B, name="odd", truth_m=np.float32(1.2) * B.truth_m)
    for order in ([A, B, other], [other, A, B], [A, other], [other, A]):
        assert _refusal(*order).startswith("reference depth of scene odd must be of one scale")


def test_a_reference_of_another_pose_is_named() -> None:
    ramp = np.tile(np.linspace(0.3, 3, 640, dtype=np.float32), (360, 1))
    wrong = dataclasses.replace(B, truth_m=ramp)
    assert _refusal(A, wrong).startswith(
        "reference depth of scene b must show what its infrared pair shows; got "
    )


def test_a_reference_that_is_wrong_in_part_is_said() -> None:
    """A fifth of the scene has moved from 1.2 m to 0.8 m, say."""
    assert A.truth_m is not None
    moved = A.truth_m.copy()
    moved[250:330] *= 1.5
    (said,) = checks.check([dataclasses.replace(A, truth_m=moved)], D435)
    assert said.startswith("reference depth of scene a disagrees with its infrared pair in 2")


def test_another_camera_is_named() -> None:
    other = dataclasses.replace(B, info=dataclasses.replace(B.info, baseline_m=0.095))
    said = _refusal(A, other)
    assert said.startswith("scene b must be of one camera with scene a; got ") and "95" in said


def test_too_little_to_compare_says_nothing() -> None:
    few = np.arange(1, reference_scale.FEWEST, dtype=np.float64)
    assert reference_scale.compare("a", few, few, 640.0) is None
    assert reference_scale.check((), 1e-3) == ()
    unknown = dataclasses.replace(A, truth_m=None, depth_m=None)
    assert checks.check([unknown, B], D435) == ()


@pytest.mark.parametrize("image", [_texture(D435), np.full((360, 640), 40.0)])
def test_no_dots(image: np.ndarray) -> None:
    """Texture that both imagers see alike is not taken for dots, nor is a blank wall."""
    dark = _observation("dark", image=image)
    assert _refusal(dark).startswith("captures must show the projector's dots; got dots in at")
    off = dataclasses.replace(D435, projector=dataclasses.replace(D435.projector, power_w=0.0))
    assert checks.check([dark], off) == ()
    (said,) = checks.check([A, dark], D435)
    assert said == "scene dark shows hardly any dots: was the emitter off?"


def test_too_few_dots() -> None:
    """A pattern of 82 dots, of which the image shows most."""
    part = dataclasses.replace(D435.projector, dot_density=0.03)
    sparse = dataclasses.replace(D435, projector=part)
    said = _refusal(_observation("a", sparse), sensor=sparse)
    assert said.startswith("captures must show at least 100 dots; got about ")
    assert 40 < float(said.split("about ")[1].split(" in")[0]) < 100


def test_dots_in_a_part_of_the_field() -> None:
    half = _drawn(D435)
    half[:, 200:] = 40
    (said,) = checks.check([_observation("a", image=half)], D435)
    assert said.startswith("dots are seen in ") and "of the projector's field" in said


@pytest.mark.parametrize("name", ["d435", "d415"])
def test_coverage_is_of_the_projector_s_field(name: str) -> None:
    """Turned away by a quarter of its field, a projector is seen in three quarters of it."""
    sensor = _sensor(name)
    item = _observation("a", sensor)
    dots = see(correspondence.find(*_pair(item)), item.info)
    straight = covered(sensor.projector, dots, item.info)
    turned = dataclasses.replace(sensor.projector, rotation_deg=(0.0, 25.0, 0.0))
    assert straight.mean() > 0.8
    aside = covered(turned, dots, item.info)
    assert aside[:, :6].any() and not aside[:, 9:].any()


@pytest.mark.parametrize("name", ["d435", "d415"])
def test_density_is_counted_as_stated(name: str) -> None:
    """In a capture as in the pattern, to 10 %; d415's dots melt at 640 x 360."""
    sensor = _sensor(name)
    item = _observation("a", sensor)
    dots = see(correspondence.find(*_pair(item)), item.info)
    stated = stated_per_deg2(sensor.projector, sensor.fx_px)
    assert float(dots.per_deg2.mean()) == pytest.approx(stated, rel=0.1)
    sparse = dataclasses.replace(sensor.projector, dot_density=0.5)
    assert stated_per_deg2(sparse, sensor.fx_px) == pytest.approx(0.5 * stated, rel=0.3)


@pytest.mark.parametrize(("asked", "real"), [("d435", "d415"), ("d415", "d435")])
def test_the_wrong_preset(asked: str, real: str) -> None:
    item = _observation("a", _sensor(real))
    said = _refusal(item, sensor=item.info.geometry_into(presets.load(asked)))
    assert said.startswith(f"sensor {asked} must fit the captures; got ")
    assert "dots per square degree where its pattern shows" in said
    assert said.endswith(f"Preset {real} fits better.")


def test_the_wrong_preset_without_infrared() -> None:
    """Without dots the captures' own word decides between a refusal and a warning."""
    blind = dataclasses.replace(_observation("a", _sensor("d415")), left=None, right=None)
    asked = blind.info.geometry_into(presets.load("d435"))
    said = _refusal(blind, sensor=asked)
    assert "a field 71 deg wide where the preset has 89" in said and "d415 fits" in said
    unnamed = dataclasses.replace(blind.info, sensor="mine")
    (warned,) = checks.check([dataclasses.replace(blind, info=unnamed)], asked)
    assert warned.endswith("preset d415 fits better.")
    wide = dataclasses.replace(unnamed, baseline_m=0.2, fx_px=5000.0)
    (warned,) = preset_fit.check(wide, asked, None)
    assert "a baseline of 200.0 mm where the preset has 50.1; no preset fits better" in warned


def test_another_pattern_that_no_preset_has_is_said() -> None:
    dense = dataclasses.replace(D435.projector, dot_density=2.2)
    item = _observation("a", dataclasses.replace(D435, projector=dense))
    (said,) = checks.check([item], dataclasses.replace(D435, name="mine"))
    assert said.startswith("sensor mine may not be of the captures' model: 0.7")


def test_one_wall() -> None:
    wall = _observation("a", near_px=20.0, far_px=20.0)
    (said,) = checks.check([wall], D435)
    assert "one distance only: disparities of 20.0 px vary by 0 px" in said
    assert "capture a wall at a second distance" in said
    second = _observation("b", near_px=10.0, far_px=10.0)
    assert checks.check([wall, second], D435) == ()


def test_spread_is_a_standard_deviation() -> None:
    """Of a normal distribution, where the limit is 2 px; nothing known says nothing."""
    normal = np.random.default_rng(0).normal(30, 1, (400, 400))
    assert depth_spread.check([30 + 2.1 * (normal - 30)]) == ()
    (said,) = depth_spread.check([30 + 1.9 * (normal - 30)])
    assert "30.0 px vary by 1.9 px" in said
    assert depth_spread.check([np.full((8, 8), np.nan)]) == () == depth_spread.check([])


def test_depth_alone() -> None:
    """Without infrared the device's depth is held against the reference and the range."""
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
