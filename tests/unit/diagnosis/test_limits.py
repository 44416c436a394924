"""What a report says that captures cannot tell."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis import diagnosis as module
from starling.diagnosis.scenes import estimated
from starling.diagnosis.scenes.fit_scene import SCALE, SHIFT, TURN, Nuisance
from starling.diagnosis.scenes.limits import limits_of
from starling.diagnosis.validation.adapters import families
from starling.diagnosis.which.candidates import Arm
from starling.sim.imaging.imager.exposure import Exposure
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

SENSOR = presets.load("d435")


def scene(name: str = "a", *, room: str = "", sensor: Sensor = SENSOR, **real: Any) -> Any:
    image = np.zeros((2, 3, 3))
    given = {
        "left": image,
        "right": image,
        "device_px": image,
        "moved": False,
        "exposure": None,
        "unlit": False,
    } | real
    return SimpleNamespace(
        name=name,
        room=room or name,
        sensor=sensor,
        real=SimpleNamespace(**given),
        frames=2,
        estimates=(),
        against=None,
        nuisances={},
        scene=SimpleNamespace(ambient=None),
    )


def told(*scenes: Any, device: str = SENSOR.name, locked: bool = True, **others: Any) -> str:
    asked = {"aside": (), "incomplete": (), "families": None, "untried": ()} | others
    return " ".join(limits_of(device, scenes, locked=locked, **asked))


def test_the_package_offers_its_function_and_nothing_else():
    from starling import diagnosis
    from starling.diagnosis.diagnosis import diagnose

    assert diagnosis.diagnose is diagnose
    with pytest.raises(AttributeError, match="has no attribute 'diagnosed'"):
        _ = diagnosis.diagnosed


def test_of_whole_captures_only_what_no_reading_shows_is_told():
    text = told(scene("a"), scene("b"))
    assert text.startswith("Not tried") and text.count(". ") == 0


def test_every_lack_has_its_sentence():
    assert "of a d415; the sensor at hand is called" in told(scene(), scene("b"), device="d415")
    assert "One room alone" in told(scene("a", room="k"), scene("b", room="k"), locked=False)
    assert "Fewer than 4 rooms" in told(scene(), scene("b"), locked=False)
    assert "No infrared of b:" in told(scene(), scene("b", left=None))
    assert "No infrared:" in told(scene(left=None), scene("b", left=None))
    assert "No depth of the device's own of a:" in told(scene(device_px=None), scene("b"))
    assert "Repeats of b differ" in told(scene(), scene("b", moved=True))
    assert "left aside: c." in told(scene(), scene("b"), aside=["c"])
    assert "scenes that hold infrared pairs and depth" in told(scene(), incomplete=["c"])
    assert "hold infrared pairs; these" in told(scene(), scene(device_px=None), incomplete=["c"])
    assert "hold depth of the device's own; these" in told(scene(left=None), incomplete=["c"])
    assert "families were tried: gain, veil." in told(scene(), families=["veil", "gain"])
    text = told(scene(), families=["veil"], untried=[Arm.DEPTH])
    assert "veil. None of them acts on matcher and filters:" in text
    lit = scene("b")
    lit.scene.ambient, lit.frames = 3.0, 1
    assert "differ in ambient" in told(scene(), lit) and "One frame alone:" in told(lit)
    assert "One frame of b alone:" in told(scene(), lit)
    lit.estimates = (1,)
    text = told(scene(), lit)
    assert "were estimated from these images" in text and "differ in ambient" not in text
    lit.real.left = None
    text = told(lit, scene())
    assert "one of each was supposed" in text and "these images" not in text


def test_what_was_fitted_to_each_scene_is_told_and_where_dots_are_another_patterns():
    first, second = scene("a"), scene("b")
    first.nuisances = {"ambient": Nuisance(0.4, 0.1), SCALE: Nuisance(1.0, 0.9985)}
    second.nuisances = {"ambient": Nuisance(0.4, 0.25)}
    text = told(first, second)
    assert "by itself: ambient 0.1 to 0.25, pattern_scale 0.9985. So these are" in text
    assert "Dots" not in text
    second.against = SimpleNamespace(exposure=None, moved=False)
    assert "Effects depart from that." in told(first, second)
    first.estimates = second.estimates = (1,)
    assert "Dots of b are not where this sensor's pattern has them" in told(first, second)
    second.sensor = with_values(SENSOR, [("projector.power_w", 0.0)])
    text = told(first, second)
    assert "Dots" not in text and "no pair of b is named as captured so" in text
    second.real.unlit = True
    assert "captured so" not in told(first, second)


@pytest.mark.parametrize(
    "times, says", [((1.0, 1.0), ""), ((1.5, 1.5), "frame.json tells"), ((1.0, 2.0), "2.00 times")]
)
def test_exposures_that_frames_tell_of_are_compared_with_the_sensors(times, says):
    imager = SENSOR.left
    fixed = with_values(SENSOR, [("imager.auto_exposure_level", 0.0)])
    for one in (fixed, with_values(SENSOR, [("imager.auto_exposure_level", 0.3)])):
        shots = [Exposure(exposure_s=k * imager.exposure_s, gain=imager.gain) for k in times]
        scenes = [scene(n, sensor=one, exposure=shot) for n, shot in zip("ab", shots, strict=True)]
        text = told(*scenes)
        assert ("expos" in text or "frame.json" in text) == bool(says and one is fixed)
        assert not says or one is not fixed or says in text


def test_of_two_sets_the_sensor_is_checked_against_the_other():
    """It is that one's; what the diagnosed captures differ by is the gap."""
    fixed = with_values(SENSOR, [("imager.auto_exposure_level", 0.0)])
    own = Exposure(exposure_s=fixed.left.exposure_s, gain=fixed.left.gain)
    long = Exposure(exposure_s=2 * fixed.left.exposure_s, gain=fixed.left.gain)

    def pair(real: Exposure, other: Exposure, *, moved: bool = False) -> Any:
        one = scene("b", sensor=fixed, exposure=real)
        one.against = SimpleNamespace(exposure=other, moved=moved)
        return one

    assert "frame.json" not in told(pair(long, own))
    assert "frame.json tells of" in told(pair(own, long))
    assert "Repeats of b differ" in told(pair(own, own, moved=True))
    assert "The other set's captures say that they are of a d415" in told(
        pair(own, own), device="d415"
    )


