"""Fit image levels: projector power, ambient light, black level, vignetting and falloff.

level = b + d + c V^n (P F^k ((1 - h) D + h E) + I A + O)

b is the black level, d the mean dark current of the sensor, c the relative reflectance. V and F
are the off-axis cosines of lens and projector, P is the power, h the haze, I the ambient
irradiance. The geometry gives the layers D (dots), E (uniform projector light), A and O.

Power, exposure time, gain, quantum efficiency and lens transmission have the same effect. The fit
changes only power.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration.least_squares import tiles
from starling.calibration.observation import Observation
from starling.calibration.photometry import levels, light_model, prediction, weights
from starling.calibration.photometry.light_model import (
    AMBIENT,
    BLUR,
    FALLOFF,
    HAZE,
    LEFT_BLACK,
    POWER,
    RIGHT_BLACK,
    RIGHT_GAIN,
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
from starling.sim.imaging.imager.exposure import Exposure
from starling.sim.render.layers import Layers
from starling.sim.sensor import edits as sensor_edits
from starling.sim.sensor.sensor import Sensor

PARAMETERS = (POWER, AMBIENT, LEFT_BLACK, HAZE, VIGNETTING, FALLOFF, BLUR)
"""Names for `free`; the left black level also frees the right imager's black level and gain."""
_COMMON = tuple(name for name in PARAMETERS if name != AMBIENT)  # Common to all scenes.

