"""TUM's RGB-D layout: round trip, and agreement with the benchmark's own tools."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.captures.exchange import tum
from starling.sim.datasets.render_view import MemoryFolder
from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_quaternions_are_rotations(turn: list[float]):
    pose = frames.pose((1.0, 2.0, 3.0), tuple(np.rad2deg(turn)))
    back = frames.from_quaternion(pose[:3, 3], np.array(frames.to_quaternion(pose)))
    np.testing.assert_allclose(back, pose, atol=1e-12)
    assert frames.to_quaternion(pose)[3] >= 0


def test_a_quarter_turn_about_z_by_hand():
    half = np.sqrt(0.5)
    assert frames.to_quaternion(frames.pose((0, 0, 0), (0, 0, 90))) == pytest.approx(
        (0, 0, half, half)
    )


def posed(folder: Path) -> list[np.ndarray]:
    """Give every frame of a set a pose; return the poses in the order of scenes and frames."""
    result = []
    for number, scene in enumerate(capture.open_set(folder).scenes):
        for repeat in scene.frames:
            pose = frames.pose((0.1 * number, 0.2, -0.3), (0, 5.0 * number, 10.0 * repeat))
            path = scene.path / str(repeat) / "frame.json"
            record = json.loads(path.read_text()) if path.exists() else {}
            path.write_text(json.dumps({**record, "left_from_world": np.linalg.inv(pose).tolist()}))
            result.append(pose)
    return result


def written(small_set: Path, out: Path) -> int:
    files = MemoryFolder(out)
    count = tum.export(capture.open_set(small_set).scenes, files)
    for name, data in files.content.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_bytes(data)
    return count


def test_export_round_trip(small_set: Path, tmp_path: Path):
    poses = posed(small_set)
    count = written(small_set, tmp_path / "tum")
    stream = tum.read(tmp_path / "tum")
    captures = capture.open_set(small_set)
    assert stream.camera == Pinhole.from_camera(captures.info)
    assert len(stream.moments) == count == len(poses)
    readings = [scene.frame(number) for scene in captures.scenes for number in scene.frames]
    for moment, frame, pose in zip(stream.moments, readings, poses, strict=True):
        assert moment.world_from_camera is not None and moment.image is not None
        np.testing.assert_allclose(moment.world_from_camera, pose, atol=1e-7)
        assert frame.depth_m is not None
        np.testing.assert_allclose(moment.depth(), frame.depth_m, atol=0.5 * tum.UNIT_M + 1e-6)
        np.testing.assert_array_equal(moment.image(), frame.ir_left)


def test_files_follow_the_benchmark_s_format(small_set: Path, tmp_path: Path):
    """Its scripts split lines at blanks, skip #, and divide depth by 5000."""
    posed(small_set)
    written(small_set, tmp_path)
    lines = (tmp_path / "depth.txt").read_text().splitlines()
    assert lines[0].startswith("#")
    time, file = lines[1].split()
    image = cv2.imread(str(tmp_path / file), cv2.IMREAD_UNCHANGED)
    depth_m = capture.open_set(small_set).scenes[0].frame(0).depth_m
    assert image.dtype == np.uint16 and depth_m is not None
    known = np.isfinite(depth_m)
    np.testing.assert_allclose(image[known] / 5000, depth_m[known], atol=1.1e-4)
    assert (image[~known] == 0).all()
    trajectory = np.loadtxt(tmp_path / "groundtruth.txt")
    assert trajectory.shape[1] == 8 and trajectory[0, 0] == float(time)
    np.testing.assert_allclose(np.linalg.norm(trajectory[:, 4:], axis=1), 1)


