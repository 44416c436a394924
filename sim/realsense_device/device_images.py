"""What a RealSense delivers at one time: images, exposure and gain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import quantities
from starling.sim.reading import Reading
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot

_ADVICE = "Give a reading of this sensor, a shot or DeviceImages."


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DeviceImages:
    """Images of one time, (h, w) of the sensor's size."""

    depth_u16: NDArray[np.uint16]  # Depth in units of `post.depth_unit_m`; 0 where missing.
    ir_left: NDArray[Any]  # uint8 or uint16.
    ir_right: NDArray[Any] | None = None  # None: structured light.
    colour: NDArray[np.uint8] | None = None  # RGB (h, w, 3) of the sensor's colour camera.
    exposure_s: float | None = None
    gain: float | None = None

    def check(self, sensor: Sensor) -> None:
        """Refuse images that are not the sensor's.

        Raises:
            InputError: if an image has another size or type, its camera does not exist, or
                exposure or gain is impossible.
        """
        size = (sensor.height, sensor.width)
        _check("depth_u16", self.depth_u16, size, ("uint16",))
        _check("ir_left", self.ir_left, size, ("uint8", "uint16"))
        if self.ir_right is not None:
            _check("ir_right", self.ir_right, size, (str(self.ir_left.dtype),))
        if self.colour is not None:
            camera = sensor.colour
            if camera is None:
                advice = "Add a [colour] table to the sensor."
                raise errors.refuse(
                    "colour", "needs a colour camera", f"none in {sensor.name}", advice
                )
            _check("colour", self.colour, (camera.height, camera.width, 3), ("uint8",))
        for name in ("exposure_s", "gain"):
            if getattr(self, name) is not None:
                quantities.check(name, getattr(self, name), name)


def images_of(reading: object, sensor: Sensor) -> DeviceImages:
    """Return the images of a reading, a shot or `DeviceImages`.

    Raises:
        InputError: if `reading` is none of them, or as `DeviceImages.check`.
    """
    if isinstance(reading, Shot):
        reading = Reading.from_shot(reading, reading.depth, sensor)
    if isinstance(reading, Reading):
        reading = DeviceImages(
            depth_u16=reading.depth_u16,
            ir_left=reading.ir_left,
            ir_right=reading.ir_right,
            exposure_s=reading.exposure_s,
            gain=reading.gain,
        )
    images = errors.instance("item of readings", reading, DeviceImages, _ADVICE)
    images.check(sensor)
    return images


def _check(name: str, image: object, shape: tuple[int, ...], kinds: tuple[str, ...]) -> None:
    array = errors.instance(name, image, np.ndarray, _ADVICE)
    if array.shape != shape or str(array.dtype) not in kinds:
        rule = f"must be {shape} {' or '.join(kinds)}"
        raise errors.refuse(name, rule, f"{array.shape} {array.dtype}", _ADVICE)
