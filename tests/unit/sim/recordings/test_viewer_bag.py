"""Bags of the RealSense Viewer, written as librealsense writes them."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros is not installed")

from rosbags import rosbag1

from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.captures.recordings.import_recording import FrameChoice, import_recording
from starling.sim.captures.recordings.statement import GivenFacts
from tests.unit.sim.recordings import scene, viewer_database
from tests.unit.sim.recordings.viewer import ViewerBag


def imported(bag: ViewerBag, folder: Path, **more: Any) -> tuple[dict[str, Any], Any]:
    """Write a bag and import it."""
    path = bag.write(folder / "desk.bag")
    report = import_recording(path, folder / "set", **more)
    return report, capture.open_set(folder / "set")


def test_images_and_facts_are_those_of_the_bag(tmp_path: Path):
    report, captures = imported(ViewerBag(), tmp_path)
    (only,) = captures.scenes
    assert (only.name, only.frames) == ("desk", (0, 1, 2))
    for number in only.frames:
        frame = only.frame(number)
        left, right = scene.pair(number)
        np.testing.assert_array_equal(frame.ir_left, left)
        np.testing.assert_array_equal(frame.ir_right, right)
        code = cv2.imread(str(only.path / str(number) / "depth.png"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(code, scene.depth_code())
        assert frame.record["exposure_s"] == 0.0085 and frame.record["gain"] == 16
        assert frame.record["laser_power"] == 150
        assert frame.record["timestamp"] == pytest.approx(100 + number / 30, abs=1e-3)
    info = captures.info
    assert (info.fx_px, info.cx_px, info.cy_px) == (scene.FX, scene.CX, scene.CY)
    assert (info.baseline_m, info.depth_unit_m) == (scene.BASELINE_M, 1e-3)
    assert (info.sensor, info.projector) == ("d435i", "on")
    assert report["seen"]["dots"] == "yes" and report["seen"]["row_spread_px"] < 0.05
    assert report["seen"]["depth_ratio"] == pytest.approx(1, abs=0.01)
    assert report["clock"] == {"rate_hz": pytest.approx(30, rel=0.01), "dropped": 0, "jumps": 0}


@pytest.mark.parametrize("name", ["LZ4", "BZ2"])
def test_compressed_bags_are_read(name: str, tmp_path: Path):
    compression = rosbag1.Writer.CompressionFormat[name]
    _, captures = imported(ViewerBag(compression=compression), tmp_path)
    np.testing.assert_array_equal(captures.scenes[0].frame(1).ir_left, scene.pair(1)[0])


def test_depth_unit_is_that_of_the_images_or_the_option(tmp_path: Path):
    """A D405 counts tenths of a millimetre."""
    for number, units in enumerate(({"unit_m": 1e-4}, {"unit_m": None, "unit_option_m": 1e-4})):
        folder = tmp_path / str(number)
        folder.mkdir()
        _, captures = imported(ViewerBag(depth_unit_of_codes_m=1e-4, **units), folder)
        assert captures.info.depth_unit_m == 1e-4
        depth_m = captures.scenes[0].frame(0).depth_m
        assert np.nanmedian(depth_m) == pytest.approx(scene.DEPTH_M, rel=1e-3)


def test_an_unknown_depth_unit_is_refused(tmp_path: Path):
    bag = ViewerBag(unit_m=None)
    with pytest.raises(InputError, match=r"unit of the depth values must be given; .*--depth-unit"):
        imported(bag, tmp_path)
    with pytest.raises(
        InputError, match=r"--depth-unit must be m, mm or a step in metres; got 'inch'"
    ):
        imported(bag, tmp_path, flags=GivenFacts(depth_unit="inch"))
    imported(bag, tmp_path, flags=GivenFacts(depth_unit="mm"))


def test_depth_in_a_wrong_unit_is_refused_by_the_disparity(tmp_path: Path):
    with pytest.raises(InputError, match=r"depth must agree with .* over disparity; got 10 times"):
        imported(ViewerBag(unit_m=1e-3, depth_unit_of_codes_m=1e-4), tmp_path)


def test_baseline_is_that_of_the_poses_or_the_option(tmp_path: Path):
    bag = ViewerBag(baseline_m=None, baseline_option_mm=50.0)
    _, captures = imported(bag, tmp_path)
    assert captures.info.baseline_m == 0.05


def test_an_unknown_baseline_is_refused_with_the_usual_one(tmp_path: Path):
    message = r"baseline must be given; .*--baseline METRES, 0\.0499 as in d435i"
    message = message.replace(r"0\.0499", r"0\.05\d*")
    with pytest.raises(InputError, match=message):
        imported(ViewerBag(baseline_m=None), tmp_path)


def test_infrared_and_intrinsics_must_be_in_the_bag(tmp_path: Path):
    with pytest.raises(InputError, match=r"desk\.bag must have infrared images, Infrared_1"):
        imported(ViewerBag(streams=("Depth_0",)), tmp_path)
    with pytest.raises(InputError, match=r"intrinsics must be given; got none in .*--calibration"):
        imported(ViewerBag(with_info=False), tmp_path)


def test_an_unknown_emitter_is_asked_for(tmp_path: Path):
    bag = ViewerBag(emitter_option=None)
    with pytest.raises(InputError, match=r"emitter must be given.*got dots in the images.*--emit"):
        imported(bag, tmp_path)
    _, captures = imported(bag, tmp_path, flags=GivenFacts(emitter="on"))
    assert captures.info.projector == "on"


def test_an_unknown_camera_is_asked_for(tmp_path: Path):
    with pytest.raises(InputError, match=r"sensor must be given.*--sensor NAME"):
        imported(ViewerBag(name=None), tmp_path)


def test_a_contradicted_emitter_is_warned_of(tmp_path: Path):
    with pytest.warns(UserWarning, match="the emitter is off, but the images show dots"):
        imported(ViewerBag(emitter_option=0), tmp_path)
    with pytest.warns(UserWarning, match="the emitter is on, but the images show no dots"):
        imported(
            ViewerBag(dots=(0.0,) * 3, streams=("Infrared_1", "Infrared_2")), tmp_path, force=True
        )


def test_unlit_frames_become_images_with_the_projector_off(tmp_path: Path):
    times = tuple(100 + n / 30 for n in range(5))
    bag = ViewerBag(
        times_s=times, laser_modes=(1, 0, 1, 0, 0), dots=(0.008, 0.0001, 0.008, 0.0001, 0.0001)
    )
    report, captures = imported(bag, tmp_path)
    only = captures.scenes[0]
    assert only.frames == (0, 1) and captures.info.projector == "on and off"
    np.testing.assert_array_equal(only.frame(0).ir_left_off, scene.pair(1, dots=0.0001)[0])
    np.testing.assert_array_equal(only.frame(1).ir_right_off, scene.pair(3, dots=0.0001)[1])
    assert report["left_out"]["emitter_off"] == 1
    report, captures = imported(bag, tmp_path, choice=FrameChoice(moving=True), force=True)
    assert len(captures.scenes) == 2 and report["left_out"]["emitter_off"] == 3


def test_a_truncated_bag_gives_what_is_whole(tmp_path: Path):
    path = ViewerBag(times_s=tuple(100 + n / 30 for n in range(8))).write(tmp_path / "desk.bag")
    whole = path.read_bytes()
    for share in (0.55, 0.8):
        path.write_bytes(whole[: int(len(whole) * share)])
        with pytest.warns(UserWarning, match=r"it breaks off after \d+ messages; what is whole"):
            report = import_recording(path, tmp_path / "set", force=True)
        assert 2 <= report["frames"] < 8 and "breaks off" in report["damage"]
        frame = capture.open_set(tmp_path / "set").scenes[0].frame(1)
        np.testing.assert_array_equal(frame.ir_left, scene.pair(1)[0])
    path.write_bytes(whole[:400])
    with pytest.raises(InputError, match="source must hold messages"):
        import_recording(path, tmp_path / "set", force=True)
    path.write_bytes(b"no bag at all")
    with pytest.raises(InputError, match=r"source must be a ROS 1 bag of version 2\.0"):
        import_recording(path, tmp_path / "set", force=True)


def test_jumps_of_the_clock_and_dropped_frames_are_counted(tmp_path: Path):
    times = (100.0, 100.0333, 100.1333, 5000.0, 5000.0333, 4999.9)
    report, captures = imported(ViewerBag(times_s=times), tmp_path)
    assert report["clock"]["jumps"] == 2 and report["clock"]["dropped"] == 2
    np.testing.assert_array_equal(captures.scenes[0].frame(3).ir_left, scene.pair(3)[0])


def test_streams_with_other_clocks_are_refused(tmp_path: Path):
    bag = ViewerBag(times_of={"Infrared_2": (7.0, 7.0333, 7.0667)})
    with pytest.raises(InputError, match=r"right images must have the times of the left images"):
        imported(bag, tmp_path)


def test_left_images_without_a_right_one_are_left_out(tmp_path: Path):
    bag = ViewerBag(times_of={"Infrared_2": (100.0, 100.0333)})
    report, _ = imported(bag, tmp_path)
    assert report["frames"] == 2 and report["left_out"]["unpaired"] == 1


def test_images_of_unequal_sizes_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match=r"right of frame 0 must be 320x240 .*; got 300x200"):
        imported(ViewerBag(right_shape=(200, 300)), tmp_path)


def test_colour_has_its_camera_and_pose(tmp_path: Path):
    streams = ("Infrared_1", "Infrared_2", "Depth_0", "Color_0")
    _, captures = imported(ViewerBag(streams=streams), tmp_path)
    left, _ = scene.pair(2)
    np.testing.assert_array_equal(captures.scenes[0].colour(2), np.dstack([left, left // 2, left]))
    assert captures.info.colour.fx_px == scene.FX
    assert np.array(captures.info.colour_from_left)[0, 3] == pytest.approx(0.015)


def test_a_moving_camera_is_noticed(tmp_path: Path):
    bag = ViewerBag(moves=True)
    with pytest.warns(UserWarning, match=r"first and last frame differ.*give --moving"):
        imported(bag, tmp_path)
    moving = FrameChoice(moving=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _, captures = imported(bag, tmp_path, choice=moving, force=True)
    assert [each.room for each in captures.scenes] == ["desk"] * 3
    few = FrameChoice(moving=True, every=2, most=1)
    report, _ = imported(bag, tmp_path, choice=few, force=True)
    assert report["frames"] == 1


def test_databases_of_newer_viewers_are_read(tmp_path: Path):
    path = viewer_database.write(tmp_path / "desk.db3", unit_m=1e-4)
    report = import_recording(path, tmp_path / "set")
    captures = capture.open_set(tmp_path / "set")
    info, (only,) = captures.info, captures.scenes
    assert (info.sensor, info.baseline_m, info.depth_unit_m) == ("d405", 0.05, 1e-4)
    assert (info.fx_px, info.cx_px, info.projector) == (scene.FX, scene.CX, "on")
    assert only.record(2)["timestamp"] == pytest.approx(100.066666)
    assert only.record(2)["exposure_s"] == 0.0085 and report["frames"] == 3
    np.testing.assert_array_equal(only.frame(2).ir_right, scene.pair(2)[1])


def test_damaged_texts_of_a_database_count_as_absent(tmp_path: Path):
    info = viewer_database.INFO.replace("fx=", "f=")
    path = viewer_database.write(tmp_path / "desk.db3", info=info, pose="rotation=1,0")
    with pytest.raises(InputError, match="intrinsics must be given"):
        import_recording(path, tmp_path / "set")
    path = viewer_database.write(tmp_path / "other.db3", pose="rotation=1,0")
    with pytest.raises(InputError, match="baseline must be given"):
        import_recording(path, tmp_path / "set")