def test_pictures_and_poses_are_the_nearest_in_time(tmp_path: Path):
    (tmp_path / "depth.txt").write_text("# t f\n2.0 d2.png\n1.0 d1.png\n")
    (tmp_path / "rgb.txt").write_text("1.015 a.png\n2.5 b.png\n")
    (tmp_path / "groundtruth.txt").write_text("1.99 1 2 3 0 0 0 1\n5 0 0 0 0 0 0 1\n")
    camera = Pinhole(width=4, height=3, fx_px=5, fy_px=5, cx_px=2, cy_px=1)
    with pytest.warns(UserWarning, match="1 of 2 depth images have no picture at their time"):
        first, second = tum.read(tmp_path, camera).moments
    assert (first.time_s, second.time_s) == (1.0, 2.0)
    assert first.image is not None and second.image is None
    assert first.world_from_camera is None and second.world_from_camera is not None
    assert second.world_from_camera[:3, 3].tolist() == [1, 2, 3]
    with pytest.raises(InputError, match="rgb must be a readable image"):
        first.image()
    colour = np.zeros((3, 4, 3), np.uint8)
    colour[..., 2] = 200  # Red, as OpenCV writes it.
    cv2.imwrite(str(tmp_path / "a.png"), colour)
    assert first.image()[0, 0].tolist() == [200, 0, 0]
    deep = np.full((3, 4), 700, np.uint16)  # As infrared of 10 bits is.
    cv2.imwrite(str(tmp_path / "a.png"), deep)
    np.testing.assert_array_equal(first.image(), deep)
    (tmp_path / "rgb.txt").unlink()
    assert all(item.image is None for item in tum.read(tmp_path, camera).moments)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("depth.txt", None, r"depth\.txt must be readable"),
        ("depth.txt", "1.0\n", r"depth\.txt must have lines of a time and a file .*'1.0'"),
        ("depth.txt", "1.0 ../a.png\n", r"and a file in the folder; got '1.0 ../a.png' in line 1"),
        ("depth.txt", "# no image\n", r"depth\.txt must list depth images; got"),
        ("rgb.txt", "1.0 /etc/passwd\n", r"rgb\.txt must have lines of a time and a file in the"),
        ("depth.txt", "1e18 a.png\n", r"time in line 1 of depth\.txt must be in"),
        ("groundtruth.txt", "1 0 0 0 0 0 x 1\n", r"groundtruth\.txt must have lines TIME"),
        ("groundtruth.txt", "nan 0 0 0 0 0 0 1\n", r"time in line 1 of groundtruth\.txt must"),
        ("groundtruth.txt", "1 0 0 0 0 0 0 0\n", r"quaternions of length 1; got 0 0 0 0 in line 1"),
        ("groundtruth.txt", "1 0 0 0 0 0 0 5\n", r"quaternions of length 1; got 0 0 0 5 in line 1"),
        (
            "groundtruth.txt",
            "1 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n",
            r"must have one pose at a time; got two at 1\.0",
        ),
        ("depth.txt", "1 a.png\n1.0 b.png\n", r"depth\.txt must have one file at a time; got two"),
        ("camera.txt", "1 2 3", r"camera\.txt must be fx fy cx cy width height"),
        ("camera.txt", "80 80 79.5 47.5 160.9 96", r"camera\.txt must be fx fy cx cy width height"),
        ("camera.txt", None, r"camera\.txt must be readable; .* Give the camera"),
    ],
)
def test_damaged_files_are_refused(small_set: Path, tmp_path: Path, name, text, message):
    written(small_set, tmp_path / "tum")
    if text is None:
        (tmp_path / "tum" / name).unlink()
    else:
        (tmp_path / "tum" / name).write_text(text)
    with pytest.raises(InputError, match=message):
        tum.read(tmp_path / "tum")


def test_scenes_of_two_cameras_are_not_exported(small_set: Path, tmp_path: Path):
    scenes = capture.open_set(small_set).scenes
    (scenes[0].path / "0" / "depth.png").unlink()
    with pytest.raises(InputError, match="must have depth; got none"):
        tum.export(scenes, MemoryFolder(tmp_path))
    info = capture.capture_info.dumps(scenes[1].info).replace("fx_px = ", "fx_px = 1")
    (scenes[1].path / "camera.toml").write_text(info)
    with pytest.raises(InputError, match="scenes must be of one camera"):
        tum.export(capture.open_set(small_set).scenes[1:] + scenes[:1], MemoryFolder(tmp_path))


def test_depth_beyond_the_largest_code_is_reported(small_set: Path, tmp_path: Path):
    path = small_set / "a" / "0" / "depth.png"
    cv2.imwrite(str(path), np.full_like(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), 14_000))
    with pytest.warns(UserWarning, match=r"depth beyond 13\.11 m is exported as missing"):
        written(small_set, tmp_path / "tum")


def test_poses_of_several_rooms_are_reported(small_set: Path, tmp_path: Path):
    posed(small_set)
    (small_set / "b" / "room").write_text("cellar")
    with pytest.warns(UserWarning, match=r"poses of 2 rooms form one trajectory; is their origin"):
        written(small_set, tmp_path / "tum")
