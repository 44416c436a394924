"""The device with a matcher of its own: depth beside every pair, of the wall and the box."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from starling.diagnosis.validation.camera.device import UNIT_M, measure
from starling.diagnosis.validation.camera.light import Light
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.shoot import shoot
from starling.sim.captures import capture

BOX_M = 0.5


@pytest.mark.parametrize("settings", [{}, {"quantisation": 16.0}])
def test_depth_is_that_of_the_light(
    settings: dict[str, float], light_set: Path, light: Light, camera: Nominal, tmp_path: Path
) -> None:
    """Of 8 and of 16 bits alike: disparity without a bias, a box's to 0.1 px; some is not found."""
    case = Case(number=0, kind="single" if settings else "null", settings=settings, seed=4)
    shoot(light_set, case, tmp_path / "out", frames=2)
    measure(tmp_path / "out", camera)
    for scene in capture.open_set(tmp_path / "out").scenes:
        for number in range(2):
            depth_m = scene.frame(number).depth_m
            assert depth_m is not None
            seen = depth_m > 0
            assert 0.3 < seen.mean() < 1.0
            true_m = light.left.depth_m
            focal = camera.fx_px * camera.baseline_m
            error_px = focal / depth_m[seen] - focal / true_m[seen]
            box = true_m[seen] < BOX_M + 0.1
            assert abs(np.nanmedian(error_px)) < 0.02
            assert np.nanmedian(np.abs(error_px[box])) < 0.1
            assert np.allclose(depth_m[seen] / UNIT_M, np.round(depth_m[seen] / UNIT_M), atol=1e-3)
