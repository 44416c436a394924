"""Light model of captured images: predicted level, its derivatives and its variance."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration import correlation
from starling.calibration.least_squares import tiles
from starling.calibration.observation import Observation, Side
from starling.calibration.photometry import levels
from starling.calibration.photometry.levels import Levels, side_imager
from starling.sim.arrays import Mask
from starling.sim.imaging import imager
from starling.sim.imaging.imager.exposure import Exposure
from starling.sim.render import direct
from starling.sim.render.layers import Layers, ViewLayers
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

Array = NDArray[np.float32]

_MATCHING = 0.3  # Minimum correlation of observed and predicted dots.
_BLUR_STEP_PX = 0.05  # Step of the finite difference by blur.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class CapturedImage:
    """One captured image, with the data for its prediction."""

    scene: str
    side: Side
    on: bool  # Whether the projector is on.
    level: Array  # (h, w) [DN]
    used: Mask
    view: ViewLayers
    even: ViewLayers  # The same with a haze of 1: uniform projector light.
    model: Scene
    exposure: Exposure
    exposure_known: bool
    ambient_w_m2: float  # Initial ambient irradiance.
    dark_dn: float  # Mean dark current at this exposure.

    @property
    def lowest_dn(self) -> float:
        """Level of the darkest pixels minus the mean dark current [DN]."""
        return levels.lower_envelope_dn(self.level) - self.dark_dn


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LightColumns:
    """Predicted signal for the given reflectances [DN], each (h, w)."""

    model: Array
    laser: Array  # Laser light in `model`.
    sharp_laser: Array  # Laser light before crosstalk and averaging.
    derivatives: tuple[Array, ...]
    variance: tuple[float, float, float]  # Noise [DN^2]: constant, per signal, per laser^2.


LevelsCache = dict[tuple[str, Side, Exposure, float], Levels]
"""Cache of levels after the optics, by view, exposure and blur."""


def ambient(scene: str) -> str:
    """Return the name of a scene's ambient irradiance."""
    return f"{AMBIENT}[{scene}]"


def exposure_ratio(scene: str) -> str:
    """Return the name of the ratio of a scene's exposures with the projector off and on."""
    return f"exposure_ratio[{scene}, projector off]"


def black_name(side: Side) -> str:
    """Return the name of an imager's black level."""
    return LEFT_BLACK if side == "left" else RIGHT_BLACK


def start(sensor: Sensor, strengths: Mapping[str, float]) -> dict[str, float]:
    """Return initial values: those of the sensor, and the ambient light of each scene."""
    values = {
        POWER: sensor.projector.power_w,
        HAZE: sensor.projector.haze,
        FALLOFF: sensor.projector.falloff,
        VIGNETTING: sensor.left.lens.vignetting,
        BLUR: sensor.left.lens.blur_px,
        LEFT_BLACK: sensor.left.black_level_dn,
        RIGHT_BLACK: sensor.right.black_level_dn,
    }
    for scene, strength in strengths.items():
        values |= {ambient(scene): strength, exposure_ratio(scene): 1.0}
    return values


def images(
    observations: Iterable[Observation], sensor: Sensor, layers: Mapping[str, Layers]
) -> tuple[CapturedImage, ...]:
    """Return the images of all observations with a surface, with their layers.

    A recorded exposure is that of the left imager.
    """
    captured = []
    hazy = edits.with_values(sensor, [(HAZE, 1.0)])
    sensor_exposure = Exposure(exposure_s=sensor.left.exposure_s, gain=sensor.left.gain)
    sides: tuple[tuple[Side, bool, str], ...] = (
        ("left", True, "left"),
        ("right", True, "right"),
        ("left", False, "left_off"),
        ("right", False, "right_off"),
    )
    for observation in observations:
        if observation.scene is None:
            continue
        rendered = layers.get(observation.name) or direct.layers(observation.stage, sensor)
        spread = direct.layers(observation.stage, hazy)
        known = observation.exposure is not None or sensor.left.auto_exposure_level == 0
        for side, on, name in sides:
            level, view, even = (
                getattr(*place) for place in ((observation, name), (rendered, side), (spread, side))
            )
            if level is None or view is None or even is None:
                continue
            exposure = observation.exposure or sensor_exposure
            if side == "right":
                gain = exposure.gain * sensor.right.gain / sensor.left.gain
                exposure = dataclasses.replace(exposure, gain=gain)
            part = side_imager(sensor, side)
            dark_e = part.dark_current_e_s * exposure.exposure_s
            captured.append(
                CapturedImage(
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
                    dark_dn=dark_e * levels.dn_per_electron(part, exposure),
                )
            )
    return tuple(captured)


def _used(level: Array, view: ViewLayers, sensor: Sensor, side: Side) -> Mask:
    """Select pixels away from depth edges, in tiles without saturation and at least half valid.

    Excluding single saturated pixels would bias the noise.
    """
    saturated = tiles.cut_tiles(level >= side_imager(sensor, side).saturation_dn).any(axis=1)
    away = levels.away_from_edges(view.depth_m)
    enough = tiles.cut_tiles(away).mean(axis=1) >= tiles.FEWEST
    return away & (tiles.to_pixels(enough & ~saturated, level.shape) > 0)


def dots_match(images: Sequence[CapturedImage]) -> bool:
    """Return whether predicted and observed dots match, by correlation."""
    correlations = []
    for image in images:
        expected = image.view.projector_direct
        if image.on and expected.any():
            observed, model = (
                _high_passed(picture)[image.used] for picture in (image.level, expected)
            )
            scale = float(np.sqrt((observed**2).mean() * (model**2).mean()))
            correlations.append(float((observed * model).mean()) / max(scale, 1e-30))
    return bool(correlations) and float(np.median(correlations)) > _MATCHING


