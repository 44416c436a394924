"""The real capture sets are read completely; tests are skipped if a set is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from starling.sim.captures import capture
from starling.sim.commands.compare import compare, dot_contrast


def _open(captures: Path, name: str) -> capture.CaptureSet:
    if not (captures / name).is_dir():
        pytest.skip(f"no capture set {name} in {captures}")
    return capture.open_set(captures / name)


def test_laser_scanner_set(captures: Path) -> None:
    result = _open(captures, "d415-faro")
    assert result.info.shape == (720, 1280) and result.info.black_level_dn == 4
    assert len(result.scenes) == 15 and len({scene.room for scene in result.scenes}) == 10
    for scene in result.scenes:
        frame, truth_m = scene.frame(0), scene.truth_m()
        assert frame.ir_left is not None and frame.ir_right is not None
        assert frame.depth_m is not None and truth_m is not None
        assert 15 < frame.ir_left.mean() < 30
        assert 0.3 < np.nanmedian(frame.depth_m) < 5
        assert 0 < np.isnan(frame.depth_m).mean() < 0.3
        assert abs(np.nanmedian(frame.depth_m / truth_m) - 1) < 0.01


def test_table_set_has_the_projector_off_too(captures: Path) -> None:
    """Dots add contrast; the difference measures the projector's contribution."""
    (scene,) = _open(captures, "d415-table").scenes
    frame = scene.frame(0)
    assert frame.ir_left is not None and frame.ir_left_off is not None
    assert frame.ir_right_off is not None
    black_level_dn = 4.0
    on, off = (dot_contrast(image, black_level_dn) for image in (frame.ir_left, frame.ir_left_off))
    assert on > 1.4 * off


def test_kinect_set_has_depth_alone(captures: Path) -> None:
    result = _open(captures, "kinect-v1-tables")
    assert result.info.depth_unit_m == 1e-4
    for scene in result.scenes:
        frame = scene.frame(0)
        assert frame.ir_left is None and frame.depth_m is not None
        assert scene.truth_m() is None and scene.room == scene.name
        assert 0.3 < np.nanmedian(frame.depth_m) < 5


def test_a_real_set_has_no_gap_to_itself(captures: Path) -> None:
    name = "d415-faro"
    _open(captures, name)
    first = capture.open_set(captures / name / "3617")
    figures = compare(first, first)["metrics"]
    assert all(figure["gap"] == 0 for figure in figures.values())
    # The device's own figures on this scene: what simulation has to meet.
    assert figures["ndp_rate"]["real"] == pytest.approx(0.0128, abs=5e-4)
    assert figures["nmad_px"]["real"] == pytest.approx(0.248, abs=5e-3)
