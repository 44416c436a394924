"""Readings through librealsense: streams, geometry, metadata, and what a program does with them."""

from __future__ import annotations

import dataclasses
import importlib
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import starling
from starling.patterns import InputError
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import from_code
from starling.sim.stereo.registration import register

rs: Any = pytest.importorskip("pyrealsense2", exc_type=ImportError)

from starling.realsense import DeviceImages, virtual_device  # noqa: E402

SENSOR = starling.load_sensor("d435", mode="424x240")
SIZE = (SENSOR.height, SENSOR.width)
WAIT_MS = 20_000


def images(number: int = 0, **changes: Any) -> DeviceImages:
    """A slope behind a box, with a hole."""
    rng = np.random.default_rng(number)
    depth = np.broadcast_to(np.linspace(900, 1500, SIZE[1]), SIZE).astype(np.uint16)
    depth[60:140, 100:200] = 600 + number
    depth[:, :20] = 0
    left, right = rng.integers(0, 255, (2, *SIZE), np.uint8)
    fields: dict[str, Any] = {"depth_u16": depth, "ir_left": left, "ir_right": right}
    return DeviceImages(**{**fields, "exposure_s": 0.0085, "gain": 1.5, **changes})


def colour_image(sensor: Sensor = SENSOR) -> np.ndarray:
    assert sensor.colour is not None
    size = (sensor.colour.height, sensor.colour.width, 3)
    return np.random.default_rng(7).integers(0, 255, size, np.uint8)


def pixels(frame: Any) -> np.ndarray:
    return np.asanyarray(frame.get_data()).copy()


def synced(device: Any, *, streams: int) -> Any:
    """Push until a frame of each stream came."""
    syncer = rs.syncer()
    device.start(syncer)
    for _ in range(3):
        assert device.push()
        frames = syncer.wait_for_frames(WAIT_MS)
        if frames.size() == streams:
            break
    device.stop()
    assert frames.size() == streams
    return frames


def test_a_program_with_a_pipeline_runs() -> None:
    """The program names streams, and asks for the depth scale and a distance."""
    first = images()
    with virtual_device(SENSOR, [images(i) for i in range(30)], fps=30) as device:
        pipeline, config = rs.pipeline(device.context), rs.config()
        config.enable_stream(rs.stream.depth, SIZE[1], SIZE[0], rs.format.z16, 30)
        config.enable_stream(rs.stream.infrared, 2, SIZE[1], SIZE[0], rs.format.y8, 30)
        profile = pipeline.start(config)
        frames = pipeline.wait_for_frames(WAIT_MS)
        number = frames.get_frame_number()
        pipeline.stop()
    assert profile.get_device().get_info(rs.camera_info.name) == "Starling d435"
    assert profile.get_device().first_depth_sensor().get_depth_scale() == pytest.approx(1e-3)
    depth = frames.get_depth_frame()
    assert depth.get_distance(30, 10) == pytest.approx(first.depth_u16[10, 30] * 1e-3)
    assert depth.get_distance(5, 5) == 0.0
    assert depth.get_distance(150, 100) == pytest.approx(0.6 + (number - 1) * 1e-3)


def test_every_image_arrives_unchanged() -> None:
    served = images(colour=colour_image())
    frames = synced(virtual_device(SENSOR, [served] * 3), streams=4)
    np.testing.assert_array_equal(pixels(frames.get_depth_frame()), served.depth_u16)
    np.testing.assert_array_equal(pixels(frames.get_infrared_frame(1)), served.ir_left)
    np.testing.assert_array_equal(pixels(frames.get_infrared_frame(2)), served.ir_right)
    np.testing.assert_array_equal(pixels(frames.get_color_frame()), served.colour)


def test_streams_have_the_cameras_geometry() -> None:
    device = virtual_device(SENSOR, [images(colour=colour_image())])
    depth, left, right, colour = (
        device.profiles[name] for name in ("depth_u16", "ir_left", "ir_right", "colour")
    )
    for profile, camera in ((depth, SENSOR), (left, SENSOR), (right, SENSOR)):
        seen = profile.get_intrinsics()
        expected = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
        assert (seen.fx, seen.fy, seen.ppx, seen.ppy) == pytest.approx(expected, rel=1e-6)
    assert SENSOR.colour is not None
    assert colour.get_intrinsics().ppx == pytest.approx(SENSOR.colour.cx_px, rel=1e-6)
    moved = left.get_extrinsics_to(right).translation
    assert moved == pytest.approx([-SENSOR.baseline_m, 0, 0], abs=1e-7)
    expected = [-value for value in SENSOR.colour.position_m]
    assert depth.get_extrinsics_to(colour).translation == pytest.approx(expected, abs=1e-7)


