"""Displacement of points: the laws and signs of the effect pages, to 0.02 px."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.diagnosis.validation.camera.alignment import (
    ResidualAlignment,
    imager_alignment,
    resample,
)
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.nominal import Nominal

PLACES = [(20.0, 70.0), (12.0, 20.0), (50.0, 60.0), (48.0, 15.0)]  # Row, column.


def _move(
    camera: Nominal, alignment: ResidualAlignment, row: float, column: float
) -> tuple[float, float]:
    """Return the displacement of the centroid of a smooth spot (x, y) [px]."""
    y, x = np.mgrid[: camera.height, : camera.width]
    spot = np.exp(-((x - column) ** 2 + (y - row) ** 2) / (2 * 1.5**2))
    moved = resample(spot, alignment, camera)
    moved = moved / moved.sum()
    return float((moved * x).sum()) - column, float((moved * y).sum()) - row


@pytest.mark.parametrize(("row", "column"), PLACES)
def test_points_move_by_the_laws_of_the_pages(row: float, column: float, camera: Nominal) -> None:
    x, y, f = column - camera.cx_px, row - camera.cy_px, camera.fx_px
    angle = math.radians(0.8)
    radius = math.hypot(x, y) / camera.half_diagonal_px
    laws = {
        ResidualAlignment(offset_x_px=0.7): (0.7, 0.0),
        ResidualAlignment(offset_y_px=-1.3): (0.0, -1.3),
        ResidualAlignment(roll_deg=0.8): (angle * y, -angle * x),
        ResidualAlignment(pitch_deg=0.8): (x * y * angle / f, f * angle * (1 + y**2 / f**2)),
        ResidualAlignment(yaw_deg=0.8): (-f * angle * (1 + x**2 / f**2), -x * y * angle / f),
        ResidualAlignment(magnification=1.02): (0.02 * x, 0.02 * y),
        ResidualAlignment(distortion_px=0.5): (
            0.5 * radius**3 * x / math.hypot(x, y),
            0.5 * radius**3 * y / math.hypot(x, y),
        ),
    }
    for alignment, law in laws.items():
        assert _move(camera, alignment, row, column) == pytest.approx(law, abs=0.02)


@settings(max_examples=20)
@given(dx=st.floats(-1.5, 1.5), dy=st.floats(-1.5, 1.5))
def test_opposite_offsets_cancel(dx: float, dy: float, camera: Nominal) -> None:
    y, x = np.mgrid[: camera.height, : camera.width]
    image = 1.0 + np.exp(-((x - 45.0) ** 2 + (y - 30.0) ** 2) / 18.0)
    moved = resample(image, ResidualAlignment(offset_x_px=dx, offset_y_px=dy), camera)
    back = resample(moved, ResidualAlignment(offset_x_px=-dx, offset_y_px=-dy), camera)
    np.testing.assert_allclose(back[5:-5, 5:-5], image[5:-5, 5:-5], atol=2e-3)


def test_distortion_keeps_a_uniform_image(camera: Nominal) -> None:
    flat = np.full(camera.shape, 2.0)
    np.testing.assert_allclose(resample(flat, ResidualAlignment(distortion_px=0.5), camera), 2.0)


def test_no_misalignment_returns_the_image_itself(camera: Nominal) -> None:
    image = np.ones(camera.shape)
    assert resample(image, ResidualAlignment(), camera) is image


def test_only_the_focal_scale_is_in_both_images(camera: Nominal) -> None:
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
    assert imager_alignment("left", strengths) == ResidualAlignment(magnification=1.01)
    assert imager_alignment("right", strengths) == ResidualAlignment(
        magnification=1.01,
        offset_x_px=0.1,
        offset_y_px=0.2,
        roll_deg=0.3,
        pitch_deg=0.4,
        yaw_deg=0.5,
        distortion_px=0.6,
    )