_ROUNDS = 10  # Maximum number of steps.
# Radius in tiles of the mean reflectance in a tile's weights. The reflectance of a single tile
# would correlate its weight with its noise.
_AROUND = 2
_STILL = 1e-3  # Step below which the fit ends [standard deviations].
_SCATTER = 0.04  # Relative scatter of reflectance above which the given one is rejected.
_UNITS = {
    POWER: "W",
    LEFT_BLACK: "DN",
    RIGHT_BLACK: "DN",
    BLUR: "px",
}
_LEAST = 1e-6  # Lower limit of positive parameters.
_LIMITS = {
    POWER: (_LEAST, 10.0),
    VIGNETTING: (0.0, 20.0),
    HAZE: (0.0, 0.95),
    FALLOFF: (0.0, 20.0),
    BLUR: (0.0, 20.0),
    RIGHT_GAIN: (1e-3, 1e3),
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
    eliminate: bool  # Whether the reflectance of each tile is free.
    means: bool  # Whether only mean levels of tiles are compared.
    formed: LevelsCache  # Mutable cache.


def fit_photometry(
    observations: Sequence[Observation],
    sensor: Sensor,
    *,
    layers: Mapping[str, Layers] | None = None,
    exposures: Mapping[str, Exposure] | None = None,
    reflectance_known: bool = False,
    free: Sequence[str] = PARAMETERS,
) -> Photometry:
    """Fit levels to captures with calibrated geometry.

    Both imagers share all parameters except black level and gain. Standard deviations allow for
    correlated errors within clusters of the image (`tiles.clusters`).

    Args:
        observations: scenes with images and a surface.
        sensor: sensor with geometry, projector, pattern, noise and all fixed parameters.
        layers: layers rendered with this sensor, by scene; missing ones are rendered.
        exposures: recorded exposures, by scene. Without a recorded exposure and with auto
            exposure on, the exposure of each image is free.
        reflectance_known: whether the reflectances of the surfaces are absolute. Otherwise, or if
            they are inconsistent, each tile of 16 px has a free factor. A common error of all
            reflectances is not visible in the images and affects power and ambient irradiance.
        free: names in `PARAMETERS`.

    Returns:
        Estimates, with one ambient irradiance for each scene. An unidentifiable parameter keeps
        its initial value with an infinite deviation, and a sentence gives the reason.

    Raises:
        InputError: if a name in `free` is unknown, gamma is not 1, or no image is usable.
    """
    for name in free:
        errors.one_of("free", name, PARAMETERS)
    _refuse_gamma(sensor)
    images = light_model.images(observations, sensor, layers or {}, exposures or {})
    if not images:
        raise errors.refuse(
            "observations",
            "must have an image and a surface",
            ", ".join(observation.name for observation in observations) or "none",
            "Give truth.png or scene.toml.",
        )
    means = not light_model.dots_match(images)
    case = _case(images, sensor, free, eliminate=not reflectance_known, means=means)
    values, equations, costs = _run(case)
    scatter = None
    if reflectance_known:
        scatter = _scatter(case, values)
        if scatter > _SCATTER:
            case = _case(images, sensor, free, eliminate=True, means=means)
            values, equations, costs = _run(case)
    if _black_is_open(case, equations):
        reduced = [name for name in free if name != LEFT_BLACK]
        case = _case(images, sensor, reduced, eliminate=case.eliminate, means=means)
        values, equations, costs = _run(case)
    solution = _solution(case, values, equations, costs, free, scatter)
    return Photometry(solution=solution, predictions=_predictions(case, values))


def _black_is_open(case: _Case, equations: tiles.ClusterEquations) -> bool:
    """Return whether a fitted black level is confounded with ambient light."""
    deviation = np.sqrt(np.diagonal(equations.covariance()))
    return any(
        name in (LEFT_BLACK, RIGHT_BLACK) and sd > BLACK_DN
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
    images: tuple[CapturedImage, ...],
    sensor: Sensor,
    free: Sequence[str],
    *,
    eliminate: bool,
    means: bool,
) -> _Case:
    """Select the identifiable parameters and their initial values."""
    scenes = sorted({image.scene for image in images})
    strengths = {image.scene: image.ambient_w_m2 for image in images}
    values = light_model.start(sensor, strengths)
    for image in images:  # Apart from noise, no pixel is darker than black level and dark current.
        name = light_model.black_name(image.side)
        values[name] = min(values[name], image.lowest_dn)
    names = [name for name in _COMMON if name in free]
    exposure_known = all(image.exposure_known for image in images)
    if eliminate or not exposure_known:
        names = [name for name in names if name != POWER]
    if eliminate:
        names = [name for name in names if name != VIGNETTING]
    if means:
        names = [name for name in names if name not in (HAZE, BLUR)]
    if sensor.projector.haze == 1:  # Haze of 1 means no dots.
        names = [name for name in names if name != HAZE]
    if any(image.side == "right" for image in images):
        names += [RIGHT_BLACK] if LEFT_BLACK in free else []
        names += [] if eliminate else [RIGHT_GAIN]
    pairs = {(image.scene, image.on) for image in images}
    for scene in scenes:
        has_both = {(scene, True), (scene, False)} <= pairs
        if AMBIENT in free and ((scene, True) in pairs or not eliminate):
            names.append(ambient(scene))
        if not exposure_known:
            names += [exposure_ratio(scene, on=False)] if has_both else []
            names += [] if eliminate else [exposure_ratio(scene, on=True)]
    return _Case(
        sensor=sensor,
        images=images,
        names=tuple(names),
        values=values,
        eliminate=eliminate,
        means=means,
        formed={},
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
    if name.startswith(("exposure_ratio", "scene.ambient")) or name == POWER:
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
        residual = light_model.above_black(image, values, case.sensor)
        factor = weights.tile_factor(image, residual, column.model, around=_AROUND)
        reflectance = factor if case.eliminate else None
        weight = weights.weight(image, column, reflectance)
        if not case.means:
            misfit = weights.dots_misfit(image, residual, column, weight)
            weight = weights.weight(image, column, reflectance, misfit=misfit)
        bases = [column.model]
        if case.eliminate and not case.means:
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

    The reflectance c is eliminated or 1. It does not scale the column of the black level.
    """
    if case.eliminate:
        inner, factor = tiles.eliminate(gram, gram.shape[1] - 1 - len(case.names))
    else:
        change = np.eye(gram.shape[1])
        change[1, 0] = -1.0  # Residual = level - black - model.
        transformed = change.T @ gram @ change
        inner, factor = np.delete(np.delete(transformed, 1, 1), 1, 2), np.ones(len(gram))
    scale = np.repeat(factor[:, None], inner.shape[1], axis=1)
    scale[:, 0] = 1.0
    for number, name in enumerate(case.names):
        if name in (LEFT_BLACK, RIGHT_BLACK):
            scale[:, 1 + number] = 1.0
    return inner * scale[:, :, None] * scale[:, None, :]


def _scatter(case: _Case, values: Mapping[str, float]) -> float:
    """Return the scatter of the tiles' relative reflectance, in excess of noise."""
    logs, noises = [], []
    for image in case.images:
        column = light_model.columns(image, values, case.sensor, (), case.formed)
        residual = light_model.above_black(image, values, case.sensor)
        weight = weights.weight(image, column, None)
        gram = tiles.grams([residual, column.model], weight, means=case.means)
        used = gram[:, 1, 1] > 0
        factor = gram[used, 0, 1] / gram[used, 1, 1]
        logs.append(np.log(np.maximum(factor, 1e-3)))
        noises.append(1 / gram[used, 1, 1])
    log, noise = np.concatenate(logs), np.concatenate(noises)
    robust = 1.4826 * np.median(np.abs(log - np.median(log)))
    tail = (np.quantile(log, 0.95) - np.quantile(log, 0.05)) / 3.29
    return float(np.sqrt(max(max(robust, tail) ** 2 - np.median(noise), 0.0)))


def _predictions(case: _Case, values: Mapping[str, float]) -> tuple[Prediction, ...]:
    return tuple(
        prediction.predict(
            image,
            values,
            case.sensor,
            case.formed,
            reflectance_free=case.eliminate,
            dots=not case.means,
        )
        for image in case.images
    )


def _solution(
    case: _Case,
    values: Mapping[str, float],
    equations: tiles.ClusterEquations,
    costs: list[float],
    free: Sequence[str],
    scatter: float | None,
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
        values=values,
        eliminate=case.eliminate,
        means=case.means,
        scatter=scatter,
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
    edits[RIGHT_GAIN] = values[RIGHT_GAIN]
    return sensor_edits.with_values(sensor, list(edits.items()))
