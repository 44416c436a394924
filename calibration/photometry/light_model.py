"""The light model of captured images: predicted level, its derivatives, and how sure each is."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration import detail
from starling.calibration.least_squares import tiles
from starling.calibration.observation import Observation
from starling.calibration.photometry import levels
from starling.calibration.photometry.levels import Levels, Side, part
from starling.sim.imaging import imager
from starling.sim.imaging.imager.exposure import Exposure
from starling.sim.render import direct
from starling.sim.render.layers import Layers, Mask, View
from starling.sim.scene.scene import Scene
from starling.sim.sensor import edits
from starling.sim.sensor.sensor import Sensor

POWER = "projector.power_w"
AMBIENT = "scene.ambient.irradiance_w_m2"
HAZE = "projector.haze"
FALLOFF = "projector.falloff"
VIGNETTING = "left.lens.vignetting"
BLUR = "left.lens.blur_px"
LEFT_BLACK = "left.black_level_dn"
RIGHT_BLACK = "right.black_level_dn"
RIGHT_GAIN = "right.gain"

Array = NDArray[np.float32]

_MATCHING = 0.3  # Least correlation of the image's dots with the model's.
_BLUR_STEP_PX = 0.05


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Image:
    """One captured image, and what is needed to predict it."""

    scene: str
    side: Side
    on: bool  # Projector.
    level: Array  # (h, w) [DN]
    used: Mask
    view: View
    even: View  # The same, all of the projector's light between its dots.
    model: Scene
    exposure: Exposure
    exposure_known: bool
    ambient_w_m2: float  # Where the fit begins.
    dark_dn: float  # What dark current adds to the black level at this exposure.

    @property
    def lowest_dn(self) -> float:
        """Level of the darkest pixels less dark current's mean [DN]."""
        return levels.lower_envelope_dn(self.level) - self.dark_dn


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Columns:
    """Signal that the model predicts for reflectances as given [DN], (h, w) each."""

    model: Array
    laser: Array  # The laser's part of it.
    sharp_laser: Array  # The same before crosstalk and averaging.
    derivatives: tuple[Array, ...]
    variance: tuple[float, float, float]  # Of noise [DN^2]: constant, per signal, per laser^2.


Formed = dict[tuple[str, Side, Exposure, float], Levels]
"""Levels through the optics, by view and blur: what does not change is not formed again."""


def ambient(scene: str) -> str:
    """Name of a scene's ambient irradiance."""
    return f"{AMBIENT}[{scene}]"


def exposure_ratio(scene: str, *, on: bool) -> str:
    """Name of the factor by which an image's unknown exposure differs from the sensor's."""
    return f"exposure_ratio[{scene}, projector {'on' if on else 'off'}]"


def black_name(side: Side) -> str:
    """Name of an imager's black level."""
    return LEFT_BLACK if side == "left" else RIGHT_BLACK


def start(sensor: Sensor, strengths: Mapping[str, float]) -> dict[str, float]:
    """Where every parameter starts: the sensor's own values, and each scene's ambient light."""
    values = {
        POWER: sensor.projector.power_w,
        HAZE: sensor.projector.haze,
        FALLOFF: sensor.projector.falloff,
        VIGNETTING: sensor.left.lens.vignetting,
        BLUR: sensor.left.lens.blur_px,
        LEFT_BLACK: sensor.left.black_level_dn,
        RIGHT_BLACK: sensor.right.black_level_dn,
        RIGHT_GAIN: sensor.right.gain,
    }
    for scene, strength in strengths.items():
        values[ambient(scene)] = strength
        for on in (True, False):
            values[exposure_ratio(scene, on=on)] = 1.0
    return values


