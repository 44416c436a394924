"""Cached searches give the same depth, and never that of another pair."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.sim.sensor.matcher import named
from starling.sim.stereo import matching, semiglobal
from starling.sim.stereo.memory import Memory

MATCHER = dataclasses.replace(named("d4xx"), search_px=16)


def pair(seed: int) -> tuple[np.ndarray, np.ndarray]:
    wide = np.random.default_rng(seed).integers(0, 256, (40, 70), np.uint8)
    return wide[:, :60], wide[:, 5:65]


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    searched: list[int] = []
    search = semiglobal.select

    def counted(*arguments: object, **keywords: int) -> semiglobal.Winners:
        searched.append(keywords["p1"])
        return search(*arguments, **keywords)  # type: ignore[arg-type]

    monkeypatch.setattr(semiglobal, "select", counted)
    return searched


def test_checks_and_refinement_reuse_the_search(searches: list[int]) -> None:
    memory, (left, right) = Memory(1), pair(1)
    strict = dataclasses.replace(
        MATCHER,
        engine=dataclasses.replace(MATCHER.engine, second_peak=40.0, neighbour_peak=30.0),
        checks=dataclasses.replace(MATCHER.checks, uniqueness=60.0, speckle_count=0),
    )
    for matcher in (MATCHER, strict, MATCHER):
        once = matching.match(left, right, matcher, memory=memory)
        np.testing.assert_array_equal(
            once.disparity_px, matching.match(left, right, matcher).disparity_px
        )
    assert len(searches) == 3 + 1  # One of them remembered.


def test_other_pairs_and_searches_are_computed(searches: list[int]) -> None:
    memory, (left, right) = Memory(2), pair(1)
    matching.match(left, right, MATCHER, memory=memory)
    for matcher in (
        dataclasses.replace(MATCHER, min_disparity_px=2),
        dataclasses.replace(MATCHER, search_px=32),
        dataclasses.replace(
            MATCHER, engine=dataclasses.replace(MATCHER.engine, small_penalty=20.0)
        ),
    ):
        matching.match(left, right, matcher, memory=memory)
    matching.match(*pair(2), MATCHER, memory=memory)
    matching.match(left, left, MATCHER, memory=memory)
    assert len(searches) == 6


def test_only_the_first_searches_are_stored(searches: list[int]) -> None:
    memory = Memory(1)
    for seed in (1, 2, 1, 2):
        matching.match(*pair(seed), MATCHER, memory=memory)
    assert len(searches) == 3
