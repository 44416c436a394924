"""Candidates of a pipeline segment, and the values at which they are simulated."""

from __future__ import annotations

import numpy as np
import pytest

from starling.diagnosis.which.candidates import (
    LEFT_OUT,
    Candidate,
    Segment,
    candidates,
    nodes,
    with_measured_node,
)
from starling.diagnosis.which.response import Signature
from starling.sim import effects
from starling.sim.effects import setting
from starling.sim.effects.effect import Stage
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values

SENSOR = presets.load("d435")
SCENE = scenes.clutter(1)
ALL = [
    candidate
    for segment in (Segment.IMAGE, Segment.DEPTH)
    for candidate in candidates(SENSOR, SCENE, segment)
]


def name_of(candidate: Candidate) -> str:
    return candidate.name


def test_each_segment_has_the_effects_of_its_stages():
    late = (Stage.MATCHER, Stage.POST)
    for candidate in ALL:
        of_depth = candidate.effect.stage in late or candidate.name == "dropped_bits"
        assert of_depth == (candidate.segment is Segment.DEPTH)
    rows = {candidate.effect.name for candidate in ALL}
    missing = {row.name for row in effects.table()} - rows
    assert missing == {"rolling_shutter", "temporal_filter", "decimation", "registration"}


def test_without_infrared_all_effects_are_candidates():
    whole = {candidate.name for candidate in candidates(SENSOR, SCENE, Segment.WHOLE)}
    assert whole == {candidate.name for candidate in ALL}


def test_each_parameter_is_a_candidate():
    """Except parameters of effects that single frames do not show."""
    names = {candidate.name for candidate in ALL}
    further = {"model_turn", "model_turn.y", "model_turn.z", "range.far_m", "specular.roughness"}
    assert further <= names
    parameters = sum(len(row.parameters) for row in effects.table())
    left_out = sum(len(effects.named(name).parameters) for name in LEFT_OUT)
    assert len(names) == parameters - left_out


def test_a_measured_value_is_a_node_unless_it_equals_the_base():
    (steps,) = (candidate for candidate in ALL if candidate.name == "subpixel_steps")
    extended = with_measured_node(steps, 0.0625)
    assert extended.measured == 0.0625
    assert extended.nodes == tuple(sorted((0.0625, *steps.nodes)))
    assert steps.base == 1 / 32 and with_measured_node(steps, 0.0313) is steps


@pytest.mark.parametrize("candidate", ALL, ids=name_of)
def test_nodes_differ_from_the_base_and_lie_in_the_range(candidate: Candidate):
    parameter = setting.parameter_of(candidate.name)[1]
    assert candidate.base not in candidate.nodes
    assert len(set(candidate.nodes)) == len(candidate.nodes) >= 1
    if not parameter.choices:
        assert list(candidate.nodes) == sorted(candidate.nodes)
        low, high = parameter.low, parameter.high
        assert low is not None and high is not None
        assert all(low <= float(value) <= high for value in candidate.nodes if value != 0)


@pytest.mark.parametrize(
    "candidate", [candidate for candidate in ALL if candidate.numeric], ids=name_of
)
def test_values_between_nodes_can_be_set(candidate: Candidate):
    """In particular those of integer parameters."""
    values = tuple(sorted((*candidate.nodes, candidate.base), key=float))
    signature = Signature(candidate, values, np.zeros((len(values), 1, 1)))
    for place in np.arange(len(values) - 1) + 0.3:
        setting.apply(SENSOR, SCENE, {candidate.name: signature.value(place)})


def test_an_effect_of_both_signs_has_nodes_on_both_sides():
    parameter = setting.parameter_of("vertical_offset")[1]
    values = nodes(parameter, 0.0)
    assert values == tuple(-float(value) for value in reversed(values))
    assert values[-1] == 1.5 and values[4] == pytest.approx(0.05)


def test_an_effect_in_the_base_can_be_absent():
    parameter = setting.parameter_of("vignetting")[1]
    assert 0.0 in nodes(parameter, 4.0) and 0.0 not in nodes(parameter, 0.0)


@pytest.mark.parametrize("rolling_s", [0.0, 0.01])
def test_opposite_motions_are_equal_without_a_rolling_shutter(rolling_s: float):
    sensor = with_values(SENSOR, [("imager.rolling_shutter_s", rolling_s)])
    by_name = {candidate.name: candidate for candidate in candidates(sensor, SCENE, Segment.IMAGE)}
    for name in ("motion.y", "turning"):
        assert (min(map(float, by_name[name].nodes)) < 0) == (rolling_s > 0)
    assert min(map(float, by_name["roll"].nodes)) < 0
