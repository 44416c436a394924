"""Plausibility checks on rendered captures with deliberate errors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.calibration.observation import Observation
from starling.calibration.plausibility import checks
from starling.calibration.plausibility.correspondence import find
from starling.calibration.plausibility.dots_seen import detect_dots, expected_per_deg2
from starling.patterns.errors import InputError
from starling.sim.captures.writer import info_of
from starling.sim.scene import sources
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import simulate

pytestmark = pytest.mark.long
BAREST_ROOM = 0.3  # Share of windows that show dots: the least of 15 captured D415 rooms.


def _small(name: str) -> Sensor:
    preset = presets.load(name)
    scale = 640 / preset.width
    return dataclasses.replace(
        preset,
        width=640,
        height=360,
        fx_px=preset.fx_px * scale,
        fy_px=preset.fy_px * scale,
        cx_px=319.5,
        cy_px=179.5,
    )


def _observation(word: str, sensor: Sensor, seed: int) -> Observation:
    scene = dataclasses.replace(sources.load(word, sensor), interreflection=0.0)
    shot = simulate(scene, sensor, seed=seed)
    assert shot.ir_right is not None
    return Observation(
        name=word,
        room=word,
        info=info_of(sensor, source="simulated", licence="Apache-2.0", notes=""),
        left=shot.ir_left.astype(np.float32),
        right=shot.ir_right.astype(np.float32),
        left_off=None,
        right_off=None,
        depth_m=shot.depth.depth_m,
        truth_m=shot.layers.truth.depth_m,
        scene=None,
        metric=False,
        repeats=None,
    )


def _captures(sensor: Sensor) -> tuple[Observation, ...]:
    return tuple(_observation(word, sensor, 7) for word in ("tabletop:1", "clutter:2", "staircase"))


@pytest.fixture(scope="module", params=["d435", "d415"])
def sensor(request: pytest.FixtureRequest) -> Sensor:
    return _small(request.param)


@pytest.fixture(scope="module")
def captures(sensor: Sensor) -> tuple[Observation, ...]:
    return _captures(sensor)


def _refusal(observations: tuple[Observation, ...], sensor: Sensor) -> str:
    with pytest.raises(InputError) as caught:
        checks.check(observations, sensor)
    return str(caught.value)


def test_each_passes_alone_and_with_the_others(
    captures: tuple[Observation, ...], sensor: Sensor
) -> None:
    assert checks.check(captures, sensor) == ()
    for item in captures:
        assert checks.check([item], sensor) == ()


@pytest.mark.parametrize("name", ["d435", "d415"])
def test_counted_density_matches_the_preset(name: str) -> None:
    """At full size, the counted density is within the limit, a ratio of 1.6.

    Noise and slanted surfaces hide some dots. Dots of equal power cause more ambiguous windows,
    which are not counted. The share of windows with dots is 30 to 66 %, as in captured rooms.
    """
    sensor, shares = presets.load(name), []
    stated = expected_per_deg2(sensor.projector, sensor.fx_px)
    for item in _captures(sensor):
        assert item.left is not None and item.right is not None
        seen = detect_dots(find(item.left, item.right), item.info)
        shares.append(seen.share)
        assert 1 / 1.45 < float(seen.per_deg2.mean()) / stated < 1.2
    assert min(shares) > BAREST_ROOM
    assert name != "d415" or max(shares) < 0.66


def test_the_emitter_off(sensor: Sensor) -> None:
    """The texture of the boxes does not count as dots."""
    off = dataclasses.replace(sensor, projector=dataclasses.replace(sensor.projector, power_w=0.0))
    dark = _captures(off)
    message = _refusal(dark, sensor)
    assert message.startswith("captures must show the projector's dots; got dots in at most ")
    assert checks.check(dark, off) == ()


def test_the_wrong_preset(captures: tuple[Observation, ...], sensor: Sensor) -> None:
    wrong_name = "d415" if sensor.name == "d435" else "d435"
    wrong_sensor = captures[0].info.geometry_into(presets.load(wrong_name))
    assert f"Preset {sensor.name} fits better." in _refusal(captures, wrong_sensor)


def test_swapped(captures: tuple[Observation, ...], sensor: Sensor) -> None:
    for item in captures:
        swapped = dataclasses.replace(item, left=item.right, right=item.left)
        assert "must not be swapped" in _refusal((swapped,), sensor)


@pytest.mark.parametrize("factor", [1000.0, 0.1])
def test_a_wrong_unit(captures: tuple[Observation, ...], sensor: Sensor, factor: float) -> None:
    wrong = [
        dataclasses.replace(item, truth_m=np.float32(factor) * item.truth_m) for item in captures
    ]
    message = _refusal(tuple(wrong), sensor)
    assert float(message.split("got depths ")[1].split()[0]) == pytest.approx(factor, rel=0.01)
    message = _refusal((captures[0], wrong[1], captures[2]), sensor)
    assert message.startswith("reference depth of scene clutter:2 must have the scale")


def test_another_scene_s_depth(captures: tuple[Observation, ...], sensor: Sensor) -> None:
    """The staircase's reference replaces the clutter's, which is too similar to the tabletop's."""
    wrong = dataclasses.replace(captures[1], truth_m=captures[2].truth_m)
    message = _refusal((captures[0], wrong, captures[2]), sensor)
    assert message.startswith(
        "reference depth of scene clutter:2 must show the same scene as its infrared pair"
    )


def test_one_wall(sensor: Sensor) -> None:
    near, far = _observation("wall:1", sensor, 7), _observation("wall:2", sensor, 8)
    (message,) = checks.check([near], sensor)
    assert message.startswith("the captures show one distance only: disparities around ")
    assert checks.check([near, far], sensor) == ()
