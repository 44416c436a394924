"""Bars and pictures of a diagnosis page: axis, colours and scale."""

from __future__ import annotations

import dataclasses
from typing import Any

import cv2
import numpy as np
import pytest

from starling.diagnosis.report import pictures
from starling.diagnosis.report.scene_section import scene_images
from starling.diagnosis.scenes.observation import StereoObservation, expect
from starling.diagnosis.scenes.request import Request
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.where import maps
from starling.diagnosis.where.maps import GapMap
from starling.sim.report import elements
from starling.sim.report.elements import Bar
from starling.sim.report.pictures import grey_limits
from tests.unit.diagnosis.made_diagnosis import real
from tests.unit.diagnosis.test_features import DISPARITY, GROUND
from tests.unit.diagnosis.test_where import pair_of

NAN = float("nan")


def test_bars_start_at_zero_on_one_axis():
    bars = [
        Bar(name="up", value=3.0, text="3", low=2.0, high=4.0),
        Bar(name="down", value=-1.0, text="-1", kind="part"),
        Bar(name="none", value=NAN, text="-"),
    ]
    drawn = elements.chart(bars, line=1.0)
    assert 'class="first" style="left:20.00%;width:60.00%"' in drawn
    assert 'class="whisker" style="left:60.00%;width:40.00%"' in drawn
    assert 'class="part" style="left:0.00%;width:20.00%"' in drawn
    assert drawn.count('class="line" style="left:40.00%') == 3
    assert drawn.count("<i class=") == 3 + 2 + 1 + 3
    assert "width:0.00%" in elements.chart([Bar(name="a", value=0.0, text="0")])


def decoded(data: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image[..., ::-1]


def test_maps_are_red_above_zero_blue_below_and_grey_where_unknown():
    mean = np.zeros((maps.ROWS, maps.COLUMNS))
    mean[0, 0], mean[0, 1], mean[0, 2] = 0.5, -0.5, NAN
    gap_map = GapMap(
        quantity="holes", frame=maps.CAMERA, mean=mean, deviations=mean, agreement=np.zeros(2)
    )
    image = decoded(pictures.heat(mean, 0.5, aspect=1.0))
    assert image.shape[0] / image.shape[1] == pytest.approx(9 / 16, abs=0.01)
    side = image.shape[1] // maps.COLUMNS
    cells = image[side // 2, side // 2 :: side]
    assert cells[0, 0] > 2 * cells[0, 2] and cells[1, 2] > 2 * cells[1, 0]
    assert tuple(cells[2]) == pictures.UNKNOWN and cells[3].min() > 240
    mean[1:3] = 0.25
    assert pictures.limit([gap_map], least=0.02) == pytest.approx(0.25)
    unknown = dataclasses.replace(gap_map, mean=NAN * mean)
    assert pictures.limit([unknown], least=0.02) == 0.02


def test_errors_show_holes_and_unknown_pixels():
    disparity = DISPARITY.copy()
    disparity[40:45, 100:200] = np.nan
    disparity[120:, 120:] += 1
    image = decoded(pictures.errors(disparity, GROUND))
    assert tuple(image[42, 150]) == pictures.HOLE
    assert tuple(image[10, 0]) == pictures.UNKNOWN
    assert image[10, 150].min() > 240 and image[150, 200, 0] > 2 * image[150, 200, 2]


def test_infrared_is_drawn_on_one_scale():
    dark, bright = (np.full((100, 900), level, np.uint8) for level in (10, 200))
    limits = grey_limits(dark, bright)
    images = [decoded(pictures.infrared(image, limits)) for image in (dark, bright)]
    assert images[0].max() == 0 and images[1].min() == 255
    assert images[0].shape[1] == 640
    assert decoded(pictures.infrared(dark, limits, zoomed=True)).shape[:2] == (60, 540)
    assert decoded(pictures.infrared(dark[:, :120], limits, zoomed=True)).shape[:2] == (240, 288)


class FakeSubject:
    """A scene model whose images are brighter with effects."""

    name, real, strata, against = "attic", real()[0], GROUND, None
    request = SceneModel.request

    def observe(self, request: Request) -> StereoObservation:
        return pair_of(request.seed, 1.0 + len(request.effects), 0.02)


def test_example_scene_has_common_noise_before_and_after():
    scene: Any = FakeSubject()
    each = scene_images(scene, {"a": 1.0})
    assert each.scene == "attic" and each.after is not None
    before, after = (expect(item, StereoObservation) for item in (each.before, each.after))
    assert after.left.mean() > 1.5 * before.left.mean()
    np.testing.assert_array_equal(before.ours_px, after.ours_px)
    assert scene_images(scene, {}).after is None
