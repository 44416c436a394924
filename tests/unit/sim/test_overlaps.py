"""Two settings of one field: one warning says which wins."""

from __future__ import annotations

import warnings

import pytest

from starling.sim.effects import setting
from starling.sim.sensor import overlaps, presets, resolve
from starling.sim.sensor.edits import apply

D435 = presets.load("d435")


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("projector.power_w=0.1", "projector.power_w=0.2"),
        ("left.lens.blur_px=2", "imager.lens.blur_px=3"),
        ("matcher.search_px=32", "matcher.setting=d4xx"),
        ("projector.position_m.x=0.01", "projector.position_m=[0.02, 0, 0]"),
    ],
)
def test_an_edit_that_a_later_one_replaces_is_reported(first: str, second: str) -> None:
    path = first.partition("=")[0]
    with pytest.warns(UserWarning, match=rf"^set: {path} set more than once; the last one wins"):
        edited = apply(D435, [first, second])
    assert edited == apply(D435, [second])


def test_an_edit_of_a_part_of_an_earlier_one_is_not_reported() -> None:
    matcher = ["matcher.setting=d4xx", "matcher.search_px=32"]
    edited = apply(D435, ["imager.lens.blur_px=3", "left.lens.blur_px=2", *matcher])
    assert (edited.left.lens.blur_px, edited.right.lens.blur_px) == (2, 3)
    assert edited.matcher.search_px == 32


def test_an_edit_of_a_field_of_a_device_preset_is_reported() -> None:
    edits = ("projector.power_w=0.2",)
    with pytest.warns(UserWarning, match=r"set: projector\.power_w wins over the device preset or"):
        sensor = resolve.load("d435", emitter="off", edits=edits)
    assert sensor.projector.power_w == 0.2
    overlaps.warn_of_controls(D435, D435, ["projector.power_w"])


def test_an_edit_of_a_field_of_an_effect_is_reported() -> None:
    message = r"^effect lens_blur sets left\.lens\.blur_px as well, and wins over the edit"
    with pytest.warns(UserWarning, match=message):
        setting.warn_of_edits({"lens_blur": 1.0}, ["left.lens.blur_px", "projector.power_w"])


@pytest.mark.parametrize(
    ("changes", "centres"),
    [
        (["width=640"], {"cx_px": 319.5}),
        (["height=360", "width=640"], {"cx_px": 319.5, "cy_px": 179.5}),
        (["width=640", "cx_px=319.5"], {}),
        (["width=848"], {}),  # As before.
    ],
)
def test_an_image_size_without_its_centre_gives_a_warning(changes, centres):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        apply(D435, changes)
    messages = [str(each.message) for each in caught]
    assert len(messages) == len(centres)
    for message, (name, centre) in zip(messages, sorted(centres.items()), strict=True):
        assert f"but {name} stays" in message and message.endswith(f"has {centre:g}.")
