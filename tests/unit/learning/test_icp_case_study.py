"""The case study on captures: a box before a wall, in the device's depth and in methods'."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from starling.learning.data import captured
from starling.learning.evaluation.evaluate import Told
from starling.learning.icp import case_study
from starling.learning.icp.alignment import Disturbance
from starling.learning.icp.study import REAL
from starling.patterns.errors import InputError
from starling.sim.captures import capture, info, png
from starling.sim.captures.capture import CaptureSet
from starling.sim.stereo.depth import to_code
from tests.unit.learning.drawn_scene import INFO, WALL_M, box_depth, depth

SMALL = Disturbance(most_m=0.02, most_deg=8)


def write(folder: Path, **images: np.ndarray) -> CaptureSet:
    """A set of one scene; its device reads 1 % too far."""
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


def told(captures: CaptureSet) -> dict[str, list[Told]]:
    (example,) = captured.examples(captures)
    nowhere = np.zeros(INFO.shape, np.float32)
    return {
        "perfect": [Told(example=example, probability=nowhere)],
        "blind": [Told(example=example, probability=nowhere + 0.6)],
    }


def test_methods_are_compared_with_the_device(tmp_path):
    """Perfect depth has next to no error, so it misses nearly all of the device's; of what is
    blind nothing can be told."""
    captures = write(tmp_path / "set")
    outcomes = case_study.case_study(captures, told(captures), trials=2, disturbance=SMALL)
    assert outcomes[REAL].visible.any() and not outcomes["blind"].visible.any()
    found = case_study.figures(outcomes)
    assert list(found) == ["perfect", "blind"]
    assert 80 < found["perfect"]["position_mean_pct"] <= 100
    assert found["perfect"]["objects"] == outcomes[REAL].visible.sum()
    assert found["perfect"]["trials"] == 2 * found["perfect"]["objects"]
    assert found["perfect"]["hidden"] == found["perfect"]["shown"] == found["blind"]["objects"] == 0
    assert found["blind"]["hidden"] == found["perfect"]["objects"]
    assert np.isnan(found["blind"]["rotation_var_pct"])


def test_objects_are_those_of_the_label_where_there_is_one(tmp_path):
    label = np.where(box_depth() < WALL_M, 9, 0).astype(np.uint8)
    (scene,) = write(tmp_path / "set", label=label).scenes
    assert [piece.name for piece in case_study.pieces_of(scene)] == ["9"]
    (scene,) = write(tmp_path / "plain").scenes
    assert case_study.pieces_of(scene)


def test_scenes_without_objects_or_reference_are_refused(tmp_path):
    captures = write(tmp_path / "set", label=np.zeros(INFO.shape, np.uint8))
    with pytest.raises(InputError, match="objects must tell their pose by their shape; got none"):
        case_study.case_study(captures, told(captures), trials=2)
    (tmp_path / "set" / "scene" / "truth.png").unlink()
    with pytest.raises(InputError, match=r"scene scene must have reference depth; got no truth\."):
        case_study.pieces_of(captures.scenes[0])
