"""Depth of the second matcher for the pairs of a capture set."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from starling.diagnosis.validation.camera.light import SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.protocol.case import Case
from starling.diagnosis.validation.protocol.rendered import UNIT_M, match_captures
from starling.diagnosis.validation.protocol.shoot import shoot
from starling.sim.captures import capture

BOX_M = 0.5


@pytest.mark.parametrize("settings", [{}, {"quantisation": 16.0}])
def test_depth_agrees_with_the_scene(
    settings: dict[str, float], light_set: Path, light: SceneLight, camera: Nominal, tmp_path: Path
) -> None:
    """For 8 and 16 bits: no disparity bias, 0.1 px error on the box, and some missing depth."""
    case = Case(number=0, kind="single" if settings else "null", settings=settings, seed=4)
    shoot(light_set, case, tmp_path / "out", frames=2)
    match_captures(tmp_path / "out", camera)
    for scene in capture.open_set(tmp_path / "out").scenes:
        for number in range(2):
            depth_m = scene.frame(number).depth_m
            assert depth_m is not None
            valid = depth_m > 0
            assert 0.3 < valid.mean() < 1.0
            true_m = light.left.depth_m
            focal = camera.fx_px * camera.baseline_m
            error_px = focal / depth_m[valid] - focal / true_m[valid]
            box = true_m[valid] < BOX_M + 0.1
            assert abs(np.nanmedian(error_px)) < 0.02
            assert np.nanmedian(np.abs(error_px[box])) < 0.1
            units = depth_m[valid] / UNIT_M
            assert np.allclose(units, np.round(units), atol=1e-3)
