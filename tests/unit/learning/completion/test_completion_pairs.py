"""Frames of capture sets for completion: image, view, and causes of holes."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from starling.learning.completion.data.pairs import read_pair
from starling.learning.completion.evaluation.metrics import score
from starling.patterns.errors import InputError
from starling.sim.captures import capture, exr, png
from starling.sim.captures import info as capture_info
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.reason import Reason
from starling.sim.render.layers import Layers, Truth, ViewLayers
from starling.sim.stereo.depth import DepthMap, from_code
from tests.unit.learning import capture_sets
from tests.unit.learning.step_scenes import INFO, SHAPE

SIDE = Pinhole.from_camera(INFO)


@pytest.fixture
def captures(tmp_path: Path) -> Path:
    return capture_sets.write(tmp_path / "set", rooms=("attic", "hall"))


def colour_at(folder: Path, position_m: float, camera: Pinhole = SIDE) -> np.ndarray:
    """Add a colour camera next to the left imager; returns its image."""
    rows = np.eye(4)
    rows[0, 3] = -position_m
    first, second, third, last = (tuple(row) for row in rows.tolist())
    info = dataclasses.replace(
        capture_sets.INFO_OF_SET,
        colour=camera,
        colour_from_left=(first, second, third, last),
    )
    (folder / capture_info.FILE).write_text(capture_info.dumps(info))
    image = np.random.default_rng(0).integers(0, 256, (camera.height, camera.width, 3))
    for scene in ("attic-view", "hall-view"):
        path = folder / scene / "0" / "rgb.png"
        path.write_bytes(png.encode_colour(image.astype(np.uint8)))
    return image.astype(np.uint8)


def test_infrared_is_in_the_view_of_depth(captures: Path) -> None:
    opened = capture.open_set(captures)
    result = [read_pair(scene, 0, "ir_left") for scene in opened.scenes]
    assert [(item.scene, item.room, item.number) for item in result] == [
        *(("attic-view", "attic", 0), ("hall-view", "hall", 0))
    ]
    truth, ndp, infrared = capture_sets.drawn(0)
    entry = result[0]
    np.testing.assert_array_equal(entry.image, infrared)
    np.testing.assert_array_equal(entry.valid, ~ndp)
    assert entry.truth_m is not None
    np.testing.assert_allclose(entry.truth_m[4:], truth[4:], atol=0.0006)
    assert entry.frame.rgb.shape == (*SHAPE, 3) and entry.focal_baseline_px_m == pytest.approx(4.0)


def test_holes_of_a_real_camera_have_one_kind_each(captures: Path) -> None:
    item = read_pair(capture.open_set(captures).scenes[0], 0, "ir_left")
    total = np.sum([mask.astype(int) for mask in item.causes().values()], axis=0)
    np.testing.assert_array_equal(total, (~item.valid).astype(int))
    # Most holes are half-occluded pixels next to the pillar.
    assert item.causes()["occluded"].sum() > item.causes()["other"].sum()
    assert item.truth_m is not None
    known = score(
        item.truth_m, item.truth_m, item.valid, focal_baseline_px_m=4.0, causes=item.causes()
    )
    assert known.reasons["occluded"].figures()["mae_m"] == 0


def test_a_match_left_of_the_right_image_is_outside_the_overlap(captures: Path) -> None:
    depth = captures / "attic-view" / "0" / "depth.png"
    code = png.read(depth, "depth")
    code[:, :2] = 0  # The wall's disparity is 2 to 4 px.
    depth.write_bytes(png.encode(code))
    item = read_pair(capture.open_set(captures).scenes[0], 0, "ir_left")
    assert item.causes()["outside_overlap"][:, :2].all()


def test_causes_are_unknown_without_reference(captures: Path) -> None:
    (captures / "attic-view" / "truth.png").unlink()
    item = read_pair(capture.open_set(captures).scenes[0], 0, "ir_left")
    assert item.truth_m is None and list(item.causes()) == ["unknown"]
    np.testing.assert_array_equal(item.causes()["unknown"], ~item.valid)


def simulated(folder: Path) -> np.ndarray:
    """Write a frame.exr with reasons; returns the reasons."""
    code = png.read(folder / "0" / "depth.png", "depth").astype(np.uint16)
    depth_m = from_code(code, INFO.depth_unit_m)
    valid = np.isfinite(depth_m)
    reason = np.where(valid, Reason.VALID, Reason.SHADOWED).astype(np.uint32)
    reason[~valid & (np.arange(SHAPE[0])[:, None] < 24)] = Reason.LOW_SIGNAL
    zero, none = np.zeros(SHAPE, np.float32), np.zeros(SHAPE, np.uint32)
    left = ViewLayers(
        projector_direct=zero,
        projector_indirect=zero,
        ambient=zero,
        other=zero,
        depth_m=zero,
        body=none,
    )
    truth = Truth(
        depth_m=zero,
        normal=np.zeros((*SHAPE, 3), np.float32),
        material=none,
        right_sees=none > 0,
        lit=none > 0,
    )
    layers = Layers(left=left, right=None, truth=truth)
    depth = DepthMap(disparity_px=depth_m, depth_m=depth_m, valid=valid, reason=reason)
    exr.write(folder / "0" / "frame.exr", layers, depth)
    return reason


def test_holes_of_a_simulated_camera_have_their_reasons(captures: Path) -> None:
    reason = simulated(captures / "attic-view")
    item = read_pair(capture.open_set(captures).scenes[0], 0, "ir_left")
    assert list(item.causes()) == ["shadowed", "low_signal"]
    np.testing.assert_array_equal(item.causes()["shadowed"], reason == Reason.SHADOWED)


def test_reasons_can_be_read_from_reason_png(captures: Path) -> None:
    reason = simulated(captures / "attic-view")
    folder = captures / "attic-view" / "0"
    (folder / "frame.exr").unlink()
    (folder / "reason.png").write_bytes(png.encode(reason.astype(np.uint8)))
    scene = capture.open_set(captures).scenes[0]
    assert list(read_pair(scene, 0, "ir_left").causes()) == ["shadowed", "low_signal"]
    for wrong in (np.full(SHAPE, 99, np.uint8), np.zeros((3, 4), np.uint8)):
        (folder / "reason.png").write_bytes(png.encode(wrong))
        with pytest.raises(InputError, match="reason must be of the depth's size, with codes up"):
            read_pair(scene, 0, "ir_left")


def test_a_colour_image_in_the_left_view_needs_no_registration(captures: Path) -> None:
    image = colour_at(captures, 0.0)
    scene = capture.open_set(captures).scenes[0]
    item, infrared = read_pair(scene, 0, "rgb"), read_pair(scene, 0, "ir_left")
    np.testing.assert_array_equal(item.image, image)
    np.testing.assert_array_equal(item.depth_m, infrared.depth_m)
    assert list(item.causes()) == list(infrared.causes())


def test_depth_and_truth_are_registered_to_the_colour_image(captures: Path) -> None:
    camera = Pinhole(width=96, height=64, fx_px=100.0, fy_px=100.0, cx_px=47.5, cy_px=31.5)
    colour_at(captures, -0.02, camera)
    scene = capture.open_set(captures).scenes[0]
    item = read_pair(scene, 0, "rgb")
    assert item.image.shape == (64, 96, 3) and item.depth_m.shape == (64, 96)
    assert item.camera == camera and item.focal_baseline_px_m == pytest.approx(5.0)
    assert list(item.causes()) == ["unknown"] and item.truth_m is not None
    # A camera further left sees the pillar further right, by f t / z.
    left_m = scene.truth_m()
    assert left_m is not None
    near = np.nanmin(left_m)
    before = np.flatnonzero(np.abs(left_m[24] - near) < 0.01).mean() - INFO.cx_px
    after = np.flatnonzero(np.abs(item.truth_m[32] - near) < 0.01).mean() - camera.cx_px
    assert after == pytest.approx(100 / 80 * before + 100 * 0.02 / near, abs=1.5)


def test_pairs_refuse(captures: Path) -> None:
    scene = capture.open_set(captures).scenes[0]
    with pytest.raises(InputError, match="picture must be a known name; got 'ir_rihgt'"):
        read_pair(scene, 0, "ir_rihgt")
    with pytest.raises(InputError, match=r"frame 0 of attic-view must have ir_left_off.png"):
        read_pair(scene, 0, "ir_left_off")
    with pytest.raises(InputError, match=r"frame 0 of attic-view must have rgb.png; got none"):
        read_pair(scene, 0, "rgb")
    colour_at(captures, 0.0)
    with pytest.raises(InputError, match=r"capture.toml must have colour and colour_from_left"):
        read_pair(scene, 0, "rgb")  # Opened before the colour camera was added.
    (captures / "attic-view" / "0" / "depth.png").unlink()
    with pytest.raises(InputError, match=r"frame 0 of attic-view must have depth.png"):
        read_pair(scene, 0, "ir_left")
