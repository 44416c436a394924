"""Where points land: the laws and signs of the pages, to a hundredth of a pixel."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.diagnosis.validation.camera.alignment import Alignment, land, of_side
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.nominal import Nominal

PLACES = [(20.0, 70.0), (12.0, 20.0), (50.0, 60.0), (48.0, 15.0)]  # Row, column.


def _move(camera: Nominal, alignment: Alignment, row: float, column: float) -> tuple[float, float]:
    """How far the centroid of a smooth spot moves (x, y) [px]."""
    y, x = np.mgrid[: camera.height, : camera.width]
    spot = np.exp(-((x - column) ** 2 + (y - row) ** 2) / (2 * 1.5**2))
    landed = land(spot, alignment, camera)
    landed = landed / landed.sum()
    return float((landed * x).sum()) - column, float((landed * y).sum()) - row


@pytest.mark.parametrize(("row", "column"), PLACES)
def test_points_move_as_the_pages_say(row: float, column: float, camera: Nominal) -> None:
    x, y, f = column - camera.cx_px, row - camera.cy_px, camera.fx_px
    angle = math.radians(0.8)
    radius = math.hypot(x, y) / camera.half_diagonal_px
    laws = {
        Alignment(offset_x_px=0.7): (0.7, 0.0),
        Alignment(offset_y_px=-1.3): (0.0, -1.3),
        Alignment(roll_deg=0.8): (angle * y, -angle * x),
        Alignment(pitch_deg=0.8): (x * y * angle / f, f * angle * (1 + y**2 / f**2)),
        Alignment(yaw_deg=0.8): (-f * angle * (1 + x**2 / f**2), -x * y * angle / f),
        Alignment(magnification=1.02): (0.02 * x, 0.02 * y),
        Alignment(distortion_px=0.5): (
            0.5 * radius**3 * x / math.hypot(x, y),
            0.5 * radius**3 * y / math.hypot(x, y),
        ),
    }
    for alignment, law in laws.items():
        assert _move(camera, alignment, row, column) == pytest.approx(law, abs=0.02)


@settings(max_examples=20)
@given(dx=st.floats(-1.5, 1.5), dy=st.floats(-1.5, 1.5))
def test_what_goes_there_comes_back(dx: float, dy: float, camera: Nominal) -> None:
    y, x = np.mgrid[: camera.height, : camera.width]
    image = 1.0 + np.exp(-((x - 45.0) ** 2 + (y - 30.0) ** 2) / 18.0)
    there = land(image, Alignment(offset_x_px=dx, offset_y_px=dy), camera)
    back = land(there, Alignment(offset_x_px=-dx, offset_y_px=-dy), camera)
    np.testing.assert_allclose(back[5:-5, 5:-5], image[5:-5, 5:-5], atol=2e-3)


def test_distortion_is_undone_for_the_middle_too(camera: Nominal) -> None:
    flat = np.full(camera.shape, 2.0)
    np.testing.assert_allclose(land(flat, Alignment(distortion_px=0.5), camera), 2.0)


def test_nothing_moves_nothing(camera: Nominal) -> None:
    image = np.ones(camera.shape)
    assert land(image, Alignment(), camera) is image


def test_only_the_scale_of_the_lenses_is_in_both(camera: Nominal) -> None:
    values = {
        "focal_scale": 1.01,
        "disparity_offset": 0.1,
        "vertical_offset": 0.2,
        "roll": 0.3,
        "pitch": 0.4,
        "yaw": 0.5,
        "distortion": 0.6,
    }
    strengths = Strengths(nominal=camera, values=values)
    assert of_side("left", strengths) == Alignment(magnification=1.01)
    assert of_side("right", strengths) == Alignment(
        magnification=1.01,
        offset_x_px=0.1,
        offset_y_px=0.2,
        roll_deg=0.3,
        pitch_deg=0.4,
        yaw_deg=0.5,
        distortion_px=0.6,
    )
