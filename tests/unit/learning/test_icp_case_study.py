"""The case study on captures: a box before a wall, in the device's depth and in methods'."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from starling.learning.data import captured
from starling.learning.evaluation.evaluate import HolePrediction
from starling.learning.icp import case_study
from starling.learning.icp.study import REAL, Disturbance
from starling.patterns.errors import InputError
from starling.sim.captures import capture, info, png
from starling.sim.captures.capture import CaptureSet
from starling.sim.stereo.depth import to_code
from tests.unit.learning.drawn_scene import INFO, WALL_M, box_depth, depth

SMALL = Disturbance(most_m=0.02, most_deg=8)


def write(folder: Path, **images: np.ndarray) -> CaptureSet:
    """Write a set of one scene; its device measures 1 % too far."""
    (folder / "scene" / "0").mkdir(parents=True)
    (folder / info.FILE).write_text(info.dumps(INFO))
    codes = {
        "truth": to_code(depth(), INFO.depth_unit_m),
        "0/depth": to_code(1.01 * depth(), INFO.depth_unit_m),
        **images,
    }
    for name, code in codes.items():
        (folder / "scene" / f"{name}.png").write_bytes(png.encode(code))
    return capture.open_set(folder)


def predictions(captures: CaptureSet) -> dict[str, list[HolePrediction]]:
    (example,) = captured.examples(captures)
    nowhere = np.zeros(INFO.shape, np.float32)
    return {
        "perfect": [HolePrediction(example=example, probability=nowhere)],
        "blind": [HolePrediction(example=example, probability=nowhere + 0.6)],
    }


def test_methods_are_compared_with_the_device(tmp_path):
    """Perfect depth has almost no error, unlike the device; no depth has no result."""
    captures = write(tmp_path / "set")
    outcomes = case_study.case_study(captures, predictions(captures), trials=2, disturbance=SMALL)
    assert outcomes[REAL].visible.any() and not outcomes["blind"].visible.any()
    result = case_study.figures(outcomes)
    assert list(result) == ["perfect", "blind"]
    assert 80 < result["perfect"]["position_mean_pct"] <= 100
    assert result["perfect"]["objects"] == outcomes[REAL].visible.sum()
    assert result["perfect"]["trials"] == 2 * result["perfect"]["objects"]
    assert (
        result["perfect"]["hidden"] == result["perfect"]["shown"] == result["blind"]["objects"] == 0
    )
    assert result["blind"]["hidden"] == result["perfect"]["objects"]
    assert np.isnan(result["blind"]["rotation_var_pct"])


def test_objects_are_from_the_label_image_if_present(tmp_path):
    label = np.where(box_depth() < WALL_M, 9, 0).astype(np.uint8)
    (scene,) = write(tmp_path / "set", label=label).scenes
    assert [piece.name for piece in case_study.pieces_of(scene)] == ["9"]
    (scene,) = write(tmp_path / "plain").scenes
    assert case_study.pieces_of(scene)


def test_scenes_without_objects_or_reference_are_refused(tmp_path):
    captures = write(tmp_path / "set", label=np.zeros(INFO.shape, np.uint8))
    with pytest.raises(
        InputError, match="objects must have a shape that determines their pose; got none"
    ):
        case_study.case_study(captures, predictions(captures), trials=2)
    (tmp_path / "set" / "scene" / "truth.png").unlink()
    with pytest.raises(InputError, match=r"scene scene must have reference depth; got no truth\."):
        case_study.pieces_of(captures.scenes[0])
