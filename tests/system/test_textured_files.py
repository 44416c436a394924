"""Textures of mesh files in colour, against Mitsuba's own render, and in infrared and depth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests import script

textured_files = script.load("benchmarks/simulation/textured_files.py")


@pytest.mark.slow
def test_colour_pictures_agree_with_mitsubas_own(tmp_path: Path) -> None:
    """The goal is 0.98; a picture upside down or mirrored has less than 0.6."""
    camera = textured_files.sensor(192)
    truth = textured_files.reference(camera, tmp_path, "board")
    for kind in ("glb", "obj"):
        seen = textured_files.seen(textured_files.write(tmp_path, kind, "board"), camera)
        assert textured_files.correlation(seen, truth) >= 0.98
        upside_down = np.flip(seen, 0)
        assert textured_files.correlation(upside_down, truth) < 0.6


@pytest.mark.slow
def test_depth_is_lost_where_a_texture_is_dark(tmp_path: Path) -> None:
    """At 20 mW dots on the dark half are fainter than the noise; the light half keeps its depth."""
    shares = textured_files.hole_shares(tmp_path, power_w=0.02)
    assert shares["dark half"] > 0.05
    assert shares["light half"] < 0.02
    assert 0.01 < shares["no texture"] < shares["dark half"]
