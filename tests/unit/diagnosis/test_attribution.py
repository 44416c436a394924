"""Families of effects that act on no segment of the captures."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from starling.diagnosis.which.attribution import untried_segments
from starling.diagnosis.which.candidates import Segment
from starling.patterns.errors import InputError
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets

SCENE: Any = SimpleNamespace(
    sensor=presets.load("d435"), scene=scenes.wall(1.0), nuisances={}, against=None
)
BOTH = (Segment.IMAGE, Segment.DEPTH)


def test_segments_on_which_no_family_acts_are_untried() -> None:
    assert untried_segments(BOTH, [SCENE], None) == []
    assert untried_segments(BOTH, [SCENE], ["tone_curve"]) == [Segment.DEPTH]


@pytest.mark.parametrize("family", ["pixel_locking", "rolling_shutter"])
def test_families_that_act_on_nothing_are_refused(family: str) -> None:
    """One acts on depth alone, the other on nothing."""
    rule = "families must have an effect that acts on what these captures hold"
    with pytest.raises(InputError, match=f"{rule}; got {family}"):
        untried_segments([Segment.IMAGE], [SCENE], [family])
