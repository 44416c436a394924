"""The stage swap: what the image lacks and what the matcher does otherwise add up to the gap."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.diagnosis.where import swap
from tests.unit.diagnosis.test_features import DISPARITY, GROUND, made
from tests.unit.diagnosis.test_where import ROOMS, SCENES, readings


def test_the_gap_is_parted_between_image_and_matcher():
    found = swap.swap(readings(0, 0.02, None), readings(100, 0.05, 0.11), [GROUND] * SCENES, ROOMS)
    rate = found["ndp_rate"]
    assert rate.base == pytest.approx(0.02, abs=0.003)
    assert rate.image is not None and rate.matcher is not None
    assert rate.image[0] == pytest.approx(0.03, abs=0.004)
    assert rate.matcher[0] == pytest.approx(0.06, abs=0.004)
    _, low, high = rate.image
    assert low is not None and high is not None and low < 0.03 < high
    assert rate.image_share == pytest.approx(1 / 3, abs=0.05)
    assert found["nmad_px"].base == pytest.approx(0.1, rel=0.05)


def test_without_device_depth_or_infrared_a_part_is_missing():
    grounds = [GROUND] * SCENES
    found = swap.swap(readings(0, 0.02, None), readings(100, 0.05, None), grounds, ROOMS)[
        "ndp_rate"
    ]
    assert found.device is None and found.matcher is None and found.image_share is None
    depth_only = [dataclasses.replace(one, ours_px=None) for one in readings(9, 0.05, 0.1)]
    found = swap.swap(readings(0, 0.02, None), depth_only, grounds, ROOMS)["ndp_rate"]
    assert found.rematched is None and found.image is None and found.device is not None


def test_two_devices_are_compared_by_what_each_adds_to_our_matcher():
    """Images lose 3 points, this device 4 more than ours, the other 1."""
    grounds = [GROUND] * SCENES
    found = swap.swap(readings(0, 0.02, 0.03), readings(100, 0.05, 0.09), grounds, ROOMS)[
        "ndp_rate"
    ]
    assert found.image is not None and found.matcher is not None and found.base_device is not None
    assert found.image[0] == pytest.approx(0.03, abs=0.004)
    assert found.matcher[0] == pytest.approx(0.03, abs=0.004)
    assert found.base_device == pytest.approx(0.03, abs=0.003)


def test_where_nothing_is_scored_there_are_no_errors():
    """The left band is not scored; where the reference lies in it alone, nothing is."""
    x = np.indices(DISPARITY.shape)[1]
    left = made(np.where(x < 20, DISPARITY, np.nan).astype(np.float32))
    one = readings(0, 0.02, None)[:1]
    found = swap.swap(one, one, [left], ["hall"])
    assert found["nmad_px"].base is None and found["ndp_rate"].base is not None


def part(image: float, matcher: float) -> swap.Part:
    return swap.Part(
        base=None,
        base_device=None,
        rematched=None,
        device=None,
        image=(image, None, None),
        matcher=(matcher, None, None),
    )


def test_parts_of_opposite_signs_are_shared_by_size():
    """A matcher that fills holes takes no share away from an image that makes them."""
    assert part(0.1, -0.3).image_share == pytest.approx(0.25)
    assert part(-0.1, 0.3).image_share == pytest.approx(0.25)
    assert part(0.0, 0.0).image_share is None


def test_holes_count_where_pixels_are_counted():
    """The left band, which the right imager does not see, has no depth and is no gap."""
    full = readings(0, 0.0, None)[0]
    assert full.ours_px is not None
    blind = np.where(GROUND.counted, full.ours_px, np.float32(np.nan))
    found = swap.swap([dataclasses.replace(full, ours_px=blind)], [full], [GROUND], ["hall"])
    assert not GROUND.counted.all() and found["ndp_rate"].base == 0.0


def test_figures_are_means_over_scenes():
    """Of five scenes without holes and one of holes alone."""
    base = readings(0, 0.0, None)
    empty = dataclasses.replace(base[0], ours_px=np.full_like(DISPARITY, np.nan)[None])
    found = swap.swap([empty, *base[1:]], base, [GROUND] * SCENES, ROOMS)["ndp_rate"]
    assert found.base == pytest.approx(1 / SCENES) and found.rematched == 0.0


def test_rooms_without_depth_are_no_evidence_of_the_device():
    """Of four rooms one has none, which leaves enough for an interval; two of three do not."""

    def of(rooms: list[str], without: int) -> swap.Part:
        real = readings(100, 0.05, 0.11)[: len(rooms)]
        real = [dataclasses.replace(one, device_px=None) for one in real[:without]] + real[without:]
        base = readings(0, 0.02, None)[: len(rooms)]
        return swap.swap(base, real, [GROUND] * len(rooms), rooms)["ndp_rate"]

    found = of(["hall", "attic", "porch", "shed"], 1)
    assert found.matcher is not None
    middle, low, high = found.matcher
    assert middle == pytest.approx(0.06, abs=0.01)
    assert low is not None and high is not None and low < middle < high
    few = of(["hall", "attic", "porch"], 1)
    assert few.matcher is not None and few.matcher[1:] == (None, None)
    assert few.image is not None and few.image[1] is not None
