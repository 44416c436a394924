"""BOP's layout: poses agree with the images, as the BOP toolkit reads them."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.captures.exchange import bop
from starling.sim.datasets.render_view import MemoryFolder
from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole

BOX_M = (0.2, 0.1, 0.3)


def image(data: bytes) -> np.ndarray:
    result = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert result is not None
    return result


@pytest.fixture
def shown(small_set: Path, tmp_path: Path) -> tuple[capture.CaptureSet, Path, np.ndarray]:
    """A set whose first scene shows a half-hidden box twice; its meshes and its pose."""
    meshes = tmp_path / "meshes" / "deep"
    meshes.mkdir(parents=True)
    box = trimesh.creation.box(BOX_M)
    box.apply_translation((0.5, 0, 0))
    box.export(meshes / "box.ply")
    captures = capture.open_set(small_set)
    info = captures.info
    pose = frames.pose((-0.5, 0.0, 2.0), (0, 0, 0))
    whole = bop.silhouette(box, pose, Pinhole.from_camera(info))
    label = np.where(whole, 2, 1).astype(np.uint8)
    label[:, : info.width // 2] = 1
    for scene in captures.scenes:
        cv2.imwrite(str(scene.path / "label.png"), label)
        for number in scene.frames:
            record = {
                "bodies": ["table", "box 0"],
                "objects": [{"body": "box 0", "mesh": "box.ply", "left_from_mesh": pose.tolist()}],
                "left_from_world": frames.pose((0, 0, 1.0)).tolist(),
            }
            (scene.path / str(number) / "frame.json").write_text(json.dumps(record))
    return capture.open_set(small_set), meshes.parent, pose


def exported(shown: tuple[capture.CaptureSet, Path, np.ndarray]) -> dict[str, bytes]:
    files = MemoryFolder(Path("out"))
    count = bop.export(shown[0], shown[1], files)
    assert count == sum(len(scene.frames) for scene in shown[0].scenes)
    return files.content


def test_model_projects_onto_its_mask(shown: Any):
    """Model points project into the mask, with pose and camera as in the toolkit."""
    files = exported(shown)
    scene = "train_starling/000000"
    camera = json.loads(files[f"{scene}/scene_camera.json"])["0"]
    (truth,) = json.loads(files[f"{scene}/scene_gt.json"])["0"]
    model = trimesh.load(io.BytesIO(files["models/obj_000001.ply"]), file_type="ply")
    assert truth["obj_id"] == 1
    rotation, place = np.reshape(truth["cam_R_m2c"], (3, 3)), np.array(truth["cam_t_m2c"])
    points = model.sample(500) @ rotation.T + place  # Millimetres.
    pixels = points @ np.reshape(camera["cam_K"], (3, 3)).T
    pixels = np.rint(pixels[:, :2] / pixels[:, 2:]).astype(int)
    mask = image(files[f"{scene}/mask/000000_000000.png"]) > 0
    inside = ((pixels >= 0) & (pixels < mask.shape[::-1])).all(axis=1)
    assert inside.sum() > 100 and mask[pixels[inside, 1], pixels[inside, 0]].mean() > 0.98
    seen = image(files[f"{scene}/mask_visib/000000_000000.png"]) > 0
    assert not seen[:, : mask.shape[1] // 2].any() and (seen <= mask).all()
    np.testing.assert_allclose(camera["cam_t_w2c"], [0, 0, 1000])


def test_counts_and_boxes_match_the_masks(shown: Any):
    files = exported(shown)
    scene = "train_starling/000000"
    (counts,) = json.loads(files[f"{scene}/scene_gt_info.json"])["0"]
    mask, seen = (
        image(files[f"{scene}/{kind}/000000_000000.png"]) > 0 for kind in ("mask", "mask_visib")
    )
    assert counts["px_count_all"] == mask.sum() and counts["px_count_visib"] == seen.sum()
    assert 0.2 < counts["visib_fract"] < 0.8
    left, top, width, height = counts["bbox_obj"]
    assert mask[top : top + height, left : left + width].sum() == mask.sum()
    assert mask[top, left : left + width].any() and mask[top : top + height, left].any()
    depth = image(files[f"{scene}/depth/000000.png"])
    assert counts["px_count_valid"] == (depth[mask] > 0).sum()
    known = shown[0].scenes[0].frame(0).depth_m
    scale = json.loads(files[f"{scene}/scene_camera.json"])["0"]["depth_scale"]
    np.testing.assert_allclose(depth * scale / 1000, np.nan_to_num(known), atol=1e-6)


def test_a_model_s_size_is_in_millimetres(shown: Any):
    files = exported(shown)
    model = json.loads(files["models/models_info.json"])["1"]
    assert model["diameter"] == pytest.approx(1000 * np.linalg.norm(BOX_M))
    sizes = [model[f"size_{axis}"] for axis in "xyz"]
    assert sizes == pytest.approx([1000 * edge for edge in BOX_M])
    assert model["min_x"] == pytest.approx(400) and model["min_y"] == pytest.approx(-50)
    assert json.loads(files["camera.json"])["depth_scale"] == pytest.approx(1.0)


def test_silhouette_matches_the_rendered_body(shown: Any):
    """A distant sphere is a disc of its angular radius; points behind the camera are ignored."""
    ball = trimesh.creation.icosphere(4, 0.2)
    camera = Pinhole(width=200, height=150, fx_px=300, fy_px=300, cx_px=100, cy_px=75)
    result = bop.silhouette(ball, frames.pose((0.05, 0.02, 3.0)), camera)
    y, x = np.nonzero(result)
    assert (x.mean(), y.mean()) == pytest.approx((105, 77), abs=0.3)
    radius = 300 * 0.2 / np.sqrt(9 - 0.04)
    assert np.sqrt(result.sum() / np.pi) == pytest.approx(radius + 0.25, abs=0.35)
    assert not bop.silhouette(ball, frames.pose((0, 0, -3.0)), camera).any()


def test_missing_objects_and_meshes_are_refused(shown: Any, small_set: Path, tmp_path: Path):
    captures, meshes, _ = shown
    with pytest.raises(InputError, match=r"meshes must hold box\.ply"):
        bop.export(captures, tmp_path / "none", MemoryFolder(tmp_path))
    for scene in captures.scenes:
        (scene.path / "label.png").unlink()
    files = exported(shown)
    (counts,) = json.loads(files["train_starling/000000/scene_gt_info.json"])["0"]
    assert counts["px_count_visib"] == 0 and counts["bbox_visib"] == [-1, -1, -1, -1]
    (captures.scenes[0].path / "0" / "depth.png").unlink()
    with pytest.raises(InputError, match="must have depth; got none"):
        bop.export(captures, meshes, MemoryFolder(tmp_path))
    for scene in captures.scenes:
        (scene.path / "0" / "frame.json").write_text("{}")
    with pytest.raises(InputError, match="captures must show objects"):
        bop.export(captures, meshes, MemoryFolder(tmp_path))
