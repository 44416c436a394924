"""Which effects may have made a gap, and at which strengths they are simulated."""

from __future__ import annotations

import numpy as np
import pytest

from starling.diagnosis.which.candidates import LEFT_OUT, Arm, candidates, nodes, with_told
from starling.diagnosis.which.response import Signature
from starling.sim import effects
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Stage
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values

SENSOR = presets.load("d435")
SCENE = scenes.clutter(1)
ALL = [one for arm in (Arm.IMAGE, Arm.DEPTH) for one in candidates(SENSOR, SCENE, arm)]


def test_every_arm_has_the_effects_of_its_stages():
    late = (Stage.MATCHER, Stage.POST)
    for one in ALL:
        of_depth = one.effect.stage in late or one.name == "dropped_bits"
        assert of_depth == (one.arm is Arm.DEPTH)
    rows = {one.effect.name for one in ALL}
    missing = {row.name for row in effects.table()} - rows
    assert missing == {"rolling_shutter", "temporal_filter", "decimation", "registration"}


def test_without_infrared_every_effect_may_show_in_depth():
    whole = {one.name for one in candidates(SENSOR, SCENE, Arm.WHOLE)}
    assert whole == {one.name for one in ALL}


def test_every_parameter_is_a_candidate_of_its_own():
    """But of vectors that keep still, and what single readings do not show."""
    names = {one.name for one in ALL}
    others = {"model_turn", "model_turn.y", "model_turn.z", "range.far_m", "specular.roughness"}
    assert others <= names
    parameters = sum(len(row.parameters) for row in effects.table())
    left_out = sum(len(effects.named(name).parameters) for name in LEFT_OUT)
    assert len(names) == parameters - left_out


def test_what_captures_tell_is_a_node_unless_it_is_the_base():
    (one,) = (each for each in ALL if each.name == "subpixel_steps")
    told = with_told(one, 0.0625)
    assert told.told == 0.0625 and told.nodes == tuple(sorted((0.0625, *one.nodes)))
    assert one.base == 1 / 32 and with_told(one, 0.0313) is one


@pytest.mark.parametrize("one", ALL, ids=lambda one: one.name)
def test_nodes_depart_from_the_base_and_stay_in_the_range(one):
    parameter = setting.parameter_of(one.name)[1]
    assert one.base not in one.nodes and len(set(one.nodes)) == len(one.nodes) >= 1
    if not parameter.choices:
        assert list(one.nodes) == sorted(one.nodes)
        low, high = parameter.low, parameter.high
        inside = [low <= value <= high for value in one.nodes if value != 0]
        assert all(inside)


@pytest.mark.parametrize("one", [one for one in ALL if one.numeric], ids=lambda one: one.name)
def test_what_lies_between_nodes_can_be_set(one):
    """Above all whole numbers."""
    values = tuple(sorted((*one.nodes, one.base)))
    made = Signature(one, values, np.zeros((len(values), 1, 1)))
    for place in np.arange(len(values) - 1) + 0.3:
        setting.apply(SENSOR, SCENE, {one.name: made.value(place)})


def test_a_strength_of_both_signs_departs_to_both_sides():
    parameter = setting.parameter_of("vertical_offset")[1]
    values = nodes(parameter, 0.0)
    assert values == tuple(-value for value in reversed(values))
    assert values[-1] == 1.5 and values[4] == pytest.approx(0.05)


def test_a_strength_that_is_there_already_may_be_none():
    parameter = setting.parameter_of("vignetting")[1]
    assert 0.0 in nodes(parameter, 4.0) and 0.0 not in nodes(parameter, 0.0)


@pytest.mark.parametrize("rolling_s", [0.0, 0.01])
def test_a_movement_and_its_reverse_are_one_without_a_rolling_shutter(rolling_s):
    sensor = with_values(SENSOR, [("imager.rolling_shutter_s", rolling_s)])
    found = {one.name: one for one in candidates(sensor, SCENE, Arm.IMAGE)}
    for name in ("motion.y", "turning"):
        assert (min(found[name].nodes) < 0) == (rolling_s > 0)
    assert min(found["roll"].nodes) < 0
