"""Sentences about the limits of captures."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from starling.diagnosis.scenes import estimated
from starling.diagnosis.scenes.fit_scene import SCALE, SHIFT, TURN, Nuisance, recorded_exposure
from starling.diagnosis.scenes.limits import list_limits
from starling.diagnosis.scenes.observation import (
    DepthObservation,
    FullObservation,
    StereoObservation,
)
from starling.diagnosis.scenes.selection import SceneSelection
from starling.diagnosis.validation.adapters import families
from starling.diagnosis.which import attribution
from starling.diagnosis.which.candidates import Segment
from starling.patterns.errors import InputError
from starling.sim.imaging.imager.exposure import Exposure
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

SENSOR = presets.load("d435")


IMAGE, MAPS = np.zeros((2, 3, 3), np.uint8), np.zeros((2, 3, 3), np.float32)


def observation(kind: type[Any], **notes: Any) -> Any:
    contents = {"left": IMAGE, "right": IMAGE, "ours_px": MAPS, "device_px": MAPS}
    names = {field.name for field in dataclasses.fields(kind)} & contents.keys()
    return kind(**{name: contents[name] for name in names}, **notes)


def scene(
    name: str = "a",
    *,
    room: str = "",
    sensor: Sensor = SENSOR,
    kind: type[Any] = FullObservation,
    **notes: Any,
) -> Any:
    return SimpleNamespace(
        name=name,
        room=room or name,
        sensor=sensor,
        real=observation(kind, **notes),
        frames=2,
        estimates=(),
        against=None,
        nuisances={},
        scene=SimpleNamespace(ambient=None, bodies=(None,)),
    )


def limits(
    *scenes: Any,
    device: str = SENSOR.name,
    held_out: bool = True,
    unpaired: tuple[str, ...] = (),
    incomplete: tuple[str, ...] = (),
    families: list[str] | None = None,
    untried: tuple[Segment, ...] = (),
    compatible: bool = True,
) -> str:
    selection = SceneSelection(
        complete=[*scenes],
        incomplete=[scene(name) for name in incomplete],
        training=[*scenes],
        held_out=[*scenes[:1]] if held_out else [],
        unpaired=unpaired,
    )
    return " ".join(list_limits(device, selection, families, untried, compatible=compatible))


def test_the_package_offers_its_function_and_nothing_else():
    from starling import diagnosis
    from starling.diagnosis.diagnosis import diagnose

    assert diagnosis.diagnose is diagnose
    with pytest.raises(AttributeError, match="has no attribute 'diagnosed'"):
        _ = diagnosis.diagnosed


def test_effects_on_bodies_are_named_for_scenes_of_an_xml():
    plain, xml = scene("a"), scene("b")
    xml.scene.bodies = ()
    assert "XML" not in limits(plain, scene("b"))
    names = "nir_reflectance, specular, metal, transparency, subsurface, texture."
    assert f"shapes of an XML keep their materials: {names}" in limits(xml, plain)
    assert f"Shapes of b keep the XML's materials, despite effects: {names}" in limits(plain, xml)


def test_complete_captures_have_only_general_limits():
    text = limits(scene("a"), scene("b"))
    assert text.startswith("Not tried") and text.count(". ") == 0


def test_each_limit_has_its_sentence():
    assert "name a d415 as their device; the given sensor is a d435" in limits(
        scene(), scene("b"), device="d415"
    )
    assert "Only one room" in limits(scene("a", room="k"), scene("b", room="k"), held_out=False)
    assert "Fewer than 4 rooms" in limits(scene(), scene("b"), held_out=False)
    assert "No infrared of b:" in limits(scene(), scene("b", kind=DepthObservation))
    assert "No infrared:" in limits(scene(kind=DepthObservation), scene("b", kind=DepthObservation))
    assert "No device depth of a:" in limits(scene(kind=StereoObservation), scene("b"))
    assert "Repeats of b differ" in limits(scene(), scene("b", moved=True))
    assert "ignored: c." in limits(scene(), scene("b"), unpaired=("c",))
    assert "scenes that hold infrared pairs and device depth" in limits(scene(), incomplete=("c",))
    assert "hold infrared pairs; these" in limits(
        scene(), scene(kind=StereoObservation), incomplete=("c",)
    )
    assert "hold device depth; these" in limits(scene(kind=DepthObservation), incomplete=("c",))
    assert "families were tried: gain, veil." in limits(scene(), families=["veil", "gain"])
    known = sorted(families.known())
    some, most = (limits(scene(), families=known[:count]) for count in (9, len(known) - 2))
    assert f"Effects of 9 of the {len(known)} families were tried, as asked." in some
    assert f"families were not tried: {', '.join(known[-2:])}." in most
    assert "families" not in limits(scene(), families=known)
    text = limits(scene(), families=["veil"], untried=(Segment.DEPTH,))
    assert "veil. None of them acts on matcher and filters:" in text
    lit = scene("b")
    lit.scene.ambient, lit.frames = 3.0, 1
    assert "differ in ambient" in limits(scene(), lit) and "Only one frame:" in limits(lit)
    assert "Only one frame of b:" in limits(scene(), lit)
    lit.estimates = (1,)
    text = limits(scene(), lit)
    assert "were estimated from these images" in text and "differ in ambient" not in text
    lit.real = observation(DepthObservation)
    text = limits(lit, scene())
    assert "one value of each was assumed" in text and "these images" not in text


def test_fitted_parameters_and_unmatched_dots_are_reported():
    first, second = scene("a"), scene("b")
    first.nuisances = {"ambient": Nuisance(0.4, 0.1), SCALE: Nuisance(1.0, 0.9985)}
    second.nuisances = {"ambient": Nuisance(0.4, 0.25)}
    text = limits(first, second)
    assert "separately: ambient 0.1 to 0.25, pattern_scale 0.9985. So these are" in text
    assert "Dots" not in text
    second.against = observation(FullObservation)
    assert "Effects depart from that." in limits(first, second)
    first.estimates = second.estimates = (1,)
    assert "Dots of b do not match this sensor's pattern" in limits(first, second)
    second.sensor = with_values(SENSOR, [("projector.power_w", 0.0)])
    text = limits(first, second)
    assert "Dots" not in text and "no pair of b is named as captured so" in text
    second.real = observation(FullObservation, unlit=True)
    assert "captured so" not in limits(first, second)


def test_recorded_exposures_are_reported():
    def exposed(name: str, exposure_s: float, gain: float) -> Any:
        sensor = with_values(SENSOR, [("imager.exposure_s", exposure_s), ("imager.gain", gain)])
        model = scene(name, sensor=sensor)
        model.nuisances = {"exposure": Nuisance(common=0.0085, value=exposure_s)}
        return model

    assert "frame.json" not in limits(scene("a"), scene("b"))
    text = limits(exposed("a", 0.004, 1.0), exposed("b", 0.016, 2.0))
    assert "frame.json gives the exposure: 0.004 to 0.016 s at gain 1 to 2. It replaces" in text
    assert "Fitted to each scene" not in text
    text = limits(scene("a"), exposed("b", 0.004, 1.0))
    assert "gives the exposure of b: 0.004 s at gain 1." in text


def test_a_recorded_gain_of_no_imager_is_refused_with_its_file():
    """Recorded gains may be numbers of a device; here they are factors."""
    captured: Any = SimpleNamespace(path=Path("set/a"), known=dict)
    match = r"set/a, frame\.json: imager\.gain must be in \[0, 1000\]; got 1600"
    with pytest.raises(InputError, match=match):
        recorded_exposure(captured, [Exposure(exposure_s=0.01, gain=1600.0)], SENSOR)


def test_motion_and_device_of_the_reference_set_are_reported():
    model = scene("b")
    model.against = observation(FullObservation, moved=True)
    assert "Repeats of b differ" in limits(model)
    assert "The other captures name a d415 as their device" in limits(model, device="d415")


def test_the_largest_correction_of_a_reference_is_reported():
    """As the length of the shift and of the turn, separately."""

    def moved(turn: tuple[float, ...], shift: tuple[float, ...]) -> Any:
        model = scene()
        values = [*zip(TURN, turn, strict=True), *zip(SHIFT, shift, strict=True)]
        model.nuisances = {name: Nuisance(common=0.0, value=value) for name, value in values}
        return model

    text = limits(
        moved((0.03, 0.04, 0.0), (0.0, 0.001, 0.0)), moved((0.0,) * 3, (0.003, 0.0, 0.004))
    )
    assert "References were moved" in text
    assert "by up to 5.0 mm and 0.05 degree" in text
    assert "References were moved" not in limits(scene())


def test_estimates_absorb_light_and_similar_effects():
    assert set(families.known()) >= estimated.ABSORBED_FAMILIES
    settings = {"gain": 2.0, "lens_blur": 0.5, "vignetting": 1.0, "motion.x": 0.1}
    guessed: Any = SimpleNamespace(estimates=(1,), against=None)
    known: Any = SimpleNamespace(estimates=(), against=None)
    compared: Any = SimpleNamespace(estimates=(1,), against=object())
    assert attribution.absorbed_effects(settings, [known, guessed]) == ("gain", "vignetting")
    assert attribution.absorbed_effects(settings, [known, compared]) == ()
