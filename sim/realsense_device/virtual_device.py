"""A device of librealsense whose frames are readings of a simulated camera."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Any

import numpy as np

from starling.patterns import errors
from starling.sim.realsense_device import streams
from starling.sim.realsense_device.device_images import DeviceImages, images_of
from starling.sim.realsense_device.library import rs
from starling.sim.sensor.sensor import Sensor

_MS, _US, _MW = 1e3, 1e6, 1e3
_UNITY_GAIN = 16  # Gain code of gain 1.
_POLL_S = 0.002  # Interval at which `play` asks whether the device streams.
_FASTEST = 300  # Most frames a second.
_VERSION = "0.0.0.0"  # A simulated camera has no firmware.


class VirtualDevice:
    """Serves readings as a software device of librealsense.

    In a `with` block a thread pushes the readings at their rate once the device streams, as a
    device does; a slow program loses frames. Otherwise `push` pushes one reading.

    Attributes:
        device: `pyrealsense2.software_device` with a stereo module, and a colour camera if the
            first item has a colour image.
        context: `pyrealsense2.context` that lists the device, for `pyrealsense2.pipeline(context)`.
    """

    def __init__(self, sensor: Sensor, readings: Iterable[object], fps: int) -> None:
        """Take the first reading, whose images decide the streams (see `starling.realsense`)."""
        self.sensor = sensor
        self.fps = errors.whole_number("fps", fps, 1, _FASTEST)
        advice = "Give a list or a generator."
        remaining = iter(errors.instance("readings", readings, Iterable, advice))
        first = next(remaining, None)
        if first is None:
            raise errors.refuse("readings", "must not be empty", "none", "Give one or more.")
        images = images_of(first, sensor)
        self._readings: Iterator[object] = itertools.chain([images], remaining)
        self._count = 0
        self.device = rs.software_device()
        _register_names(self.device, sensor)
        self._stereo = self.device.add_sensor("Stereo Module")
        self._colour: Any = None if images.colour is None else self.device.add_sensor("RGB Camera")
        self.profiles = streams.add_streams(self._stereo, self._colour, images, sensor, self.fps)
        self._add_options(images)
        # Depth, left and right are matched by their numbers, colour by its time.
        self.device.create_matcher(rs.matchers.dlr if images.colour is None else rs.matchers.dlr_c)
        self.context = rs.context()
        self._listed = _list_in(self.context, self.device)
        self._stop = threading.Event()
        self._failure: BaseException | None = None
        self._thread: threading.Thread | None = None

    def start(self, sink: Any) -> None:
        """Open all streams and send their frames to a syncer, a frame queue or a function."""
        for module, names in self._modules():
            module.open([self.profiles[name] for name in names])
            module.start(sink)

    def stop(self) -> None:
        """Stop and close what `start` opened."""
        for module, _ in self._modules():
            module.stop()
            module.close()

    def push(self) -> bool:
        """Push the frames of the next reading; return False if none is left.

        Frames are lost while the device does not stream.

        Raises:
            InputError: if the reading has other images than the first one.
        """
        reading = next(self._readings, None)
        if reading is None:
            return False
        images = images_of(reading, self.sensor)
        names = {name for name in ("ir_right", "colour") if getattr(images, name) is not None}
        if names != {name for name in ("ir_right", "colour") if name in self.profiles}:
            raise errors.refuse(
                "item of readings",
                "must have the images of the first item",
                ", ".join(sorted(names)) or "depth_u16 and ir_left alone",
                "Give colour with every item or with none.",
            )
        self._count += 1
        for name, profile in self.profiles.items():
            self._push(name, profile, images)
        return True

    def _modules(self) -> list[tuple[Any, list[str]]]:
        stereo = [name for name in self.profiles if name != "colour"]
        modules: list[tuple[Any, list[str]]] = [(self._stereo, stereo)]
        return modules + ([] if self._colour is None else [(self._colour, ["colour"])])

    def _push(self, name: str, profile: Any, images: DeviceImages) -> None:
        module = self._colour if name == "colour" else self._stereo
        image = np.ascontiguousarray(getattr(images, name))
        frame = rs.software_video_frame()
        frame.profile, frame.pixels = profile, image
        frame.stride, frame.bpp = image.strides[0], image.strides[1]
        frame.frame_number = self._count
        frame.timestamp = self._count * _MS / self.fps
        frame.domain = rs.timestamp_domain.hardware_clock
        if name == "depth_u16":
            frame.depth_units = self.sensor.post.depth_unit_m
        for key, value in self._metadata(images).items():
            module.set_metadata(key, round(value))
        module.on_video_frame(frame)

    def _metadata(self, images: DeviceImages) -> dict[Any, float]:
        value, time_us = rs.frame_metadata_value, self._count * _US / self.fps
        power_w = self.sensor.projector.power_w
        metadata = {
            value.frame_counter: self._count,
            value.frame_timestamp: time_us,
            value.sensor_timestamp: time_us,
            value.actual_fps: 1000 * self.fps,  # librealsense counts in thousandths.
            value.frame_laser_power: power_w * _MW,
            value.frame_laser_power_mode: float(power_w > 0),
            value.frame_emitter_mode: float(power_w > 0),
        }
        if images.exposure_s is not None:
            metadata[value.actual_exposure] = images.exposure_s * _US
        if images.gain is not None:
            metadata[value.gain_level] = images.gain * _UNITY_GAIN
        return metadata

    def _add_options(self, images: DeviceImages) -> None:
        power_w = self.sensor.projector.power_w
        options = {
            rs.option.depth_units: self.sensor.post.depth_unit_m,
            rs.option.stereo_baseline: self.sensor.baseline_m * _MS,  # [mm]
            rs.option.laser_power: power_w * _MW,
            rs.option.emitter_enabled: float(power_w > 0),
        }
        if images.exposure_s is not None:
            options[rs.option.exposure] = images.exposure_s * _US
        if images.gain is not None:
            options[rs.option.gain] = images.gain * _UNITY_GAIN
        for option, number in options.items():
            self._stereo.add_read_only_option(option, number)

    def __enter__(self) -> VirtualDevice:
        """Begin to push readings as soon as the device streams."""
        self._thread = threading.Thread(target=self._play, daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop pushing, and raise what the readings raised."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        if self._failure is not None:
            raise self._failure

    def _play(self) -> None:
        while not self._stop.is_set() and not self._streams():
            time.sleep(_POLL_S)
        due = time.monotonic()
        try:
            while not self._stop.is_set():
                due = max(due + 1 / self.fps, time.monotonic())
                self._stop.wait(due - time.monotonic())
                if not self.push():
                    return
        except BaseException as failure:  # Raised again by `__exit__`, in the caller's thread.
            self._failure = failure

    def _streams(self) -> bool:
        return any(module.get_active_streams() for module, _ in self._modules())


def _list_in(context: Any, device: Any) -> list[Any]:
    """Add a device to a context, which lists it only as long as the returned lists live."""
    listed: list[Any] = []
    context.set_devices_changed_callback(lambda event: listed.append(event.get_new_devices()))
    device.add_to(context)
    context.set_devices_changed_callback(lambda _: None)
    return listed


def _register_names(device: Any, sensor: Sensor) -> None:
    names = {
        rs.camera_info.name: f"Starling {sensor.name}",
        rs.camera_info.serial_number: f"{sensor.unit:012d}",
        rs.camera_info.product_line: "D400",
        rs.camera_info.firmware_version: _VERSION,
        rs.camera_info.recommended_firmware_version: _VERSION,
    }
    for key, text in names.items():
        device.register_info(key, text)
