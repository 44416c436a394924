"""Surfaces of many environments and the light on them, as arrays of the user."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from starling.patterns import errors
from starling.sim.batch import handoff, light
from starling.sim.batch.handoff import launch
from starling.sim.scene.scene import Ambient
from starling.sim.sensor.sensor import Sensor
from starling.sim.warp import daylight, depth_input

wp: Any = handoff.import_warp()


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class BatchScene:
    """Surfaces of n environments; compare `starling.sim.warp.layers.DepthScene`."""

    depth: Any  # (n, h, w) z [m]
    reflectance: Any  # A number, or (n, h, w).
    irradiance: Any  # (n,) of the sky [W m^-2]
    gradient: float  # Of the sky.
    up: Any  # (n, 3) zenith, of any length.
    right_depth: Any = None  # (n, h, w) z [m] seen from the right imager; None: warped.
    projector_depth: Any = None  # Same, from the projector.

    def slice(self, part: slice) -> BatchScene:
        """Return some of the environments."""
        images = {
            name: array[part]
            for name in self.__slots__
            if isinstance(array := getattr(self, name), wp.array)
        }
        return replace(self, **images)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SceneArrays:
    """Arguments of `Corruptor.batch` without the depth, unchecked."""

    reflectance: Any = None
    ambient_lux: Any = None
    up: Any = None
    right_depth_m: Any = None
    projector_depth_m: Any = None


def build(clean: Any, inputs: SceneArrays, ambient: Ambient, sensor: Sensor) -> BatchScene:
    """Check arrays, and share their memory.

    Args:
        clean: (n, h, w) depth [m], a Warp array.
        inputs: further arguments.
        ambient: light where the inputs have none.
        sensor: sensor that sees it.

    Raises:
        InputError: if an array has another shape, type or device.
    """
    irradiance, gradient, up = _sky(inputs, ambient, sensor, clean)
    return BatchScene(
        depth=clean,
        reflectance=_share(inputs.reflectance, clean, sensor),
        irradiance=irradiance,
        gradient=gradient,
        up=up,
        right_depth=_further("right_depth_m", inputs.right_depth_m, clean),
        projector_depth=_further("projector_depth_m", inputs.projector_depth_m, clean),
    )


def _sky(
    inputs: SceneArrays, ambient: Ambient, sensor: Sensor, clean: Any
) -> tuple[Any, float, Any]:
    """Return irradiance (n,), gradient and zenith (n, 3) of the sky."""
    count, device = clean.shape[0], clean.device
    lux, up = inputs.ambient_lux, inputs.up
    many_lux, many_up = handoff.is_array(lux), handoff.is_array(up)
    one_lux, one_up = None if many_lux else lux, None if many_up else up
    even = daylight.ambient_of(ambient, one_lux, one_up, sensor)
    if many_lux:
        levels = _of_shape("ambient_lux", lux, (count,), clean)
        irradiance = wp.empty(count, dtype=float, device=device)
        launch(light.scale, count, device, levels, daylight.w_m2_per_lux(sensor), irradiance)
    else:
        irradiance = wp.full(count, even.irradiance_w_m2, dtype=float, device=device)
    if many_up:
        zenith = _of_shape("up", up, (count, 3), clean)
        return irradiance, daylight.from_above(ambient), zenith
    zenith = wp.array([even.up] * count, dtype=float, device=device)
    return irradiance, even.gradient, zenith


def _share(reflectance: Any, clean: Any, sensor: Sensor) -> Any:
    """Return the reflectance as a number or an array (n, h, w), or refuse it."""
    if reflectance is None:
        return depth_input.REFLECTANCE
    if errors.is_number(reflectance):
        errors.in_interval("reflectance", reflectance, 0.0, 1.0)
        return float(reflectance)
    image = handoff.as_warp("reflectance", reflectance, clean.device)
    shape = tuple(clean.shape)
    if image.dtype == wp.uint8 and image.shape == (*shape, 3):
        share = wp.empty(shape, dtype=float, device=clean.device)
        visible = sensor.projector.visible
        launch(light.fill_reflectance, shape, clean.device, image, visible, share)
        return share
    if image.dtype != wp.float32 or image.shape != shape:
        rule = f"must be {shape} float32, or {(*shape, 3)} uint8 of RGB"
        remedy = "Give one image for each environment."
        kinds = ("float32", "uint8")
        raise handoff.refusal("reflectance", rule, image, remedy, kinds=kinds)
    return image


def _further(name: str, depth: Any, clean: Any) -> Any:
    """Return depth seen from another place, or refuse it."""
    return None if depth is None else _of_shape(name, depth, tuple(clean.shape), clean)


def _of_shape(name: str, values: Any, shape: tuple[int, ...], clean: Any) -> Any:
    array = handoff.as_warp(name, values, clean.device)
    if array.dtype != wp.float32 or tuple(array.shape) != shape:
        remedy = "Its first axis is that of the environments."
        raise handoff.refusal(name, f"must be {shape} float32", array, remedy)
    return array
