"""Fit image levels: projector power, ambient light, black level, vignetting and falloff.

level = b + d + c (P F^k ((1 - h) D + h E) + I A + O)

b is the black level, d the mean dark current of the sensor, c the relative reflectance of a tile. F
is the off-axis cosine of the projector, P is the power, h the haze, I the ambient irradiance. The
geometry gives the layers D (dots), E (uniform projector light), A and O.

The reflectance of each tile is free. Vignetting is not separable from it, and neither is the power,
which has the same effect as exposure time, gain, quantum efficiency and lens transmission. The fit
keeps both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares import tiles
from starling.calibration.observation import Observation
from starling.calibration.photometry import levels, light_model, prediction
from starling.calibration.photometry.light_model import (
    AMBIENT,
    BLUR,
    FALLOFF,
    HAZE,
    LEFT_BLACK,
    POWER,
    RIGHT_BLACK,
    VIGNETTING,
    CapturedImage,
    LevelsCache,
    ambient,
    exposure_ratio,
)
from starling.calibration.photometry.photometry_open import BLACK_DN, sentences
from starling.calibration.photometry.prediction import Prediction
from starling.calibration.solution import Estimate, Solution
from starling.patterns import errors
from starling.sim.console import progress
from starling.sim.imaging.imager import metered_rows_columns
from starling.sim.render.layers import Layers
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

PARAMETERS = (POWER, AMBIENT, LEFT_BLACK, HAZE, VIGNETTING, FALLOFF, BLUR)
"""Names for `free`; the left black level also frees the right imager's black level."""
EXPOSURE_LEVEL = "left.auto_exposure_level"
_LEAST_SCENES = 2  # Minimum number of scenes for an estimate of the scatter of their levels.
_KEPT = (POWER, VIGNETTING)  # Not separable from the free reflectance.
_COMMON = tuple(name for name in PARAMETERS if name != AMBIENT)  # Common to all scenes.

_ROUNDS = 10  # Maximum number of steps.
# Radius in tiles of the mean reflectance in a tile's weights. The reflectance of a single tile
# would correlate its weight with its noise.
_AROUND = 2
_STILL = 1e-3  # Step below which the fit ends [standard deviations].
_UNITS = {POWER: "W", LEFT_BLACK: "DN", RIGHT_BLACK: "DN", BLUR: "px"}
_LEAST = 1e-6  # Lower limit of positive parameters.
_LIMITS = {
    HAZE: (0.0, 0.95),
    FALLOFF: (0.0, 20.0),
    BLUR: (0.0, 20.0),
}


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Photometry:
    """Result of a fit of levels, with the prediction of each image."""

    solution: Solution
    predictions: tuple[Prediction, ...]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Case:
    """Inputs of one run of the fit."""

    sensor: Sensor
    images: tuple[CapturedImage, ...]
    names: tuple[str, ...]  # Free parameters, in order.
    values: Mapping[str, float]  # Initial values of all parameters, free or fixed.
    means: bool  # Whether only mean levels of tiles are compared.
    formed: LevelsCache  # Mutable cache.


def fit_photometry(
    observations: Sequence[Observation],
    sensor: Sensor,
    *,
    layers: Mapping[str, Layers] | None = None,
    free: Sequence[str] = PARAMETERS,
    track: progress.Progress = progress.silent,
) -> Photometry:
    """Fit levels to captures with calibrated geometry.

    Both imagers share all parameters except the black level. The reflectance of each tile of 16 px
    is free. Standard deviations allow for correlated errors within clusters of the image
    (`tiles.clusters`).

    Args:
        observations: scenes with images and a surface. Without a recorded exposure and with auto
            exposure on, the ratio of the exposures with projector off and on is free.
        sensor: sensor with geometry, projector, pattern, noise and all fixed parameters.
        layers: layers rendered with this sensor, by scene; missing ones are rendered.
        free: names in `PARAMETERS`.
        track: progress callback around the simulations.

    Returns:
        Estimates, with one ambient irradiance for each scene. An unidentifiable parameter keeps
        its initial value with an infinite deviation, and a sentence gives the reason.

    Raises:
        InputError: if a name in `free` is unknown, gamma is not 1, or no image is usable.
    """
    for name in free:
        errors.one_of("free", name, PARAMETERS)
    _refuse_gamma(sensor)
    images = light_model.images(track(observations, "levels"), sensor, layers or {})
    if not images:
        raise errors.refuse(
            "captures",
            "must hold a scene with infrared images and a surface",
            ", ".join(observation.name for observation in observations) or "none",
            "Add images, and truth.png or a posed mesh in scene.toml.",
        )
    means = not light_model.dots_match(images)
    case = _case(images, sensor, free, means=means)
    values, equations, costs = _run(case)
    if _black_is_open(case, values, equations):
        case = _case(images, sensor, [name for name in free if name != LEFT_BLACK], means=means)
        values, equations, costs = _run(case)
    return Photometry(
        solution=_solution(case, values, equations, costs, free),
        predictions=tuple(
            prediction.predict(image, values, sensor, case.formed, dots=not means)
            for image in images
        ),
    )