def test_how_far_references_were_moved_is_told_in_millimetres_and_degrees():
    """The largest of all scenes, each by the length of its three numbers."""

    def moved(turn: tuple[float, ...], shift: tuple[float, ...]) -> Any:
        one = scene()
        values = [*zip(TURN, turn, strict=True), *zip(SHIFT, shift, strict=True)]
        one.nuisances = {name: Nuisance(common=0.0, own=value) for name, value in values}
        return one

    text = told(moved((0.03, 0.04, 0.0), (0.0, 0.001, 0.0)), moved((0.0,) * 3, (0.003, 0.0, 0.004)))
    assert "References were moved" in text
    assert "by up to 5.0 mm and 0.05 degree" in text
    assert "References were moved" not in told(scene())


def test_what_estimates_take_up_is_light_and_what_looks_like_it():
    assert set(families.known()) >= estimated.TAKEN_UP
    settings = {"gain": 2.0, "lens_blur": 0.5, "vignetting": 1.0, "motion.x": 0.1}
    guessed: Any = SimpleNamespace(estimates=(1,), against=None)
    known: Any = SimpleNamespace(estimates=(), against=None)
    beside: Any = SimpleNamespace(estimates=(1,), against=object())
    assert module._taken_up(settings, [known, guessed]) == ("gain", "vignetting")
    assert module._taken_up(settings, [known, beside]) == ()