def _high_passed(picture: Array) -> Array:
    """Return the picture over its local mean, minus 1, independent of brightness."""
    mean = correlation.local_mean(picture)
    sharp = cv2.GaussianBlur(picture, (0, 0), 1.0)
    return np.asarray(sharp / np.maximum(mean, 1e-12) - 1, np.float32)


def columns(
    image: CapturedImage,
    values: Mapping[str, float],
    sensor: Sensor,
    names: Sequence[str],
    formed: LevelsCache,
) -> LightColumns:
    """Predict an image's signal and its derivatives by the named parameters.

    The black level is an additive term, so its column is 1. `formed` caches levels for other
    images of the view and for the next round.
    """
    unit_levels = _levels(image, values[BLUR], sensor, formed)
    scale = np.float32(_scale(image, values))
    exponent = np.float32(values[FALLOFF] - sensor.projector.falloff)
    shape = np.exp(unit_levels.projector_log_cos * exponent)
    power = np.float32(values[POWER] if image.on else 0.0)
    strength = np.float32(values[ambient(image.scene)])
    start_haze, haze = sensor.projector.haze, np.float32(values[HAZE])
    dots = _dots(unit_levels.laser, unit_levels.even, start_haze)
    optics = np.asarray(scale * shape * np.float32(image.on), np.float32)
    per_watt = np.asarray(optics * ((1 - haze) * dots + haze * unit_levels.even), np.float32)
    laser = np.asarray(power * per_watt, np.float32)
    sharp = (1 - haze) * _dots(
        unit_levels.sharp_laser, unit_levels.sharp_even, start_haze
    ) + haze * unit_levels.sharp_even
    model = np.asarray(
        laser + scale * (strength * unit_levels.ambient + unit_levels.other), np.float32
    )
    zeros = np.zeros_like(model)

    def derivative(name: str) -> NDArray:
        if name == HAZE:
            return power * optics * (unit_levels.even - dots)
        if name == FALLOFF:
            return laser * unit_levels.projector_log_cos
        if name == black_name(image.side):
            return np.ones_like(model)
        if name == ambient(image.scene):
            return scale * unit_levels.ambient
        if name == exposure_ratio(image.scene) and not image.on:
            return model / np.float32(values[name])
        if name == BLUR:
            blurred = _levels(image, values[BLUR] + _BLUR_STEP_PX, sensor, formed)
            change = (
                power
                * optics
                * (1 - haze)
                * (_dots(blurred.laser, blurred.even, start_haze) - dots)
            )
            change += scale * strength * (blurred.ambient - unit_levels.ambient)
            return change / np.float32(_BLUR_STEP_PX)
        return zeros

    return LightColumns(
        model=model,
        laser=laser,
        sharp_laser=np.asarray(power * optics * sharp, np.float32),
        derivatives=tuple(np.asarray(derivative(name), np.float32) for name in names),
        variance=_variance(image, sensor),
    )


def above_black(image: CapturedImage, values: Mapping[str, float]) -> Array:
    """Subtract black level and mean dark current from a captured image [DN] (h, w).

    Dark current is proportional to exposure. The derivative by exposure neglects this, which
    affects the steps but not the solution.
    """
    dark_dn = image.dark_dn * _scale(image, values)
    return image.level - np.float32(values[black_name(image.side)] + dark_dn)


def _scale(image: CapturedImage, values: Mapping[str, float]) -> float:
    """Return the exposure relative to that of the prediction."""
    return 1.0 if image.on else values[exposure_ratio(image.scene)]


def _dots(laser: Array, even: Array, haze: float) -> Array:
    """Return the laser light for a haze of 0; unchanged if the pattern has no dots."""
    if haze == 1:
        return laser
    return np.asarray((laser - np.float32(haze) * even) / np.float32(1 - haze), np.float32)


def _levels(image: CapturedImage, blur_px: float, sensor: Sensor, formed: LevelsCache) -> Levels:
    """Return the layers after the optics at a blur."""
    key = (image.scene, image.side, image.exposure, blur_px)
    if key not in formed:
        imager_part = side_imager(sensor, image.side)
        lens = dataclasses.replace(imager_part.lens, blur_px=blur_px)
        blurred_sensor = dataclasses.replace(
            sensor, **{image.side: dataclasses.replace(imager_part, lens=lens)}
        )
        formed[key] = levels.unit_levels(
            image.view, image.even, image.model, blurred_sensor, image.side, image.exposure
        )
    return formed[key]


def evict(formed: LevelsCache, blur_px: float) -> None:
    """Drop cached levels at another blur."""
    for key in [key for key in formed if key[3] != blur_px]:
        del formed[key]


def _variance(image: CapturedImage, sensor: Sensor) -> tuple[float, float, float]:
    """Return the variance [DN^2]: constant, per DN of signal, per squared DN of laser light."""
    imager_part = side_imager(sensor, image.side)
    step = levels.dn_per_electron(imager_part, image.exposure)
    dark = np.zeros((1, 1), np.float32)
    dark_noise_e, unit_noise_e = (
        float(imager.noise_e(imager_part, dark + electrons, image.exposure.exposure_s)[0, 0])
        for electrons in (0.0, 1.0)
    )
    return (
        dark_noise_e**2 * step**2 + 1 / 12,
        (unit_noise_e**2 - dark_noise_e**2) * step,
        sensor.projector.speckle_contrast**2,
    )