def fit_exposure_level(observations: Sequence[Observation], sensor: Sensor) -> Solution | None:
    """Average the mean level of the left images, projector on, over scenes.

    It counts the part of the image that the sensor meters (`imager.auto_exposure_roi`). Scenes
    that are too dark for the longest exposure bias the result downwards.

    Args:
        observations: scenes with infrared images.
        sensor: sensor in which to set the level of both imagers.

    Returns:
        The level over full scale and the standard error of its mean over scenes. None if the
        exposure is fixed, or if there are fewer than two scenes.
    """
    if sensor.left.auto_exposure_level == 0:
        return None
    roi = sensor.left.auto_exposure_roi
    means_dn = [
        float(observation.left[metered_rows_columns(observation.left.shape, roi)].mean())
        for observation in observations
        if observation.left is not None
    ]
    if len(means_dn) < _LEAST_SCENES:
        return None
    shares = np.array(means_dn) / sensor.left.ceiling_dn
    level, spread = float(shares.mean()), float(shares.std(ddof=1))
    deviation = spread / np.sqrt(len(shares))
    return Solution(
        estimates=(
            Estimate(
                name=EXPOSURE_LEVEL,
                value=level,
                sd=deviation,
                unit="1",
                start=sensor.left.auto_exposure_level,
            ),
        ),
        covariance=np.array([[deviation**2]]),
        undetermined=(),
        cost=(),
        sensor=with_values(sensor, [("imager.auto_exposure_level", level)]),
    )


def _black_is_open(
    case: _Case, values: Mapping[str, float], equations: tiles.ClusterEquations
) -> bool:
    """Return whether a fitted black level is confounded with ambient light.

    Codes begin at 0. A fit below it took light between the dots, such as haze that differs between
    surfaces, for a black level.
    """
    deviation = np.sqrt(np.diagonal(equations.covariance()))
    return any(
        name in (LEFT_BLACK, RIGHT_BLACK) and (sd > BLACK_DN or values[name] < 0)
        for name, sd in zip(case.names, deviation, strict=True)
    )


def _refuse_gamma(sensor: Sensor) -> None:
    for side, imager in (("left", sensor.left), ("right", sensor.right)):
        if imager.gamma != 1:
            raise errors.refuse(
                f"{side}.gamma",
                "must be 1 to fit levels",
                imager.gamma,
                "Stream raw levels, or undo the tone curve and set gamma to 1.",
            )


def _case(
    images: tuple[CapturedImage, ...], sensor: Sensor, free: Sequence[str], *, means: bool
) -> _Case:
    """Select the identifiable parameters and their initial values."""
    scenes = sorted({image.scene for image in images})
    strengths = {image.scene: image.ambient_w_m2 for image in images}
    values = light_model.start(sensor, strengths)
    for image in images:  # Apart from noise, no pixel is darker than black level and dark current.
        name = light_model.black_name(image.side)
        values[name] = min(values[name], image.lowest_dn)
    fixed = [*_KEPT, *((HAZE, BLUR) if means else ())]
    fixed += [HAZE] if sensor.projector.haze == 1 else []  # Haze of 1 means no dots.
    names = [name for name in _COMMON if name in free and name not in fixed]
    if LEFT_BLACK in free and any(image.side == "right" for image in images):
        names.append(RIGHT_BLACK)
    exposure_known = all(image.exposure_known for image in images)
    pairs = {(image.scene, image.on) for image in images}
    for scene in scenes:
        if AMBIENT in free and (scene, True) in pairs:
            names.append(ambient(scene))
        if not exposure_known and {(scene, True), (scene, False)} <= pairs:
            names.append(exposure_ratio(scene))
    return _Case(
        sensor=sensor, images=images, names=tuple(names), values=values, means=means, formed={}
    )


def _run(case: _Case) -> tuple[dict[str, float], tiles.ClusterEquations, list[float]]:
    """Run Gauss-Newton steps; weights and blur are updated with the model."""
    values, costs = dict(case.values), []
    equations = _equations(case, values)
    for _ in range(_ROUNDS):
        costs.append(equations.cost)
        step = equations.step()
        for name, change in zip(case.names, step, strict=True):
            values[name] = _limited(name, values[name], float(change))
        equations = _equations(case, values)
        deviation = np.sqrt(np.diagonal(equations.covariance()))
        if np.all(np.abs(step) <= _STILL * deviation + 1e-9):
            break
    return values, equations, [*costs, equations.cost]


