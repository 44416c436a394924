"""The shipped network in real rooms that were not used for any choice."""

from __future__ import annotations

import pytest

ROOMS = ("g", "4426", "5074", "k", "6422")


@pytest.mark.long
def test_shipped_weights_fill_real_holes_better_than_plain_fills(captures, tmp_path):
    """At least a fifth better in holes, and no worse where the device has depth."""
    pytest.importorskip("torch", reason="the extra learning is not installed")
    from starling.learning.completion.commands.judge_captures import judge_captures

    report = judge_captures(
        str(captures / "d415-faro"), ("wls", "poisson", "small"), tmp_path / "out", rooms=ROOMS
    )
    gains = report["gains"]["small"]
    for figure in ("mae_m", "rmse_m"):
        assert gains["hole"][figure]["gain_pct"] >= 20
        assert gains["valid"][figure]["gain_pct"] >= 0
    assert gains["hole"]["mae_m"]["rooms_better"] == len(ROOMS)


@pytest.mark.long
def test_expected_error_holds_in_rooms_that_it_was_not_fitted_in(captures, tmp_path):
    """Sigma is correct where the device has depth. Intervals hold nearly their share."""
    pytest.importorskip("torch", reason="the extra learning is not installed")
    from starling.learning.completion.commands.judge_captures import judge_captures

    rooms = ("0742", "e", "3049", "5074", "k")
    report = judge_captures(str(captures / "d415-faro"), ("small",), tmp_path / "out", rooms=rooms)[
        "sigma"
    ]["small"]
    assert 0.85 <= report["valid"]["rms_over_sigma"] <= 1.1
    assert report["hole"]["rms_over_sigma"] <= 1.2
    assert report["hole, grazing"]["rms_over_sigma"] <= 1
    assert report["valid"]["interval_95"] >= 0.95 and report["hole"]["interval_95"] >= 0.92
    assert report["valid"]["interval_68"] >= 0.68 and report["hole"]["interval_68"] >= 0.65
