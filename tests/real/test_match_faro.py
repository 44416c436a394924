"""The `d4xx` matcher on real infrared pairs, against the device that took them.

Held-out rooms only: the setting was chosen on the others (docs/decisions/0003-matcher.md).
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


def _benchmark():
    """The benchmark's reading and measuring, so that test and table cannot differ."""
    spec = importlib.util.spec_from_file_location("match_faro", ROOT / "benchmarks/match_faro.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["match_faro"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def held_out(captures: Path):
    """Medians over the held-out scenes."""
    folder = captures / "d415-faro"
    if not folder.is_dir():
        pytest.skip(f"no captures at {folder}; set STARLING_CAPTURES to the folder above it")
    benchmark = _benchmark()
    from sim.matcher import D4XX

    unseen = [scene for scene in benchmark.scenes(folder) if not scene.tuned]
    return benchmark.medians([benchmark.measure(scene, D4XX) for scene in unseen])


def test_errors_spread_no_wider_than_the_device_s(held_out):
    assert held_out["ours"]["nmad_px"] <= held_out["device"]["nmad_px"] + 0.001


def test_as_much_is_filled_as_in_the_device(held_out):
    assert abs(held_out["ours"]["fill"] - held_out["device"]["fill"]) <= 0.01


def test_values_agree_with_the_device_s(held_out):
    assert held_out["agreement"]["nmad_px"] <= 0.15


def test_what_falls_short_of_the_goal_falls_no_further(held_out):
    """Goals missed: off by > 1 px not above the device's 2.11 %, hole overlap of 0.5."""
    assert held_out["ours"]["bad1_pct"] <= held_out["device"]["bad1_pct"] + 0.3
    assert held_out["agreement"]["ndp_iou"] >= 0.41
