"""LabelFusion's layout: logs are read as by its own program; other files are refused."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.captures.exchange import labelfusion
from starling.sim.captures.exchange.stream import NEAR_S, nearest
from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole

UTIMES = (1496765000033333, 1496765000066666, 1496765000100000)
CODES = np.array([[0, 1000, 2500], [65535, 1, 700]], np.uint16)
RED = np.zeros((2, 3, 3), np.uint8) + np.array([200, 10, 0], np.uint8)


def pose(number: int) -> frames.Pose:
    return frames.pose((0.1 * number, -0.2, 0.3), (3.0, 5.0 * number, -1.0))


def row(number: int) -> str:
    """Format a pose as ElasticFusion does: seconds to six digits, quaternion x y z w."""
    matrix = pose(number)
    numbers = (*matrix[:3, 3], *frames.to_quaternion(matrix))
    return f"{UTIMES[number] / 1e6:.6f} " + " ".join(f"{value:.9g}" for value in numbers)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    images = tmp_path / "log" / "images"
    images.mkdir(parents=True)
    for number, utime in enumerate(UTIMES):
        stem = images / f"{number + 1:010d}"
        cv2.imwrite(f"{stem}_depth.png", CODES + np.uint16(number))
        cv2.imwrite(f"{stem}_rgb.png", RED[..., ::-1])
        Path(f"{stem}_utime.txt").write_text(str(utime))
    (images / "0000000001_labels.png").touch()
    rows = [row(number) for number in range(2)]  # Tracking ended before the log.
    (images.parent / "posegraph.posegraph").write_text("\n".join(rows) + "\n")
    (images.parent / "camera.cfg").write_text("528 527 320 240\n")
    return images.parent


def test_depth_is_in_millimetres_and_zero_is_none(log: Path):
    stream = labelfusion.read(log)
    assert len(stream.moments) == 3
    depth_m = stream.moments[0].depth()
    np.testing.assert_allclose(depth_m, [[np.nan, 1.0, 2.5], [65.535, 0.001, 0.7]], rtol=1e-6)
    image = stream.moments[0].image
    assert image is not None
    np.testing.assert_array_equal(image(), RED)


def test_poses_are_matched_by_microseconds(log: Path):
    """Times in the trajectory are seconds; a moment after its end has no pose."""
    moments = labelfusion.read(log).moments
    assert [moment.time_s for moment in moments] == [utime / 1e6 for utime in UTIMES]
    for number in range(2):
        result = moments[number].world_from_camera
        assert result is not None
        np.testing.assert_allclose(result, pose(number), atol=1e-8)
    assert moments[2].world_from_camera is None


def test_smoothed_trajectory_is_preferred(log: Path):
    (log / "posegraph_smoothed.posegraph").write_text(f"{UTIMES[0] / 1e6:.18e} 1 2 3 0 0 0 1\n")
    result = labelfusion.read(log).moments[0].world_from_camera
    assert result is not None
    np.testing.assert_array_equal(result[:3, 3], [1, 2, 3])


def test_camera_comes_from_the_log_or_the_argument(log: Path):
    logged = Pinhole(width=3, height=2, fx_px=528, fy_px=527, cx_px=320, cy_px=240)
    assert labelfusion.read(log).camera == logged
    (log / "camera.cfg").unlink()
    second = Pinhole(width=3, height=2, fx_px=3, fy_px=3, cx_px=1, cy_px=1)
    assert labelfusion.read(log, second).camera == second
    with pytest.raises(InputError, match=r"camera\.cfg must hold fx fy cx cy; got .*528 528"):
        labelfusion.read(log)


def test_a_log_without_pictures_is_read(log: Path):
    for path in log.glob("images/*_rgb.png"):
        path.unlink()
    assert all(moment.image is None for moment in labelfusion.read(log).moments)


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("images/0000000002_utime.txt", "yesterday", "must hold microseconds; got 'yesterday'"),
        ("images/0000000002_utime.txt", None, "0000000002_utime.txt must be readable"),
        ("posegraph.posegraph", None, "log must hold posegraph.posegraph"),
        ("posegraph.posegraph", "1 2 3", "must have lines TIME tx ty tz qx qy qz qw; got '1 2 3'"),
        ("posegraph.posegraph", "1 2 3 4 0 0 0 0", "must have quaternions of length 1"),
        ("posegraph.posegraph", "nan 2 3 4 0 0 0 1", "time in line 1 of posegraph.posegraph must"),
        ("posegraph.posegraph", "a b c d e f g h", "must have lines TIME"),
        ("camera.cfg", "528 528", "camera.cfg must hold fx fy cx cy; got 528 528"),
        ("camera.cfg", None, "camera.cfg must hold fx fy cx cy; got no file"),
        ("images/0000000002_utime.txt", "9" * 18, "time in 0000000002_utime.txt must be in"),
    ],
)
def test_damaged_files_are_refused(log: Path, file: str, content: str | None, message: str):
    if content is None:
        (log / file).unlink()
    else:
        (log / file).write_text(content)
    with pytest.raises(InputError, match=message):
        labelfusion.read(log)


def test_two_images_of_one_time_are_refused(log: Path):
    images = sorted((log / "images").glob("*_utime.txt"))
    images[1].write_text(images[0].read_text())
    with pytest.raises(InputError, match="images must have one file at a time; got two at"):
        labelfusion.read(log)


def test_a_pose_that_is_not_finite_costs_its_frame_only(log: Path):
    rows = [f"{utime / 1e6:.18e} 1 2 {z} 0 0 0 1" for utime, z in zip(UTIMES, "3n4", strict=True)]
    (log / "posegraph.posegraph").write_text("\n".join(rows).replace("n", "nan"))
    with pytest.warns(UserWarning, match="1 poses are not finite; these frames have none"):
        moments = labelfusion.read(log).moments
    assert [moment.world_from_camera is None for moment in moments] == [False, True, False]


def test_invalid_images_are_refused_when_read(log: Path):
    moment = labelfusion.read(log).moments[0]
    cv2.imwrite(str(log / "images" / "0000000001_depth.png"), CODES.astype(np.uint8))
    with pytest.raises(InputError, match="depth must be of 16 bits"):
        moment.depth()
    (log / "images" / "0000000001_rgb.png").write_bytes(b"no picture")
    assert moment.image is not None
    with pytest.raises(InputError, match="rgb must be a readable image"):
        moment.image()


def test_a_folder_without_depths_is_refused(log: Path, tmp_path: Path):
    with pytest.raises(InputError, match=r"log must hold images/NUMBER_depth\.png"):
        labelfusion.read(tmp_path)
    for path in log.glob("images/*_depth.png"):
        path.unlink()
    with pytest.raises(InputError, match=r"log must hold images/NUMBER_depth\.png"):
        labelfusion.read(log)


def test_nearest_item_in_time_is_returned():
    timed = [(0.0, "a"), (1.0, "b"), (1.01, "c")]
    assert [nearest(timed, position) for position in (-0.01, 0.99, 1.009, 1.5)] == [
        "a",
        "b",
        "c",
        None,
    ]
    assert nearest(timed, 1.01 + 0.99 * NEAR_S) == "c"
    assert nearest([], 0.0) is None
