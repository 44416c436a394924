"""Depth-only calibration of the real D415 from three rooms, without infrared."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import script

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def geometry(captures: Path):
    """Fit of f b and offset to three rooms."""
    folder = captures / "d415-faro"
    if not folder.is_dir():
        pytest.skip(f"no captures at {folder}; set STARLING_CAPTURES to the folder above it")
    benchmark = script.load("benchmarks/calibration/calibrate_depth_only.py")
    return benchmark.outcome(folder, 3, free=("baseline", "offset"))


def test_device_s_focal_baseline_is_recovered(geometry) -> None:
    """The device uses 49.47 px m. Rooms differ by 0.4 % because of the references' poses."""
    result = {estimate.name: estimate for estimate in geometry.solution.estimates}["focal_baseline"]
    assert abs(result.value - 49.47) < 3 * result.sd
    assert result.sd < 0.005 * result.value


def test_calibration_reduces_bias_in_held_out_rooms(geometry) -> None:
    """The median bias difference from the device falls in rooms that were not fitted."""
    gaps = {
        side: sorted(
            abs(row[f"bias_px_{side}"] - row["bias_px_device"])
            for row in geometry.held_out.values()
        )[len(geometry.held_out) // 2]
        for side in ("before", "after")
    }
    assert gaps["after"] < gaps["before"]
