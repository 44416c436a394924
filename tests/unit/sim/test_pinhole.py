"""The pinhole camera: sizes and rays."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.sim.geometry.pinhole import Pinhole

CAMERA = Pinhole(width=161, height=120, fx_px=100.0, fy_px=110.0, cx_px=70.3, cy_px=50.8)


@given(st.integers(8, 2000), st.floats(0.5, 2.0))
def test_a_resized_camera_has_the_same_field(width: int, aspect: float) -> None:
    """The rays of the image's borders, half a pixel outside the outer centres, stay."""
    height = max(round(aspect * width * CAMERA.height / CAMERA.width), 1)
    resized = CAMERA.resized(width, height)
    assert (resized.width, resized.height) == (width, height)
    for before, after in ((-0.5, -0.5), (CAMERA.width - 0.5, width - 0.5)):
        ray = (before - CAMERA.cx_px) / CAMERA.fx_px
        assert (after - resized.cx_px) / resized.fx_px == pytest.approx(ray, abs=1e-12)
    for before, after in ((-0.5, -0.5), (CAMERA.height - 0.5, height - 0.5)):
        ray = (before - CAMERA.cy_px) / CAMERA.fy_px
        assert (after - resized.cy_px) / resized.fy_px == pytest.approx(ray, abs=1e-12)
