"""A recording by librealsense itself, of its software device."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra ros is not installed")
pytest.importorskip("pyrealsense2", reason="pyrealsense2 is not installed")

import pyrealsense2 as rs

from starling.sim.captures import capture
from starling.sim.captures.recordings.import_recording import import_recording
from tests.unit.sim.recordings import scene

FRAMES = 4


def _stream(sensor: Any, kind: Any, index: int, form: Any, width: int) -> Any:
    lens = rs.intrinsics()
    lens.width, lens.height = scene.WIDTH, scene.HEIGHT
    lens.fx = lens.fy = scene.FX
    lens.ppx, lens.ppy = scene.CX, scene.CY
    lens.model, lens.coeffs = rs.distortion.brown_conrady, [0] * 5
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt = kind, index, index, form
    stream.width, stream.height, stream.fps, stream.bpp = scene.WIDTH, scene.HEIGHT, 30, width
    stream.intrinsics = lens
    return sensor.add_video_stream(stream)


def _record(folder: Path, unit_m: float) -> Path:
    """Record frames of a software device, as the viewer does."""
    device = rs.software_device()
    device.register_info(rs.camera_info.name, "Intel RealSense D435")
    sensor = device.add_sensor("Stereo Module")
    depth = _stream(sensor, rs.stream.depth, 0, rs.format.z16, 2)
    left = _stream(sensor, rs.stream.infrared, 1, rs.format.y8, 1)
    right = _stream(sensor, rs.stream.infrared, 2, rs.format.y8, 1)
    for first, second, shift in ((depth, left, 0.0), (left, right, -scene.BASELINE_M)):
        place = rs.extrinsics()
        place.rotation, place.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [shift, 0, 0]
        first.register_extrinsics_to(second, place)
    sensor.add_read_only_option(rs.option.depth_units, unit_m)
    sensor.add_read_only_option(rs.option.emitter_enabled, 1)
    for suffix in (".bag", ".db3"):  # The newer library refuses the older suffix.
        try:
            path = folder / f"desk{suffix}"
            recorder = rs.recorder(str(path), device)
            break
        except RuntimeError:
            continue
    recorded, queue, images = recorder.query_sensors()[0], rs.frame_queue(50), []
    recorded.open([depth, left, right])
    recorded.start(queue)
    for number in range(FRAMES):
        shown = (scene.depth_code(unit_m), *scene.pair(number))
        images += shown
        sensor.set_metadata(rs.frame_metadata_value.actual_exposure, 8500)
        for pixels, profile in zip(shown, (depth, left, right), strict=True):
            frame = rs.software_video_frame()
            frame.pixels, frame.bpp = pixels, pixels.itemsize
            frame.stride = scene.WIDTH * pixels.itemsize
            frame.timestamp, frame.domain = (
                1e5 + number * 100 / 3,
                rs.timestamp_domain.hardware_clock,
            )
            frame.frame_number, frame.profile = number, profile.as_video_stream_profile()
            if pixels.itemsize == 2:
                frame.depth_units = unit_m
            sensor.on_video_frame(frame)
        time.sleep(0.1)  # The recorder drops frames that come faster.
    recorded.stop()
    recorded.close()
    return path


@pytest.mark.parametrize("unit_m", [1e-3, 1e-4])
def test_a_recording_of_the_vendor_is_imported(unit_m: float, tmp_path: Path):
    path = _record(tmp_path, unit_m)
    report = import_recording(path, tmp_path / "set")
    captures = capture.open_set(tmp_path / "set")
    info, (only,) = captures.info, captures.scenes
    assert report["frames"] == FRAMES and (info.sensor, info.projector) == ("d435", "on")
    assert info.fx_px == scene.FX and info.depth_unit_m == unit_m
    assert info.baseline_m == pytest.approx(scene.BASELINE_M, abs=1e-6)
    for number in only.frames:
        frame = only.frame(number)
        np.testing.assert_array_equal(frame.ir_left, scene.pair(number)[0])
        np.testing.assert_array_equal(frame.ir_right, scene.pair(number)[1])
        assert frame.record["exposure_s"] == 0.0085
        assert frame.record["timestamp"] == pytest.approx(100 + number / 30, abs=1e-5)
