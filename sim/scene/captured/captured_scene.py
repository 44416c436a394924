"""A real capture as a scene: reference depth as surface, reflectance and light by its infrared."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures.capture import CapturedScene, Frame, GreyImage, open_set
from starling.sim.imaging.imager import mixed
from starling.sim.imaging.signals import Signals, signals
from starling.sim.imaging.steady import steady
from starling.sim.render.layers import View
from starling.sim.scene.captured import depth_surface, dot_removal, room_light
from starling.sim.scene.captured.edge_unmixing import unmixed
from starling.sim.scene.captured.room_light import LIT_ROOM_W_M2, Lit
from starling.sim.scene.scene import Material, Scene
from starling.sim.sensor.sensor import Sensor

Array = NDArray[np.float32]


def load(
    path: Path, sensor: Sensor, *, smoothing_px: float = 0.0, within_surfaces: bool = False
) -> Scene:
    """Turn one scene of a capture set into a scene to simulate.

    Args:
        path: the scene's folder.
        sensor: whose projector, lens and noise the captures are of, as far as is known.
        smoothing_px: as in `lit`.
        within_surfaces: likewise.

    Raises:
        InputError: if the folder is no scene of a capture set, or as `lit`.
    """
    captures = open_set(path)
    if len(captures.scenes) != 1:
        raise errors.refuse(
            "scene", "must be one scene of a capture set", path, "Name one of its folders."
        )
    (scene,) = captures.scenes
    told = lit(scene, sensor, smoothing_px=smoothing_px, within_surfaces=within_surfaces)
    return surface(scene, told)


def surface(scene: CapturedScene, told: Lit) -> Scene:
    """Turn a captured scene's reference into a scene, whatever its light is taken for.

    Args:
        scene: of a capture set, with reference depth.
        told: reflectance and ambient light in the left view.

    Raises:
        InputError: if there is no reference depth.
    """
    return depth_surface.scene(
        scene.name,
        _disparity_px(scene),
        scene.info,
        Material(name="as seen"),
        reflectance=told.reflectance,
        ambient_w_m2=told.ambient_w_m2,
        ambient_share=told.ambient_share,
    )


def lit(
    scene: CapturedScene,
    sensor: Sensor,
    *,
    smoothing_px: float = 0.0,
    within_surfaces: bool = False,
) -> Lit:
    """Estimate reflectance and ambient light from the infrared image of the fullest frame.

    The sensor's projector and lens light the reference surface, with the captures' geometry if the
    sensor has another; what that does not explain of the image is reflectance. With a projector-off
    image that is the reflectance's, else the dots are taken out (`starling.sim.scene.captured.dot_removal`). How
    strongly they stand out tells of ambient light (`starling.sim.scene.captured.room_light`), place by place where
    the sensor's dots are those of the image (`starling.sim.scene.captured.ambient_share`).

    Args:
        scene: of a capture set.
        sensor: that the captures are of.
        smoothing_px: sigma of a Gaussian that the image is smoothed by as it is, dots and all, so
            that nothing of its detail gets into the scene; 0 takes out the dots instead.
        within_surfaces: what the Gaussian mixed across depth edges is parted again, by means of the
            reference depth alone (`starling.sim.scene.captured.edge_unmixing`).

    Raises:
        InputError: if smoothing_px is not 0 to 100, or there is no reference depth or no infrared
            image.
    """
    from starling.sim.render import direct
    from starling.sim.render.mitsuba_scene import Stage
    from starling.sim.scene.captured import ambient_share

    errors.in_interval("smoothing_px", smoothing_px, 0.0, 100.0, "12 leaves no dots.")
    frame = scene.fullest()
    disparity_px, black_dn = _disparity_px(scene), sensor.left.black_level_dn
    seen = _seen(scene, frame, black_dn)
    if not scene.info.are_of(sensor):
        sensor = scene.info.geometry_into(sensor)
    even = surface(scene, Lit(np.full(disparity_px.shape, 0.5, np.float32), LIT_ROOM_W_M2))
    view = direct.layers(Stage(even), sensor).left
    light = signals(view, even, sensor, "left")
    ambient, share = LIT_ROOM_W_M2, None
    if frame.ir_left is not None:
        dotted = _level(scene, frame.ir_left, black_dn)
        share = ambient_share.told(dotted, in_the_mean(view, even, sensor), disparity_px)
        if share is not None:
            light = dataclasses.replace(light, ambient=share * light.ambient)
        ambient = room_light.ambient_w_m2(dotted, light, sensor.left)
    off = frame.ir_left_off is not None
    if off:  # Then ambient light alone is seen.
        light = dataclasses.replace(light, laser=np.zeros_like(light.laser))

    def detail(image: Array) -> Array:
        if smoothing_px > 0:
            parted = disparity_px if within_surfaces else None
            return _smoothed(image, smoothing_px, parted)
        return image if off else np.maximum(dot_removal.removed(image), 0)

    return Lit(room_light.reflectance(seen, light, ambient, detail), ambient, share)


def in_the_mean(view: View, scene: Scene, sensor: Sensor) -> Signals:
    """What a left imager makes of each light, speckle apart.

    Grains that are not the image's own, and dots that are not averaged as its are, would agree with
    it less, which passes for ambient light, and for more of it the more dots there are.

    Args:
        view: of the left imager, rendered with this sensor's geometry and projector.
        scene: it is of.
        sensor: whose projector, optics, crosstalk and averaging act.
    """
    still = dataclasses.replace(sensor, projector=steady(sensor.projector))
    seen = signals(view, scene, still, "left")
    lights = (seen.laser, seen.ambient, seen.other)
    laser, ambient, other = (mixed(sensor.left, one) for one in lights)
    return Signals(laser=laser, ambient=ambient, other=other)


def brightness(scene: CapturedScene, *, smoothing_px: float) -> Array:
    """Brightness (h, w) of the fullest frame, smoothed, 0.5 in the mean: light and reflectance.

    Args:
        scene: of a capture set.
        smoothing_px: sigma of a Gaussian.

    Raises:
        InputError: if there is no infrared image.
    """
    level = _seen(scene, scene.fullest(), 0.0)
    return room_light.believable(_smoothed(level, smoothing_px, None))


def _smoothed(image: Array, sigma_px: float, parted_px: Array | None) -> Array:
    """Smooth an image, within surfaces where disparity parts them."""
    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.float32)
    return smooth if parted_px is None else unmixed(smooth, parted_px, sigma_px)


def _seen(scene: CapturedScene, frame: Frame, black_dn: float) -> Array:
    """Level of the image that tells reflectance: with the projector off, where there is such."""
    image = frame.ir_left if frame.ir_left_off is None else frame.ir_left_off
    if image is None:
        raise _incomplete(scene.path)
    return _level(scene, image, black_dn)


def _level(scene: CapturedScene, image: GreyImage, black_dn: float) -> Array:
    """An image (h, w) [DN above black]; the black level is another's where captures tell none."""
    told = scene.info.black_level_dn
    return np.maximum(image.astype(np.float32) - np.float32(black_dn if told is None else told), 0)


def _disparity_px(scene: CapturedScene) -> Array:
    truth_m = scene.truth_m()
    if truth_m is None:
        raise _incomplete(scene.path)
    return scene.info.disparity_px(truth_m)


def _incomplete(path: Path) -> errors.InputError:
    return errors.refuse(
        "scene", "must have truth.png and ir_left.png", path, "Choose a scene with both."
    )