def test_extrinsics_turn_points_as_the_sensors_do() -> None:
    assert SENSOR.colour is not None
    turned = dataclasses.replace(SENSOR.colour, rotation_deg=(0.0, 90.0, 0.0))
    sensor = dataclasses.replace(SENSOR, colour=turned)
    device = virtual_device(sensor, [images(colour=colour_image(sensor))])
    motion = device.profiles["depth_u16"].get_extrinsics_to(device.profiles["colour"])
    # The colour camera looks along x of the left imager.
    x, y, z = turned.position_m
    point = rs.rs2_transform_point_to_point(motion, [x + 2.0, y, z])
    assert point == pytest.approx([0.0, 0.0, 2.0], abs=1e-6)


def test_frames_tell_their_time_number_exposure_and_power() -> None:
    device, queue = virtual_device(SENSOR, [images(), images(1)], fps=50), rs.frame_queue(16)
    device.start(queue)
    assert device.push() and device.push() and not device.push()
    frames = [queue.wait_for_frame(WAIT_MS) for _ in range(6)]
    device.stop()
    depth = [frame for frame in frames if frame.get_profile().stream_type() == rs.stream.depth]
    value = rs.frame_metadata_value
    assert [frame.get_frame_number() for frame in depth] == [1, 2]
    assert [frame.get_timestamp() for frame in depth] == pytest.approx([20.0, 40.0])
    expected = {
        value.actual_exposure: 8500,
        value.gain_level: 24,
        value.frame_laser_power: round(1e3 * SENSOR.projector.power_w),
        value.frame_emitter_mode: 1,
        value.frame_counter: 2,
        value.sensor_timestamp: 40_000,
        value.actual_fps: 50_000,
    }
    assert {key: depth[1].get_frame_metadata(key) for key in expected} == expected
    module = device.device.first_depth_sensor()
    assert module.get_option(rs.option.exposure) == 8500
    assert module.get_option(rs.option.stereo_baseline) == pytest.approx(50.15)
    with pytest.raises(RuntimeError):
        module.set_option(rs.option.laser_power, 30.0)


def test_simulated_readings_and_shots_are_served() -> None:
    clean = np.full(SIZE, 0.8, np.float32)
    matrix = np.array([[SENSOR.fx_px, 0, SENSOR.cx_px], [0, SENSOR.fy_px, SENSOR.cy_px], [0, 0, 1]])
    reading = starling.corrupt(clean, matrix, SENSOR)
    shot = starling.simulate(starling.load_scene("wall:1", SENSOR), SENSOR, quality="draft")
    device, queue = virtual_device(SENSOR, iter([reading, shot])), rs.frame_queue(16)
    device.start(queue)
    while device.push():
        pass
    frames = [queue.wait_for_frame(WAIT_MS) for _ in range(6)]
    device.stop()
    first, second = (pixels(frame) for frame in (frames[0], frames[3]))
    np.testing.assert_array_equal(first, reading.depth_u16)
    np.testing.assert_allclose(
        from_code(second, 1e-3), shot.depth.depth_m, atol=5.1e-4, equal_nan=True
    )
    assert frames[0].get_frame_metadata(rs.frame_metadata_value.actual_exposure) == round(
        reading.exposure_s * 1e6
    )


def test_points_lie_where_the_depth_says() -> None:
    frames = synced(virtual_device(SENSOR, [images()] * 3), streams=3)
    points = rs.pointcloud().calculate(frames.get_depth_frame())
    vertices = np.asanyarray(points.get_vertices()).view(np.float32).reshape(*SIZE, 3)
    z = images().depth_u16.astype(np.float64) * 1e-3
    x = (np.arange(SIZE[1]) - SENSOR.cx_px) / SENSOR.fx_px * z
    np.testing.assert_allclose(vertices[..., 2], z, rtol=1e-6)
    np.testing.assert_allclose(vertices[..., 0], x, atol=1e-5)


@pytest.mark.skipif(not hasattr(rs, "__version__"), reason="rs.align differs before version 2.58")
def test_align_covers_the_pixels_of_our_registration() -> None:
    """librealsense keeps z of the depth camera; ours is z of the colour camera, 0.2 mm away."""
    served = images(colour=colour_image())
    frames = synced(virtual_device(SENSOR, [served] * 3), streams=4)
    aligned = pixels(rs.align(rs.stream.color).process(frames).get_depth_frame())
    ours = register(from_code(served.depth_u16, 1e-3), SENSOR)
    seen = np.isfinite(ours)
    assert np.mean(seen == (aligned > 0)) >= 0.9999
    both = seen & (aligned > 0)
    assert np.mean(np.abs(ours[both] - aligned[both] * 1e-3) < 1e-3) >= 0.9999


