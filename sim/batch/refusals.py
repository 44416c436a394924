"""What a batch cannot do, refused by name."""

from __future__ import annotations

from starling.patterns import errors
from starling.sim.scene.scene import Scene
from starling.sim.sensor.imager import Alignment
from starling.sim.sensor.matcher import CensusSemiGlobal
from starling.sim.sensor.sensor import Sensor
from starling.sim.warp import depth_input

_LARGEST_VOLUME = 2**31 - 1  # Kernels count with 32 bits.
# Fields of an alignment that move images along rows by place.
_SHIFTS: tuple[str, ...] = ("warp_px", "waves_px", "waves_across_deg", "waves_down_deg")
_ADVICE = "Corrupt each image by itself: corruptor(depth_m)."


def refuse_residual(residual: object) -> None:
    """Refuse a model of pixels without depth, which a batch does not call.

    Raises:
        InputError: if there is a model.
    """
    if residual is not None:
        name, rule = "residual", "must be None in a batch"
        raise errors.refuse(name, rule, type(residual).__name__, _ADVICE)


def refuse_texture(scene: Scene) -> None:
    """Refuse texture of surfaces, which the kernels do not draw.

    Raises:
        InputError: if the scene has one.
    """
    contrast = scene.finish.texture_contrast
    if contrast:
        raise errors.refuse("effect texture", "must be 0.0 in a batch", contrast, _ADVICE)


def refuse_unsupported(sensor: Sensor, camera: depth_input.InputCamera) -> None:
    """Refuse a sensor that the kernels do not imitate in full.

    Args:
        sensor: the sensor with all effects.
        camera: camera of the depth images.

    Raises:
        InputError: if a setting has an effect that only `Corruptor.__call__` has, or the images
            must be resampled.
    """
    if not depth_input.matches(camera, sensor):
        size = f"{camera.shape} and {camera.matrix.tolist()}"
        remedy = "starling.load_sensor(name, camera_matrix=..., size=(width, height))."
        rule = "must be those of the sensor in a batch"
        raise errors.refuse("shape and camera_matrix", rule, size, remedy)
    if not isinstance(sensor.matcher.engine, CensusSemiGlobal):
        name, rule = "matcher.engine", "must be CensusSemiGlobal in a batch"
        raise errors.refuse(name, rule, type(sensor.matcher.engine).__name__, _ADVICE)
    volume = sensor.width * sensor.height * sensor.matcher.search_px
    if volume > _LARGEST_VOLUME:
        name, rule = (
            "width x height x matcher.search_px",
            f"must be <= {_LARGEST_VOLUME} in a batch",
        )
        raise errors.refuse(name, rule, volume, "Search fewer disparities.")
    values: dict[str, tuple[object, object]] = {  # Value, and the neutral value.
        "kind": (sensor.kind, "stereo"),
        "matcher.extended": (sensor.matcher.extended, False),
        "projector.flicker": (sensor.projector.flicker, 0.0),
        "post.decimation": (sensor.post.decimation, 1),
        "post.spatial_alpha": (sensor.post.spatial_alpha, 1.0),
        "post.temporal_alpha": (sensor.post.temporal_alpha, 1.0),
        "post.hole_filling": (sensor.post.hole_filling, "off"),
        "post.registered": (sensor.post.registered, False),
    }
    for side, imager in (("left", sensor.left), ("right", sensor.right)):
        shifted = {name: getattr(imager.alignment, name) for name in _SHIFTS}
        values[f"{side}.alignment"] = (imager.alignment, Alignment(**shifted))
        values[f"{side}.lens.spot_shape"] = (imager.lens.spot_shape, 0.0)
        values[f"{side}.blooming"] = (imager.blooming, 0.0)
        values[f"{side}.mosaic"] = (imager.mosaic, "none")
    for name, (value, neutral) in values.items():
        if value != neutral:
            raise errors.refuse(name, f"must be {neutral!r} in a batch", repr(value), _ADVICE)
