"""Score statistics: resampling of sets, weighted medians, coverage of intervals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.score import score
from starling.diagnosis.validation.protocol.score_statistic import ScoreStatistic
from tests.unit.diagnosis.validation.made_results import (
    FAMILIES,
    make_effect,
    make_result,
    make_verdict,
)


def test_bootstrap_resamples_whole_sets() -> None:
    """Rationale: of two resampled sets, both are the same set with probability 1/2."""
    statistic = ScoreStatistic(values=(1.0, 1.0, 0.0, 0.0), set_numbers=(3, 3, 8, 8))
    assert statistic.value == 0.5
    assert statistic.interval([8, 3]) == (0.0, 1.0)
    assert statistic.interval([3]) is None
    assert ScoreStatistic(values=(), set_numbers=()).interval([1, 2]) is None
    lone = ScoreStatistic(values=(4.0, 6.0), set_numbers=(3, 3), median=True)
    assert lone.interval([3, 8]) == (5.0, 5.0)  # Samples without the set have no value.


@given(
    values=st.lists(st.tuples(st.floats(-9, 9), st.integers(0, 4)), min_size=1, max_size=9),
    times=st.lists(st.integers(0, 3), min_size=5, max_size=5),
)
def test_weighted_medians_are_medians_of_repeated_values(
    values: list[tuple[float, int]], times: list[int]
) -> None:
    numbers, set_numbers = zip(*values, strict=True)
    repeated = np.repeat(numbers, [times[number] for number in set_numbers])
    weights = np.array([[times[number] for number in set_numbers]])
    if repeated.size:
        statistic = ScoreStatistic(values=numbers, set_numbers=set_numbers, median=True)
        assert statistic._medians(weights) == pytest.approx([np.median(repeated)])


def test_bootstrap_agrees_with_the_binomial() -> None:
    """Law: if every case has its own set, the interval is p +- 1.96 sqrt(p (1 - p) / n)."""
    values = tuple(float(i % 4 == 0) for i in range(100))
    ends = ScoreStatistic(values=values, set_numbers=tuple(range(100))).interval(range(100))
    assert ends is not None
    half = 1.96 * math.sqrt(0.25 * 0.75 / 100)
    np.testing.assert_allclose(ends, (0.25 - half, 0.25 + half), atol=0.015)


def test_unanimous_cases_have_the_exact_interval() -> None:
    """Law: with a true share of 0.025^(1 / n), n of n cases are correct once in 40 times."""
    ends = ScoreStatistic(values=(1.0,) * 20, set_numbers=(0, 1, 2, 3) * 5, share=True).interval(
        range(4)
    )
    assert ends == (pytest.approx(0.025 ** (1 / 20)), 1.0)


@pytest.mark.parametrize(("right", "cases"), [(0.93, 96), (0.93, 24), (0.05, 20), (0.6, 24)])
def test_intervals_of_few_sets_have_their_coverage(right: float, cases: int) -> None:
    """Plain percentile intervals of six sets have a coverage of 0.74 to 0.89."""
    rng = np.random.default_rng(0)
    set_numbers = tuple(np.arange(cases) % 6)
    covered = []
    for _ in range(100):
        values = tuple((rng.random(cases) < right).astype(float))
        ends = ScoreStatistic(values=values, set_numbers=set_numbers, share=True).interval(range(6))
        assert ends is not None
        covered.append(ends[0] <= right <= ends[1])
    assert np.mean(covered) >= 0.93


def test_intervals_of_correlated_cases_have_their_coverage() -> None:
    """Cases of a set are correlated. Plain percentile intervals have a coverage of 0.90."""
    rng = np.random.default_rng(0)
    set_numbers = tuple(np.arange(24) % 6)
    covered = []
    for _ in range(300):
        values = rng.standard_normal(6)[np.array(set_numbers)] + 0.3 * rng.standard_normal(24)
        ends = ScoreStatistic(values=tuple(values), set_numbers=set_numbers).interval(range(6))
        assert ends is not None
        covered.append(ends[0] <= 0 <= ends[1])
    assert 0.93 <= np.mean(covered) <= 0.99


def test_bootstrap_of_scores(camera: Nominal) -> None:
    blur = {"lens_blur": 0.8}
    right, wrong = (
        make_verdict("effects", make_effect("lens_blur", 0.8)),
        make_verdict("effects", make_effect("gain")),
    )
    cases = [make_result(blur, right, set_number=1), make_result(blur, wrong, set_number=2)]
    ends = score(cases, camera, families=FAMILIES, tier=1)["intervals"]
    assert ends["top1"] == [0.0, 1.0]
    assert ends["set_size"] == [1.0, 1.0]
    assert "false_alarm" not in ends and "answered" not in ends
    assert score(cases, camera, families=FAMILIES, tier=4)["intervals"] == {}  # Sets share rooms.
