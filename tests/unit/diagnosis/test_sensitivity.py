"""Detection limits of effects."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.sensitivity import (
    DetectionLimit,
    detection_limit,
    detection_limits,
    gains_enough,
    remaining_gap,
)
from tests.unit.diagnosis.made_diagnosis import segment_result
from tests.unit.diagnosis.made_gaps import (
    EFFECTS,
    VALUES,
    likelihood_of,
    noise,
    run_search,
    screening,
)


def scaled(signature: Signature, factor: float) -> Signature:
    return dataclasses.replace(signature, change=signature.change * factor)


BLUR = scaled(EFFECTS["lens_blur"], 0.1)  # So weak that only part of its range is detected.


def test_a_larger_change_is_detected_at_a_smaller_value():
    (weak,) = detection_limits(screening(scaled(BLUR, 0.5)))
    (strong,) = detection_limits(screening(BLUR))
    assert isinstance(weak.above, float) and isinstance(strong.above, float)
    assert 0 < strong.above < weak.above <= VALUES[-1]
    assert strong.below is None and strong.base == 0.0


def test_a_higher_threshold_raises_the_limit_and_no_change_is_never_detected():
    (plain,), (higher,) = (
        detection_limits(screening(BLUR, threshold=threshold)) for threshold in (12.0, 60.0)
    )
    assert isinstance(plain.above, float) and isinstance(higher.above, float)
    assert higher.above > plain.above
    assert detection_limits(screening(scaled(BLUR, 0.0))) == [
        DetectionLimit(name="lens_blur", base=0.0, below=None, above=None)
    ]


def test_all_values_beyond_the_limit_are_detected():
    """The limit of an effect without any change in the middle of its range lies beyond that."""
    change = BLUR.change.copy()
    change[2] = 0.0
    (broken,) = detection_limits(screening(dataclasses.replace(BLUR, change=change)))
    assert isinstance(broken.above, float) and broken.above > VALUES[2]


@pytest.mark.parametrize("steps", [2, 8])
def test_more_steps_give_a_finer_limit(steps: int):
    limit = detection_limit(BLUR, screening(BLUR), upwards=True, steps=steps)
    finest = detection_limit(BLUR, screening(BLUR), upwards=True, steps=32)
    assert isinstance(limit, float) and isinstance(finest, float)
    assert 0 <= limit - finest <= max(np.diff(VALUES)) / steps + 1e-9


def test_half_of_the_captures_must_show_an_effect():
    veil = EFFECTS["veil"]
    shown, not_shown = (likelihood_of(settings, 7) for settings in ({"veil": 0.5}, {}))
    assert gains_enough(veil, [shown, shown, not_shown, not_shown], screening(veil))
    assert not gains_enough(veil, [shown, not_shown, not_shown, not_shown], screening(veil))


def test_a_remaining_gap_hides_weak_effects():
    """Half of the gaps decide, and a gap of noise alone hides nothing."""
    clean = likelihood_of({}, 7)
    gap = dataclasses.replace(clean, gap=clean.gap + 3 * noise(3))
    limits = [
        detection_limit(BLUR, screening(BLUR), gaps, upwards=True, steps=32)
        for gaps in ([clean], [gap, clean, clean], [gap, gap, clean], [gap])
    ]
    alone, mostly_clean, mostly_hidden, hidden = limits
    assert isinstance(alone, float) and alone == mostly_clean
    assert isinstance(hidden, float) and hidden == mostly_hidden
    assert hidden > 1.2 * alone


def test_the_remaining_gap_is_without_accepted_effects():
    result = run_search({"lens_blur": 0.5})
    segment = segment_result(result)
    left = remaining_gap(segment)
    np.testing.assert_allclose(left.gap / left.deviation, result.residual)
