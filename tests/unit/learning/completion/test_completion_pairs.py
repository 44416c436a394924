"""Frames of capture sets for completion: which image, which view, why there is no depth."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from starling.learning.completion.data.pairs import pair
from starling.learning.completion.evaluation.metrics import score
from starling.patterns.errors import InputError
from starling.sim.captures import capture, exr, png
from starling.sim.captures import info as capture_info
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.reason import Reason
from starling.sim.render.layers import Layers, Truth, View
from starling.sim.stereo.depth import DepthMap, from_code
from tests.unit.learning import capture_sets
from tests.unit.learning.step_scenes import INFO, SHAPE

SIDE = Pinhole.of(INFO)


@pytest.fixture
def made(tmp_path: Path) -> Path:
    return capture_sets.write(tmp_path / "set", rooms=("attic", "hall"))


def colour_at(folder: Path, position_m: float, camera: Pinhole = SIDE) -> np.ndarray:
    """Put a colour camera beside the left imager; returns its picture."""
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


def test_infrared_goes_with_the_depth_as_it_is(made: Path) -> None:
    opened = capture.open_set(made)
    found = [pair(scene, 0, "ir_left") for scene in opened.scenes]
    assert [(one.scene, one.room, one.number) for one in found] == [
        *(("attic-view", "attic", 0), ("hall-view", "hall", 0))
    ]
    truth, ndp, infrared = capture_sets.drawn(0)
    one = found[0]
    np.testing.assert_array_equal(one.image, infrared)
    np.testing.assert_array_equal(one.valid, ~ndp)
    assert one.truth_m is not None
    np.testing.assert_allclose(one.truth_m[4:], truth[4:], atol=0.0006)
    assert one.frame.rgb.shape == (*SHAPE, 3) and one.focal_baseline_px_m == pytest.approx(4.0)


def test_a_real_camera_s_holes_are_sorted_each_once(made: Path) -> None:
    one = pair(capture.open_set(made).scenes[0], 0, "ir_left")
    total = np.sum([mask.astype(int) for mask in one.causes().values()], axis=0)
    np.testing.assert_array_equal(total, (~one.valid).astype(int))
    # Behind the pillar the right imager sees nothing; that is most of what is missing.
    assert one.causes()["occluded"].sum() > one.causes()["other"].sum()
    assert one.truth_m is not None
    known = score(one.truth_m, one.truth_m, one.valid, focal_baseline_px_m=4.0, causes=one.causes())
    assert known.reasons["occluded"].figures()["mae_m"] == 0


def test_a_match_left_of_the_right_image_is_outside_the_overlap(made: Path) -> None:
    depth = made / "attic-view" / "0" / "depth.png"
    code = png.read(depth, "depth")
    code[:, :2] = 0  # The wall's disparity is 2 to 4 px.
    depth.write_bytes(png.encode(code))
    one = pair(capture.open_set(made).scenes[0], 0, "ir_left")
    assert one.causes()["outside_overlap"][:, :2].all()


def test_without_reference_nobody_knows_why(made: Path) -> None:
    (made / "attic-view" / "truth.png").unlink()
    one = pair(capture.open_set(made).scenes[0], 0, "ir_left")
    assert one.truth_m is None and list(one.causes()) == ["unknown"]
    np.testing.assert_array_equal(one.causes()["unknown"], ~one.valid)


def simulated(folder: Path) -> np.ndarray:
    """Write a frame.exr that tells reasons; they are returned."""
    code = png.read(folder / "0" / "depth.png", "depth").astype(np.uint16)
    depth_m = from_code(code, INFO.depth_unit_m)
    valid = np.isfinite(depth_m)
    reason = np.where(valid, Reason.VALID, Reason.SHADOWED).astype(np.uint32)
    reason[~valid & (np.arange(SHAPE[0])[:, None] < 24)] = Reason.LOW_SIGNAL
    zero, none = np.zeros(SHAPE, np.float32), np.zeros(SHAPE, np.uint32)
    left = View(
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


def test_a_simulated_camera_s_holes_have_their_reasons(made: Path) -> None:
    reason = simulated(made / "attic-view")
    one = pair(capture.open_set(made).scenes[0], 0, "ir_left")
    assert list(one.causes()) == ["shadowed", "low_signal"]
    np.testing.assert_array_equal(one.causes()["shadowed"], reason == Reason.SHADOWED)


def test_reasons_may_stand_in_an_image_of_their_own(made: Path) -> None:
    reason = simulated(made / "attic-view")
    folder = made / "attic-view" / "0"
    (folder / "frame.exr").unlink()
    (folder / "reason.png").write_bytes(png.encode(reason.astype(np.uint8)))
    scene = capture.open_set(made).scenes[0]
    assert list(pair(scene, 0, "ir_left").causes()) == ["shadowed", "low_signal"]
    for wrong in (np.full(SHAPE, 99, np.uint8), np.zeros((3, 4), np.uint8)):
        (folder / "reason.png").write_bytes(png.encode(wrong))
        with pytest.raises(InputError, match="reason must be of the depth's size, with codes up"):
            pair(scene, 0, "ir_left")


def test_a_colour_image_of_the_left_imager_s_own_view_needs_nothing(made: Path) -> None:
    image = colour_at(made, 0.0)
    scene = capture.open_set(made).scenes[0]
    one, infrared = pair(scene, 0, "rgb"), pair(scene, 0, "ir_left")
    np.testing.assert_array_equal(one.image, image)
    np.testing.assert_array_equal(one.depth_m, infrared.depth_m)
    assert list(one.causes()) == list(infrared.causes())


def test_depth_and_truth_are_brought_into_the_colour_image(made: Path) -> None:
    camera = Pinhole(width=96, height=64, fx_px=100.0, fy_px=100.0, cx_px=47.5, cy_px=31.5)
    colour_at(made, -0.02, camera)
    scene = capture.open_set(made).scenes[0]
    one = pair(scene, 0, "rgb")
    assert one.image.shape == (64, 96, 3) and one.depth_m.shape == (64, 96)
    assert one.camera == camera and one.focal_baseline_px_m == pytest.approx(5.0)
    assert list(one.causes()) == ["unknown"] and one.truth_m is not None
    # A camera further left sees the pillar further right, by f t / z.
    left_m = scene.truth_m()
    assert left_m is not None
    near = np.nanmin(left_m)
    before = np.flatnonzero(np.abs(left_m[24] - near) < 0.01).mean() - INFO.cx_px
    after = np.flatnonzero(np.abs(one.truth_m[32] - near) < 0.01).mean() - camera.cx_px
    assert after == pytest.approx(100 / 80 * before + 100 * 0.02 / near, abs=1.5)


def test_pairs_refuse(made: Path) -> None:
    scene = capture.open_set(made).scenes[0]
    with pytest.raises(InputError, match="picture must be a known name; got 'ir_rihgt'"):
        pair(scene, 0, "ir_rihgt")
    with pytest.raises(InputError, match=r"frame 0 of attic-view must have ir_left_off.png"):
        pair(scene, 0, "ir_left_off")
    with pytest.raises(InputError, match=r"frame 0 of attic-view must have rgb.png; got none"):
        pair(scene, 0, "rgb")
    colour_at(made, 0.0)
    with pytest.raises(InputError, match=r"capture.toml must tell colour and colour_from_left"):
        pair(scene, 0, "rgb")  # Opened before its colour camera was known.
    (made / "attic-view" / "0" / "depth.png").unlink()
    with pytest.raises(InputError, match=r"frame 0 of attic-view must have depth.png"):
        pair(scene, 0, "ir_left")