def test_a_sensor_of_structured_light_has_one_infrared_stream() -> None:
    sensor = starling.load_sensor("kinect-v1")
    size = (sensor.height, sensor.width)
    served = DeviceImages(depth_u16=np.ones(size, np.uint16), ir_left=np.ones(size, np.uint16))
    device = virtual_device(sensor, [served])
    assert set(device.profiles) == {"depth_u16", "ir_left"}
    assert device.profiles["ir_left"].format() == rs.format.y16


def test_failure_of_the_readings_reaches_the_program() -> None:
    def readings() -> Iterator[DeviceImages]:
        yield images()
        raise ValueError("no more light")

    with pytest.raises(ValueError, match="no more light"), virtual_device(SENSOR, readings()) as it:
        pipeline = rs.pipeline(it.context)
        pipeline.start()
        pipeline.wait_for_frames(WAIT_MS)
        it._thread.join()
        pipeline.stop()


def test_a_device_that_nothing_starts_ends_with_its_block() -> None:
    with virtual_device(SENSOR, [images()]) as device:
        assert device.context.query_devices().size() == 1
    assert device.push()


@pytest.mark.parametrize(
    ("readings", "message"),
    [
        ([], "readings must not be empty; got none. Give one or more."),
        ([np.zeros(SIZE)], "item of readings must be of type DeviceImages; got array"),
        (
            [images(depth_u16=np.zeros(SIZE, np.float32))],
            "depth_u16 must be (240, 424) uint16; got (240, 424) float32. Give a reading of this",
        ),
        ([images(ir_right=np.zeros((3, 4), np.uint8))], "ir_right must be (240, 424) uint8; got"),
        ([images(colour=np.zeros(SIZE, np.uint8))], "colour must be (720, 1280, 3) uint8; got"),
    ],
)
def test_images_of_another_camera_are_refused(readings: list[Any], message: str) -> None:
    with pytest.raises(InputError) as refusal:
        virtual_device(SENSOR, readings)
    assert str(refusal.value).startswith(message)


def test_streams_that_come_and_go_are_refused() -> None:
    device = virtual_device(SENSOR, [images(), images(ir_right=None)])
    assert device.push()
    with pytest.raises(InputError, match="item of readings must have the images of the first item"):
        device.push()


def test_colour_without_a_camera_and_rates_are_refused() -> None:
    blind = dataclasses.replace(SENSOR, colour=None)
    with pytest.raises(InputError, match=r"colour needs a colour camera; got none in d435\. Add"):
        virtual_device(blind, [images(colour=np.zeros((*SIZE, 3), np.uint8))])
    with pytest.raises(InputError, match=r"fps must be an integer in \[1, 300\]; got 0"):
        virtual_device(SENSOR, [images()], fps=0)


def test_missing_packages_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    message = r"starling\.realsense needs pyrealsense2; got none\. .*'\.\[realsense\]'"
    with pytest.raises(InputError, match=message):
        imported_without(ModuleNotFoundError("pyrealsense2"), monkeypatch)
    message = r"pyrealsense2 must load; got libusb-1\.0\.so\.0: .*apt-get install libusb"
    with pytest.raises(InputError, match=message):
        imported_without(ImportError("libusb-1.0.so.0: no such file"), monkeypatch)


def imported_without(failure: ImportError, monkeypatch: pytest.MonkeyPatch) -> None:
    """Import the package while `pyrealsense2` fails to load."""

    class Refusing:
        def find_spec(self, name: str, *_: Any) -> None:
            if name == "pyrealsense2":
                raise failure

    for name in [name for name in sys.modules if name.startswith("starling.sim.realsense_device")]:
        monkeypatch.delitem(sys.modules, name)
    for name in ("pyrealsense2", "starling.realsense"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setattr(sys, "meta_path", [Refusing(), *sys.meta_path])
    importlib.import_module("starling.realsense")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"exposure_s": float("nan")}, r"exposure_s must be in \[0, 10\]; got nan"),
        ({"exposure_s": "x"}, r"exposure_s must be in \[0, 10\]; got 'x'"),
        ({"gain": float("inf")}, r"gain must be in \[0, 100000\]; got inf"),
        ({"gain": -1.0}, r"gain must be in \[0, 100000\]; got -1"),
    ],
)
def test_impossible_exposures_and_gains_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        virtual_device(SENSOR, [images(**changes)])


def test_readings_that_cannot_be_taken_one_by_one_are_refused() -> None:
    with pytest.raises(InputError, match=r"readings must be of type Iterable; got None\. Give a"):
        virtual_device(SENSOR, None)  # pyright: ignore[reportArgumentType]