def _limited(name: str, value: float, change: float) -> float:
    """Apply a change within the parameter's limits and the range of linearity."""
    if name == BLUR:
        change = float(np.clip(change, -0.3, 0.3))
    if name.startswith(("exposure_ratio", "scene.ambient")):
        value = max(value, _LEAST)
        change = float(np.clip(change, -value / 2, value))
    low, high = _LIMITS.get(name, (-np.inf, np.inf))
    return float(np.clip(value + change, low, high))


def _equations(case: _Case, values: Mapping[str, float]) -> tiles.ClusterEquations:
    """Return the normal equations of all images at the given values."""
    groups: dict[tuple[str, str], list[NDArray]] = {}
    counts: dict[tuple[str, str], NDArray] = {}
    light_model.evict(case.formed, values[BLUR])
    for image in case.images:
        column = light_model.columns(image, values, case.sensor, case.names, case.formed)
        residual = light_model.above_black(image, values)
        factor = prediction.tile_factor(image, residual, column.model, around=_AROUND)
        weight = prediction.weight(image, column, factor)
        if not case.means:
            misfit = prediction.dots_misfit(image, residual, column, weight)
            weight = prediction.weight(image, column, factor, misfit=misfit)
        bases = [column.model]
        if not case.means:
            bases += [column.model * ramp for ramp in tiles.ramps(image.level.shape)]
        gram = tiles.grams([residual, *bases, *column.derivatives], weight, means=case.means)
        pixels = (tiles.cut_tiles(weight) > 0).sum(axis=1) * (gram[:, 1, 1] > 0)
        key = (image.scene, image.side)
        groups.setdefault(key, []).append(gram)
        counts[key] = counts.get(key, 0) + (pixels > 0 if case.means else pixels)
    scenes = sorted({scene for scene, _ in groups})
    grams, sizes, cluster, offset = [], [], [], 0
    for scene in scenes:
        number = tiles.clusters(case.images[0].level.shape)
        for side in ("left", "right"):
            if (scene, side) in groups:
                gram = np.sum(groups[scene, side], axis=0)
                grams.append(_jacobian(gram, case, side))
                sizes.append(counts[scene, side])
                cluster.append(number + offset)
        offset += int(number.max()) + 1
    return tiles.sum_clusters(np.concatenate(grams), np.concatenate(sizes), np.concatenate(cluster))


def _jacobian(gram: NDArray, case: _Case, side: str) -> NDArray:
    """Convert products of level and model to those of residual and Jacobian.

    The reflectance c is eliminated. It does not scale the column of the black level.
    """
    inner, factor = tiles.eliminate(gram, gram.shape[1] - 1 - len(case.names))
    scale = np.repeat(factor[:, None], inner.shape[1], axis=1)
    scale[:, 0] = 1.0
    for number, name in enumerate(case.names):
        if name in (LEFT_BLACK, RIGHT_BLACK):
            scale[:, 1 + number] = 1.0
    return inner * scale[:, :, None] * scale[:, None, :]


def _solution(
    case: _Case,
    values: Mapping[str, float],
    equations: tiles.ClusterEquations,
    costs: list[float],
    free: Sequence[str],
) -> Solution:
    """Return the solution; a requested parameter that was not fitted has an infinite deviation."""
    names = [name for name in case.names if not name.startswith("exposure_ratio")]
    held = [name for name in _COMMON if name in free and name not in names]
    rows = [case.names.index(name) for name in names]
    covariance = np.diag(np.full(len(names) + len(held), np.inf))
    covariance[: len(names), : len(names)] = equations.covariance()[np.ix_(rows, rows)]
    deviation = np.sqrt(np.diagonal(covariance))
    estimates = tuple(
        Estimate(
            name=name,
            value=values[name],
            sd=float(sd),
            unit="W m^-2" if "irradiance" in name else _UNITS.get(name, "1"),
            start=case.values[name],
        )
        for name, sd in zip([*names, *held], deviation, strict=True)
    )
    open_sentences = sentences(
        estimates,
        covariance,
        images=case.images,
        power_w=values[POWER],
        means=case.means,
    )
    return Solution(
        estimates=estimates,
        covariance=covariance,
        undetermined=open_sentences,
        cost=tuple(costs),
        sensor=_fitted(case.sensor, values),
        scenes={
            image.scene: {
                "ambient_w_m2": values[ambient(image.scene)],
                "mean_level_dn": float(image.level.mean()),
                "lower_envelope_dn": levels.lower_envelope_dn(image.level),
            }
            for image in reversed(case.images)
        },
    )


def _fitted(sensor: Sensor, values: Mapping[str, float]) -> Sensor:
    """Set the fitted values; both imagers share the lens parameters."""
    edits = {name: values[name] for name in (POWER, HAZE, FALLOFF)}
    edits |= {name.replace("left", "imager"): values[name] for name in (VIGNETTING, BLUR)}
    edits |= {name: max(values[name], 0.0) for name in (LEFT_BLACK, RIGHT_BLACK)}
    return with_values(sensor, list(edits.items()))
