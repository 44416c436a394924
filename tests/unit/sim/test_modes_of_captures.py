"""Captures choose the mode of their image size."""

from __future__ import annotations

from pathlib import Path

import pytest

from starling.sim.captures import info as capture_info
from starling.sim.captures import writer
from starling.sim.sensor import presets, resolve


def test_captures_choose_the_mode_of_their_size(tmp_path: Path) -> None:
    """Without `mode`, keys of the mode hold as well as its scale."""
    mode = presets.load("d415", mode="640x360")
    info = writer.info_of(mode, source="-", licence="-", notes="")
    (tmp_path / "capture.toml").write_text(capture_info.dumps(info))
    (tmp_path / "a" / "0").mkdir(parents=True)
    (tmp_path / "a" / "room").write_text("a")
    assert resolve.load("d415", captures=str(tmp_path)) == mode
    assert mode.post.near_m == pytest.approx(0.195)
