"""Matcher rows of the effect table: ranges are accepted, and every parameter has an effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from starling.sim.effects import Effect, Parameter, Stage
from starling.sim.effects.matcher import ROWS
from starling.sim.sensor import edits, presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.matching import match

PARAMETERS = [(row, parameter) for row in ROWS for parameter in row.parameters]
NAMES = [f"{row.name}.{parameter.name}" for row, parameter in PARAMETERS]


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    d415 = presets.load("d415")
    checks = replace(d415.matcher.checks, speckle_count=300)  # Its step acts with a count only.
    matcher = replace(d415.matcher, search_px=64, checks=checks)
    return replace(d415, matcher=matcher)


@pytest.fixture(scope="module")
def scene() -> tuple[np.ndarray, np.ndarray]:
    """A near slope before a far wall, dim in one corner, with a small object; noisy, 8 bits."""
    rng = np.random.default_rng(5)
    h, w = 96, 320
    y, x = np.mgrid[:h, :w]
    disparity = np.where((x > 140) & (x < 220) & (y > 20), 26 + (x - 140) * 0.05, 12.3)
    disparity[4:10, 250:258] = 18
    texture = np.kron(rng.random((h // 2, w)), np.ones((2, 2)))[:, : w + 80]
    albedo = np.where((x > 230) & (y > 50), 0.004, 1.0)
    right = np.empty((h, w))
    left = np.empty((h, w))
    for row in range(h):
        points = np.arange(texture.shape[1])
        # Columns are given in the left view; a nearer one overwrites what lies behind it.
        seen = np.interp(np.arange(w), points, texture[row])
        left[row] = 20 + 80 * albedo[row] * seen
        target = np.rint(np.arange(w) - disparity[row]).astype(int)
        right[row] = 20 + 80 * texture[row, rng.integers(0, w, w)]
        order = np.argsort(disparity[row], kind="stable")
        inside = order[target[order] >= 0]
        right[row, target[inside]] = left[row, inside]
    noise = rng.normal(0, 0.6, (2, h, w))
    pair = np.clip(np.stack([left, right]) + noise, 0, 255).astype(np.uint8)
    return pair[0], pair[1]


def _moved(sensor: Sensor, parameter: Parameter, value: float) -> Sensor:
    before = sensor
    for part in parameter.paths[0].split("."):
        before = getattr(before, part)
    typed = int(value) if isinstance(before, int) else value
    return edits.with_values(sensor, [(path, typed) for path in parameter.paths])


@pytest.mark.parametrize(("row", "parameter"), PARAMETERS, ids=NAMES)
def test_every_parameter_acts_and_its_range_is_admitted(sensor, scene, row: Effect, parameter):
    """At one end of its range at least the result changes; that it is the right change, other
    tests say (`test_matching.py`, `test_matcher_subpixel.py`)."""
    assert row.stage is Stage.MATCHER and not row.rerender
    assert parameter.low is not None and parameter.high is not None
    left, right = scene
    base = match(left, right, sensor.matcher)
    ends = [
        match(left, right, _moved(sensor, parameter, end).matcher)
        for end in (parameter.low, parameter.high)
    ]
    same = [np.array_equal(end.disparity_px, base.disparity_px, equal_nan=True) for end in ends]
    assert not all(same)


def test_names_are_unique_and_families_group_them():
    names = [row.name for row in ROWS]
    assert len(names) == len(set(names)) >= 16
    families = {row.family for row in ROWS}
    assert len(families) >= 12
    assert all(set(row.confused_with).isdisjoint({row.name}) for row in ROWS)
