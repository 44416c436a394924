"""Gap figures: zero for a set against itself, correct for known changes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.commands.compare import compare, dot_contrast, pair_scenes

NAMES = {"ndp_rate", "ndp_iou", "nmad_px", "dot_contrast", "mean_dn"}


def _change(path: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    cv2.imwrite(str(path), change(image))


def test_a_set_against_itself_has_no_gap(small_set: Path) -> None:
    captures = capture.open_set(small_set)
    result = compare(captures, captures)
    assert set(result["scenes"]) == {"a", "b"}
    assert set(result["metrics"]) == NAMES
    assert all(figure["gap"] == 0 for figure in result["metrics"].values())
    assert result["metrics"]["ndp_iou"]["sim"] == 1
    assert result["metrics"]["ndp_rate"]["real"] == pytest.approx(100 / (48 * 32))
    assert result["only_real"] == result["only_sim"] == []


def test_known_changes_are_measured(small_set: Path, write_set: Callable, tmp_path: Path) -> None:
    second = write_set(tmp_path / "sim", scenes=("a", "c"))
    frame = second / "a" / "0"
    _change(frame / "ir_left.png", lambda image: image + np.uint8(5))

    def move_hole(depth: np.ndarray) -> np.ndarray:
        depth[10:20, 140:145], depth[10:20, 150:155] = 1000, 0
        return depth

    _change(frame / "depth.png", move_hole)
    result = compare(capture.open_set(small_set), capture.open_set(second))
    assert result["only_real"] == ["b"] and result["only_sim"] == ["c"]
    figures = result["scenes"]["a"]
    assert figures["mean_dn"]["gap"] == pytest.approx(5)
    assert figures["ndp_iou"]["sim"] == pytest.approx(1 / 3)
    assert figures["ndp_rate"]["gap"] == pytest.approx(0)
    assert figures["dot_contrast"]["gap"] < 0


def test_missing_figures_are_nan(small_set: Path) -> None:
    for scene in ("a", "b"):
        for name in ("ir_left.png", "ir_right.png"):
            (small_set / scene / "0" / name).unlink()
        (small_set / scene / "truth.png").unlink()
    captures = capture.open_set(small_set)
    figures = compare(captures, captures)["metrics"]
    known = {name for name, figure in figures.items() if np.isfinite(figure["sim"])}
    assert known == {"ndp_rate", "ndp_iou"}


def test_depth_may_be_missing_and_truth_unknown(small_set: Path) -> None:
    (small_set / "a" / "0" / "depth.png").unlink()
    _change(small_set / "b" / "truth.png", np.zeros_like)
    captures = capture.open_set(small_set)
    scenes = compare(captures, captures)["scenes"]
    assert np.isnan(scenes["a"]["ndp_iou"]["sim"]) and np.isnan(scenes["a"]["ndp_rate"]["sim"])
    assert np.isnan(scenes["b"]["nmad_px"]["sim"]) and np.isnan(scenes["b"]["ndp_rate"]["sim"])


def test_two_single_scenes_are_paired_regardless_of_names(small_set: Path) -> None:
    first, second = capture.open_set(small_set / "a"), capture.open_set(small_set / "b")
    assert [(a.name, b.name) for a, b in pair_scenes(first, second)] == [("a", "b")]


def test_sets_that_cannot_be_compared(small_set: Path, write_set: Callable, tmp_path: Path) -> None:
    second = write_set(tmp_path / "sim", scenes=("c", "d"))
    with pytest.raises(InputError, match="must have a scene in common; got a, b and c, d"):
        compare(capture.open_set(small_set), capture.open_set(second))
    info = second / "capture.toml"
    info.write_text(info.read_text().replace("width = 160", "width = 152"))
    with pytest.raises(InputError, match="must have one image size"):
        compare(capture.open_set(small_set / "a"), capture.open_set(second / "c"))


@pytest.mark.parametrize("key", ["fx_px", "cx_px", "baseline_m"])
def test_another_camera_is_reported(
    small_set: Path, write_set: Callable, tmp_path: Path, key: str
) -> None:
    second = write_set(tmp_path / "sim", scenes=("a",))
    info = capture.open_set(second).info
    changed = dataclasses.replace(info, **{key: 1.5 * getattr(info, key)})
    (second / "capture.toml").write_text(capture.capture_info.dumps(changed))
    with pytest.warns(UserWarning, match="a: focal length, centre or baseline of real and"):
        compare(capture.open_set(small_set), capture.open_set(second))


def test_dot_contrast_of_a_checkerboard() -> None:
    """Levels 20 and 60 DN above a black level of 4: (60 - 20) / (60 + 20)."""
    board = np.indices((64, 64)).sum(axis=0) // 4 % 2
    image = (24 + 40 * board).astype(np.uint8)
    assert dot_contrast(image, 4) == pytest.approx(0.5)
    assert dot_contrast(np.full((64, 64), 90, np.uint8), 4) == 0
    assert np.isnan(dot_contrast(np.full((64, 64), 5, np.uint8), 4))
    assert np.isnan(dot_contrast(np.full((8, 64), 5, np.uint16), 4))