def images(
    observations: Sequence[Observation],
    sensor: Sensor,
    layers: Mapping[str, Layers],
    exposures: Mapping[str, Exposure],
) -> tuple[Image, ...]:
    """Every image of the observations that have a surface, with its layers."""
    found = []
    hazy = edits.with_values(sensor, [(HAZE, 1.0)])
    for observation in observations:
        if observation.scene is None:
            continue
        rendered = layers.get(observation.name)
        if rendered is None:
            rendered = direct.layers(observation.stage, sensor)
        spread = direct.layers(observation.stage, hazy)
        recorded = exposures.get(observation.name)
        fixed = Exposure(exposure_s=sensor.left.exposure_s, gain=sensor.left.gain)
        known = recorded is not None or sensor.left.auto_exposure_level == 0
        taken: tuple[tuple[Side, bool, Array | None], ...] = (
            ("left", True, observation.left),
            ("right", True, observation.right),
            ("left", False, observation.left_off),
            ("right", False, observation.right_off),
        )
        for side, on, level in taken:
            view, even = (one.left if side == "left" else one.right for one in (rendered, spread))
            if level is None or view is None or even is None:
                continue
            exposure = recorded or fixed
            if side == "right":
                gain = exposure.gain * sensor.right.gain / sensor.left.gain
                exposure = dataclasses.replace(exposure, gain=gain)
            own = part(sensor, side)
            dark_e = own.dark_current_e_s * exposure.exposure_s
            found.append(
                Image(
                    scene=observation.name,
                    side=side,
                    on=on,
                    level=level,
                    used=_used(level, view, sensor, side),
                    view=view,
                    even=even,
                    model=observation.scene,
                    exposure=exposure,
                    exposure_known=known,
                    ambient_w_m2=observation.scene.ambient.irradiance_w_m2,
                    dark_dn=dark_e * levels.dn_per_electron(own, exposure),
                )
            )
    return tuple(found)


def _used(level: Array, view: View, sensor: Sensor, side: Side) -> Mask:
    """Pixels off depth edges, in tiles of which half count and none is saturated.

    Leaving out saturated pixels alone would cut noise on one side.
    """
    shape = (level.shape[0], level.shape[1])
    full = tiles.tiled(level >= part(sensor, side).saturation_dn).any(axis=1)
    whole = levels.away_from_edges(view.depth_m)
    enough = tiles.tiled(whole).mean(axis=1) >= tiles.FEWEST
    return whole & (tiles.spread(enough & ~full, shape) > 0)


def dots_match(images: Sequence[Image]) -> bool:
    """Whether the dots' places in the model are those in the images, by correlation."""
    found = []
    for image in images:
        expected = image.view.projector_direct
        if image.on and expected.any():
            seen, model = (_high_passed(picture)[image.used] for picture in (image.level, expected))
            scale = float(np.sqrt((seen**2).mean() * (model**2).mean()))
            found.append(float((seen * model).mean()) / max(scale, 1e-30))
    return bool(found) and float(np.median(found)) > _MATCHING


def _high_passed(picture: Array) -> Array:
    """Picture over its local mean, less 1; so brightness does not count."""
    mean = detail.mean(picture)
    sharp = cv2.GaussianBlur(picture, (0, 0), 1.0)
    return np.asarray(sharp / np.maximum(mean, 1e-12) - 1, np.float32)


