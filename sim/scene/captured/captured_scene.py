"""Scenes from real captures: surface from reference depth, reflectance and light from infrared."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from starling.patterns import errors
from starling.sim.arrays import Image, filled
from starling.sim.captures.capture import CapturedScene, Frame, GreyImage, open_set
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager import mix_pixels
from starling.sim.imaging.imager.charge import Die
from starling.sim.imaging.optics import alignment
from starling.sim.imaging.signals import Signals, signals
from starling.sim.render.layers import Layers, ViewLayers
from starling.sim.scene.captured import depth_surface, detail, room_light
from starling.sim.scene.captured.room_light import LIT_ROOM_W_M2, RoomLight
from starling.sim.scene.scene import Material, Scene
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import disparity_from_depth

Side = Literal["left", "right"]

_PASSES = 10  # Iterations of the unmixing; 20 give no visible change.
_WITHIN = 2 / 3  # Smoothing within surfaces in the unmixing, relative to that of the image.
_JUMP_PX = 2.0  # Disparity steps well above this separate surfaces; smaller slopes do not [px].
_DARK_PX = 25  # Side of a place that bounds the black level [px].
_DRIFT_DN = 1.5  # Largest drift of a black level, of a D415 1 DN (docs/results/simulation.md).
_DARKEST = 1e-4  # Least divisor of the unmixing, relative to the brightest pixel.


def load(
    path: Path,
    sensor: Sensor,
    *,
    smoothing_px: float = 0.0,
    within_surfaces: bool = False,
    even_ambient: bool = False,
    left_only: bool = False,
) -> Scene:
    """Build a scene to simulate from one scene of a capture set.

    Args:
        path: Folder of the captured scene.
        sensor: Best available model of the captures' camera.
        smoothing_px: As in `estimate_light`.
        within_surfaces: As in `estimate_light`.
        even_ambient: As in `estimate_light`.
        left_only: As in `estimate_light`.

    Raises:
        InputError: if the folder is not a scene of a capture set, or as `estimate_light`.
    """
    captures = open_set(path)
    if len(captures.scenes) != 1:
        raise errors.refuse(
            "scene", "must be one scene of a capture set", path, "Name one of its folders."
        )
    (scene,) = captures.scenes
    light = estimate_light(
        scene,
        sensor,
        smoothing_px=smoothing_px,
        within_surfaces=within_surfaces,
        even_ambient=even_ambient,
        left_only=left_only,
    )
    return scene_from_light(scene, light)


def scene_from_light(scene: CapturedScene, light: RoomLight) -> Scene:
    """Build a scene from a captured scene's reference depth and given light.

    Args:
        scene: Captured scene with reference depth.
        light: Reflectance and ambient light in the left view.

    Raises:
        InputError: if there is no reference depth.
    """
    return depth_surface.scene(
        scene.name,
        _disparity_px(scene),
        scene.info,
        Material(name="as seen"),
        reflectance=light.reflectance,
        ambient_w_m2=light.ambient_w_m2,
        ambient_share=light.ambient_share,
    )


def estimate_light(
    scene: CapturedScene,
    sensor: Sensor,
    *,
    smoothing_px: float = 0.0,
    within_surfaces: bool = False,
    even_ambient: bool = False,
    left_only: bool = False,
) -> RoomLight:
    """Estimate reflectance and ambient light from the infrared images of the fullest frame.

    The light on the reference surface is rendered with the sensor's projector and lens, in the
    captures' geometry. Reflectance is the image over that light, in the detail of the image
    (`starling.sim.scene.captured.detail`). A projector-off image is used if there is one. The
    contrast of the dots gives the ambient light (`starling.sim.scene.captured.room_light`). If the
    dots of sensor and image agree, it also gives the light's variation over the image
    (`starling.sim.scene.captured.ambient_share`).

    Args:
        scene: Captured scene.
        sensor: Model of the captures' camera.
        smoothing_px: Sigma of a Gaussian that smooths the image, dots included, so that the scene
            contains no detail of the image. 0 keeps the detail.
        within_surfaces: Undo the Gaussian's mixing across edges of the reference depth
            (`starling.sim.scene.captured.captured_scene`). Detail always does.
        even_ambient: Assume ambient light that does not vary over the image.
        left_only: Leave the right image out, so that it can be compared with a simulated one.

    Raises:
        InputError: if smoothing_px is outside 0 to 100, or if reference depth or infrared image is
            missing.
    """
    from starling.sim.render import direct
    from starling.sim.render.mitsuba_scene import MitsubaScene
    from starling.sim.scene.captured import ambient_share

    errors.in_interval("smoothing_px", smoothing_px, 0.0, 100.0, "12 leaves no dots.")
    frame = scene.fullest()
    disparity_px, black_dn = _disparity_px(scene), sensor.left.black_level_dn
    image_dn = _reflectance_level(scene, frame, black_dn)
    if not scene.info.are_of(sensor):
        sensor = scene.info.geometry_into(sensor)
    even = scene_from_light(
        scene, RoomLight(np.full(disparity_px.shape, 0.5, np.float32), LIT_ROOM_W_M2)
    )
    layers = direct.layers(MitsubaScene(even), sensor)
    light = signals(layers.left, even, sensor, "left")
    ambient, share, dots_known = LIT_ROOM_W_M2, None, True
    if frame.ir_left is not None:
        dotted = _level(scene, frame.ir_left, black_dn)
        still = mean_signals(layers.left, even, sensor)
        share = ambient_share.estimate(dotted, still, disparity_px)
        dots_known = share is not None or not light.laser.any()
        share = None if even_ambient else share
        if share is not None:
            light = dataclasses.replace(light, ambient=share * light.ambient)
        ambient = room_light.ambient_w_m2(dotted, light, sensor.left)
    off = frame.ir_left_off is not None
    if off:  # The image shows ambient light alone.
        light = dataclasses.replace(light, laser=np.zeros_like(light.laser))

    def smoothed(image: Image) -> Image:
        sigma_px = smoothing_px or detail.LEVEL_PX
        edges_px = disparity_px if within_surfaces or not smoothing_px else None
        return _smoothed(image, sigma_px, edges_px)

    reflectance = room_light.reflectance(image_dn, light, ambient, smoothed)
    if not smoothing_px:
        lit = sensor if not off else _unlit(sensor)
        images: dict[Side, Image | None] = {
            "left": image_dn,
            "right": None if left_only else _right_level(scene, frame, sensor),
        }
        views = _seen_views(images, layers, lit, RoomLight(reflectance, ambient, share))
        reflectance = detail.refine(reflectance, views, dots_known=dots_known or off)
    return RoomLight(reflectance, ambient, share)


def _unlit(sensor: Sensor) -> Sensor:
    return dataclasses.replace(sensor, projector=dataclasses.replace(sensor.projector, power_w=0.0))


def _seen_views(
    images: Mapping[Side, Image | None], layers: Layers, sensor: Sensor, light: RoomLight
) -> list[detail.SeenView]:
    """Collect images of the imagers, and their light on surfaces of one reflectance."""
    views = []
    rendered: dict[Side, ViewLayers | None] = {"left": layers.left, "right": layers.right}
    for side, view in rendered.items():
        image = images[side]
        if view is None or image is None:
            continue
        imager = sensor.left if side == "left" else sensor.right
        rig = {"focal_px": sensor.fx_px, "baseline_m": sensor.true_baseline_m}
        disparity_px = disparity_from_depth(view.depth_m, **rig)
        share = np.float32(light.ambient_w_m2)
        if light.ambient_share is not None:
            share_left = light.ambient_share
            if side == "right":
                share = share * detail.in_right(share_left, disparity_px)
            else:
                share = share * share_left
        undone = alignment.undone(imager.alignment)
        die, pinhole = Die(sensor.unit, side), Pinhole.from_camera(sensor)
        (ideal,) = alignment.misalign((image,), undone, pinhole, die)
        views.append(
            detail.SeenView(
                image=np.maximum(ideal, 0),
                laser=view.projector_direct * np.float32(sensor.projector.power_w),
                ambient=view.ambient * share,
                disparity_px=disparity_px,
                imager=imager,
            )
        )
    return views


def _right_level(scene: CapturedScene, frame: Frame, sensor: Sensor) -> Image | None:
    """Right image of the pair that gives the reflectance [DN above black], if there is one."""
    image = frame.ir_right if frame.ir_left_off is None else frame.ir_right_off
    return None if image is None else _level(scene, image, sensor.right.black_level_dn)


def mean_signals(view: ViewLayers, scene: Scene, sensor: Sensor) -> Signals:
    """Mean signals of each light in the left imager, without speckle.

    Simulated speckle differs from the image's, and so would dots without the imager's blur. Both
    would lower the correlation with the image and bias the estimate of ambient light upwards.

    Args:
        view: Layers of the left imager, rendered with this sensor's geometry and projector.
        scene: Scene of the view.
        sensor: Projector, optics, crosstalk and blur.
    """
    still = dataclasses.replace(sensor, projector=sensor.projector.steady())
    steady_light = signals(view, scene, still, "left")
    lights = (steady_light.laser, steady_light.ambient, steady_light.other)
    laser, ambient, rest = (mix_pixels(sensor.left, light) for light in lights)
    return Signals(laser=laser, ambient=ambient, other=rest)


def brightness(scene: CapturedScene, *, smoothing_px: float) -> Image:
    """Smoothed brightness (h, w) of the fullest frame, scaled to a mean of 0.5.

    It includes both light and reflectance.

    Args:
        scene: Captured scene.
        smoothing_px: Sigma of the Gaussian [px].

    Raises:
        InputError: if there is no infrared image.
    """
    level = _reflectance_level(scene, scene.fullest(), 0.0)
    return room_light.plausible_reflectance(_smoothed(level, smoothing_px, None))


def _smoothed(image: Image, sigma_px: float, edges_px: Image | None) -> Image:
    """Smooth an image, within surfaces if a disparity map with their edges is given."""
    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.float32)
    return smooth if edges_px is None else unmix_edges(smooth, edges_px, sigma_px)


def _reflectance_level(scene: CapturedScene, frame: Frame, black_dn: float) -> Image:
    """Image that gives the reflectance [DN above black]: projector off, if available."""
    image = frame.ir_left if frame.ir_left_off is None else frame.ir_left_off
    if image is None:
        raise _incomplete(scene.path)
    return _level(scene, image, black_dn)


def _level(scene: CapturedScene, image: GreyImage, black_dn: float) -> Image:
    """Image (h, w) [DN above black]; `black_dn` applies if the captures state no black level.

    A device's black level drifts by a code. No place is darker than it, so the image's darkest
    place bounds it from above. Otherwise dark surfaces seem to reflect nothing.
    """
    stated = scene.info.black_level_dn
    black = black_dn if stated is None else stated
    level = image.astype(np.float32)
    darkest = float(cv2.blur(level, (_DARK_PX, _DARK_PX)).min())
    if darkest >= black - _DRIFT_DN:  # Darker places are borders without an image.
        black = min(black, darkest)
    return np.maximum(level - np.float32(black), 0)


def _disparity_px(scene: CapturedScene) -> Image:
    truth_m = scene.truth_m()
    if truth_m is None:
        raise _incomplete(scene.path)
    return scene.info.disparity_px(truth_m)


def _incomplete(path: Path) -> errors.InputError:
    return errors.refuse(
        "scene", "must have truth.png and ir_left.png", path, "Choose a scene with both."
    )


def unmix_edges(image: Image, disparity_px: Image, sigma_px: float) -> Image:
    """Undo the mixing of a Gaussian across depth edges; detail within surfaces stays lost.

    Richardson-Lucy deconvolution. After each iteration an edge-aware filter smooths within
    surfaces. Without the unmixing, a bright wall would brighten adjacent surfaces.

    Args:
        image: (h, w) >= 0, smoothed by a Gaussian of `sigma_px`.
        disparity_px: (h, w) reference, NaN where unknown; known somewhere.
        sigma_px: Sigma of the Gaussian [px].

    Returns:
        (h, w) >= 0 with jumps at depth edges. Smoothed again, it equals `image` to a few per cent.

    Source: Richardson, J. Opt. Soc. Am. 62, 1972, eq. 7; domain transform: Gastal and Oliveira,
    ACM Trans. Graph. 30 (SIGGRAPH 2011), normalised convolution.
    """
    filled_px = filled(disparity_px, np.isfinite(disparity_px))
    guide = np.ascontiguousarray(filled_px, np.float32)
    least = np.float32(_DARKEST * max(float(image.max()), 1e-30))
    estimate = image
    for _ in range(_PASSES):
        blurred = np.maximum(cv2.GaussianBlur(estimate, (0, 0), sigma_px), least)
        estimate = cv2.ximgproc.dtFilter(
            guide,
            np.asarray(estimate * (image / blurred), np.float32),
            _WITHIN * sigma_px,
            _JUMP_PX,
            mode=cv2.ximgproc.DTF_NC,
        )
    return np.asarray(np.maximum(estimate, 0), np.float32)
