"""Stage ablation: the contributions of images and matcher add up to the gap."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.diagnosis.scenes.observation import DepthObservation
from starling.diagnosis.where import swap
from tests.unit.diagnosis.test_features import DISPARITY, GROUND, strata_of
from tests.unit.diagnosis.test_where import ROOMS, SCENES, readings


def test_gap_is_split_between_images_and_matcher():
    figures = swap.stage_figures(
        readings(0, 0.02, None), readings(100, 0.05, 0.11), [GROUND] * SCENES, ROOMS
    )
    rate = figures["ndp_rate"]
    assert rate.base == pytest.approx(0.02, abs=0.003)
    assert rate.image is not None and rate.matcher is not None
    assert rate.image[0] == pytest.approx(0.03, abs=0.004)
    assert rate.matcher[0] == pytest.approx(0.06, abs=0.004)
    _, low, high = rate.image
    assert low is not None and high is not None and low < 0.03 < high
    assert rate.image_share == pytest.approx(1 / 3, abs=0.05)
    assert figures["nmad_px"].base == pytest.approx(0.1, rel=0.05)


def test_missing_depth_or_infrared_leaves_a_contribution_out():
    scene_strata = [GROUND] * SCENES
    figures = swap.stage_figures(
        readings(0, 0.02, None), readings(100, 0.05, None), scene_strata, ROOMS
    )["ndp_rate"]
    assert figures.device is None and figures.matcher is None and figures.image_share is None
    depth_only = [DepthObservation(device_px=each.depth_px) for each in readings(9, 0.05, 0.1)]
    figures = swap.stage_figures(readings(0, 0.02, None), depth_only, scene_strata, ROOMS)[
        "ndp_rate"
    ]
    assert figures.rematched is None and figures.image is None and figures.device is not None


def test_two_devices_are_compared_relative_to_our_matcher():
    """Images lose 3 points; this device loses 4 more than our matcher, the other device 1."""
    scene_strata = [GROUND] * SCENES
    figures = swap.stage_figures(
        readings(0, 0.02, 0.03), readings(100, 0.05, 0.09), scene_strata, ROOMS
    )["ndp_rate"]
    assert (
        figures.image is not None
        and figures.matcher is not None
        and figures.base_device is not None
    )
    assert figures.image[0] == pytest.approx(0.03, abs=0.004)
    assert figures.matcher[0] == pytest.approx(0.03, abs=0.004)
    assert figures.base_device == pytest.approx(0.03, abs=0.003)


def test_unscored_scenes_have_no_errors():
    """The left band is not scored, so a reference that lies only there gives no errors."""
    x = np.indices(DISPARITY.shape)[1]
    left = strata_of(np.where(x < 20, DISPARITY, np.nan).astype(np.float32))
    each = readings(0, 0.02, None)[:1]
    figures = swap.stage_figures(each, each, [left], ["hall"])
    assert figures["nmad_px"].base is None and figures["ndp_rate"].base is not None


def part(image: float, matcher: float) -> swap.StageFigures:
    return swap.StageFigures(
        base=None,
        base_device=None,
        rematched=None,
        device=None,
        image=(image, None, None),
        matcher=(matcher, None, None),
    )


def test_opposite_contributions_are_shared_by_size():
    """Contributions of opposite sign are shared by absolute size."""
    assert part(0.1, -0.3).image_share == pytest.approx(0.25)
    assert part(-0.1, 0.3).image_share == pytest.approx(0.25)
    assert part(0.0, 0.0).image_share is None


def test_holes_count_where_pixels_are_counted():
    """The left band, which the right imager does not see, does not count as holes."""
    full = readings(0, 0.0, None)[0]
    blind = np.where(GROUND.counted, full.ours_px, np.float32(np.nan))
    figures = swap.stage_figures(
        [dataclasses.replace(full, ours_px=blind)], [full], [GROUND], ["hall"]
    )
    assert not GROUND.counted.all() and figures["ndp_rate"].base == 0.0


def test_figures_are_means_over_scenes():
    """Five scenes have no holes, and one has nothing but holes."""
    base = readings(0, 0.0, None)
    empty = dataclasses.replace(base[0], ours_px=np.full_like(DISPARITY, np.nan)[None])
    figures = swap.stage_figures([empty, *base[1:]], base, [GROUND] * SCENES, ROOMS)["ndp_rate"]
    assert figures.base == pytest.approx(1 / SCENES) and figures.rematched == 0.0


def test_rooms_without_depth_do_not_count_for_the_device():
    """Three of four rooms with depth suffice for an interval; two of three do not."""

    def rate_of(rooms: list[str], without: int) -> swap.StageFigures:
        pairs, full = (readings(100, 0.05, device)[: len(rooms)] for device in (None, 0.11))
        real = [*pairs[:without], *full[without:]]
        base = readings(0, 0.02, None)[: len(rooms)]
        return swap.stage_figures(base, real, [GROUND] * len(rooms), rooms)["ndp_rate"]

    figures = rate_of(["hall", "attic", "porch", "shed"], 1)
    assert figures.matcher is not None
    middle, low, high = figures.matcher
    assert middle == pytest.approx(0.06, abs=0.01)
    assert low is not None and high is not None and low < middle < high
    few = rate_of(["hall", "attic", "porch"], 1)
    assert few.matcher is not None and few.matcher[1:] == (None, None)
    assert few.image is not None and few.image[1] is not None