def columns(
    image: Image,
    values: Mapping[str, float],
    sensor: Sensor,
    names: Sequence[str],
    formed: Formed,
) -> Columns:
    """Predict an image's signal, and its derivative by each of the parameters named.

    The black level's column is 1: it is added to the signal. `formed` keeps what was formed, for
    other images of the view and for the next round.
    """
    at = _levels(image, values[BLUR], sensor, formed)
    lens = _dimmed(at.lens_log_cos, values[VIGNETTING] - sensor.left.lens.vignetting)
    lens *= np.float32(_scale(image, values, sensor))
    shape = _dimmed(at.projector_log_cos, values[FALLOFF] - sensor.projector.falloff)
    power = np.float32(values[POWER] if image.on else 0.0)
    strength = np.float32(values[ambient(image.scene)])
    believed, haze = sensor.projector.haze, np.float32(values[HAZE])
    dots = _dots(at.laser, at.even, believed)
    lit = np.asarray(lens * shape * np.float32(image.on), np.float32)
    unit = np.asarray(lit * ((1 - haze) * dots + haze * at.even), np.float32)
    laser = np.asarray(power * unit, np.float32)
    sharp = (1 - haze) * _dots(at.sharp_laser, at.sharp_even, believed) + haze * at.sharp_even
    model = np.asarray(laser + lens * (strength * at.ambient + at.other), np.float32)
    none = np.zeros_like(model)

    def derivative(name: str) -> NDArray:
        if name == POWER:
            return unit
        if name == HAZE:
            return power * lit * (at.even - dots)
        if name == FALLOFF:
            return laser * at.projector_log_cos
        if name == VIGNETTING:
            return model * at.lens_log_cos
        if name == black_name(image.side):
            return np.ones_like(model)
        if name == RIGHT_GAIN and image.side == "right":
            return model / np.float32(values[RIGHT_GAIN])
        if name == ambient(image.scene):
            return lens * at.ambient
        if name == exposure_ratio(image.scene, on=image.on):
            return model / np.float32(values[name])
        if name == BLUR:
            wider = _levels(image, values[BLUR] + _BLUR_STEP_PX, sensor, formed)
            change = power * lit * (1 - haze) * (_dots(wider.laser, wider.even, believed) - dots)
            change += lens * strength * (wider.ambient - at.ambient)
            return change / np.float32(_BLUR_STEP_PX)
        return none

    return Columns(
        model=model,
        laser=laser,
        sharp_laser=np.asarray(power * lit * sharp, np.float32),
        derivatives=tuple(np.asarray(derivative(name), np.float32) for name in names),
        variance=_variance(image, sensor),
    )


def above_black(image: Image, values: Mapping[str, float], sensor: Sensor) -> Array:
    """Captured signal that light made [DN] (h, w): less black level and dark current's mean.

    Dark current goes with exposure time and gain as light does. The derivatives by these leave that
    out: they set the steps, not where residuals vanish.
    """
    dark_dn = image.dark_dn * _scale(image, values, sensor)
    return image.level - np.float32(values[black_name(image.side)] + dark_dn)


def _scale(image: Image, values: Mapping[str, float], sensor: Sensor) -> float:
    """Exposure and gain over those that the image was predicted with."""
    gain = values[RIGHT_GAIN] / sensor.right.gain if image.side == "right" else 1.0
    return values[exposure_ratio(image.scene, on=image.on)] * gain


def _dots(laser: Array, even: Array, haze: float) -> Array:
    """The laser's light if it were all in dots; where it has none, as it is."""
    if haze == 1:
        return laser
    return np.asarray((laser - np.float32(haze) * even) / np.float32(1 - haze), np.float32)


def _dimmed(log_cos: Array, exponent: float) -> Array:
    return np.asarray(np.exp(log_cos * np.float32(exponent)), np.float32)


def _levels(image: Image, blur_px: float, sensor: Sensor, formed: Formed) -> Levels:
    """Layers through the optics at a blur."""
    key = (image.scene, image.side, image.exposure, blur_px)
    if key not in formed:
        own = part(sensor, image.side)
        lens = dataclasses.replace(own.lens, blur_px=blur_px)
        seen = dataclasses.replace(sensor, **{image.side: dataclasses.replace(own, lens=lens)})
        formed[key] = levels.expected(
            image.view, image.even, image.model, seen, image.side, image.exposure
        )
    return formed[key]


def forget(formed: Formed, blur_px: float) -> None:
    """Drop what was formed at another blur."""
    for key in [key for key in formed if key[3] != blur_px]:
        del formed[key]


def _variance(image: Image, sensor: Sensor) -> tuple[float, float, float]:
    """Variance of a pixel [DN^2]: constant, per DN of signal, per squared DN of laser light."""
    own = part(sensor, image.side)
    step = levels.dn_per_electron(own, image.exposure)
    dark = np.zeros((1, 1), np.float32)
    least_e, one_e = (
        float(imager.noise_e(own, dark + electrons, image.exposure.exposure_s)[0, 0])
        for electrons in (0.0, 1.0)
    )
    return (
        least_e**2 * step**2 + 1 / 12,
        (one_e**2 - least_e**2) * step,
        sensor.projector.speckle_contrast**2,
    )
