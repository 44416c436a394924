"""From which strength on an effect would have been noticed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.sensitivity import Noticed, enough, least, noticed
from tests.unit.diagnosis import made_gaps as made
from tests.unit.diagnosis.made_gaps import screen


def times(of: Signature, factor: float) -> Signature:
    return dataclasses.replace(of, change=of.change * factor)


BLUR = times(made.MADE["lens_blur"], 0.1)  # So weak that only some of its range is noticed.


def test_what_does_more_is_noticed_when_weaker():
    (weak,) = noticed(screen(times(BLUR, 0.5)))
    (strong,) = noticed(screen(BLUR))
    assert isinstance(weak.above, float) and isinstance(strong.above, float)
    assert 0 < strong.above < weak.above <= made.VALUES[-1]
    assert strong.below is None and strong.base == 0.0


def test_a_higher_threshold_asks_for_more_and_what_does_nothing_is_never_noticed():
    (plain,), (higher,) = (noticed(screen(BLUR, threshold=one)) for one in (12.0, 60.0))
    assert isinstance(plain.above, float) and isinstance(higher.above, float)
    assert higher.above > plain.above
    assert noticed(screen(times(BLUR, 0.0))) == [
        Noticed(name="lens_blur", base=0.0, below=None, above=None)
    ]


def test_from_the_nearest_value_on_all_are_noticed():
    """An effect whose middle strength undoes itself counts from beyond it."""
    change = BLUR.change.copy()
    change[2] = 0.0
    (broken,) = noticed(screen(dataclasses.replace(BLUR, change=change)))
    assert isinstance(broken.above, float) and broken.above > made.VALUES[2]


@pytest.mark.parametrize("steps", [2, 8])
def test_more_steps_tell_it_closer(steps):
    found = least(BLUR, screen(BLUR), upwards=True, steps=steps)
    finest = least(BLUR, screen(BLUR), upwards=True, steps=32)
    assert isinstance(found, float) and isinstance(finest, float)
    assert 0 <= found - finest <= max(np.diff(made.VALUES)) / steps + 1e-9


def test_half_of_the_readings_have_to_show_it():
    of = made.MADE["veil"]
    shown, not_shown = (made.likelihood_of(told, 7) for told in ({"veil": 0.5}, {}))
    asked = screen(of)
    assert enough(of, [shown, shown, not_shown, not_shown], asked)
    assert not enough(of, [shown, not_shown, not_shown, not_shown], asked)
