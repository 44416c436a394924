"""Fit what makes levels: projector power, ambient light, black level, darkening off the axes.

level = b + d + c V^n (P F^k ((1 - h) D + h E) + I A + O): black level b, dark current's mean d as
the sensor has it, relative reflectance c, lens's and projector's cosines V and F, power P, haze h,
ambient irradiance I, and the layers D (dots), E (the projector's light spread evenly), A, O that
the geometry gives.
Power, exposure time, gain, quantum efficiency and lens transmission are one family: power is
fitted, the others stay.
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
    Formed,
    Image,
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
"""What `free` may name; the right imager's black level and gain go with the left's black level."""
_COMMON = tuple(name for name in PARAMETERS if name != AMBIENT)  # To all scenes.

_ROUNDS = 10
# Tiles whose mean reflectance sets a tile's weights: by its own, a tile that noise has brightened
# would count less.
_AROUND = 2
_STILL = 1e-3  # Share of the deviation below which a step ends the fit.
_SCATTER = 0.04  # Scatter of tiles' reflectance, over the given, above which it is not believed.
_UNITS = {
    POWER: "W",
    LEFT_BLACK: "DN",
    RIGHT_BLACK: "DN",
    BLUR: "px",
}
_LEAST = 1e-6  # Of what is positive.
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
    """Where a fit of levels ended, and what it says each image should be."""

    solution: Solution
    predictions: tuple[Prediction, ...]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Case:
    """What one run of the fit may move."""

    sensor: Sensor
    images: tuple[Image, ...]
    names: tuple[str, ...]  # Free, in order.
    values: Mapping[str, float]  # Of all parameters, free or not.
    eliminate: bool  # Whether each tile's reflectance is free.
    means: bool  # Whether tiles' mean levels alone are compared.
    formed: Formed  # Changes as the fit goes on.


def fit_photometry(
    observations: Sequence[Observation],
    sensor: Sensor,
    *,
    layers: Mapping[str, Layers] | None = None,
    exposures: Mapping[str, Exposure] | None = None,
    reflectance_known: bool = False,
    free: Sequence[str] = PARAMETERS,
) -> Photometry:
    """Fit levels to captures whose geometry is right.

    Both imagers are taken as one part, but for black level and gain. Deviations are robust
    against errors that go together within 64 px of the image.

    Args:
        observations: with images and a surface.
        sensor: its geometry, projector, pattern, noise and all that is not free.
        layers: rendered with this sensor, by scene; those missing are rendered.
        exposures: what the camera recorded, by scene. Without, and with auto exposure on, each
            image has an exposure of its own.
        reflectance_known: whether the surfaces' reflectances are right on an absolute scale.
            If not, or if they prove to contradict each other, each tile of 16 px has a factor of
            its own. A factor that all of them are wrong by is nowhere in the images: power and
            ambient irradiance are then off by it.
        free: what to fit, of `PARAMETERS`.

    Returns:
        Estimates, one ambient irradiance for each scene; of what is not determined the start with
        an infinite deviation, and a sentence that says why.

    Raises:
        InputError: an unknown name in `free`, gamma, or nothing to look at.
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
        less = [name for name in free if name != LEFT_BLACK]
        case = _case(images, sensor, less, eliminate=case.eliminate, means=means)
        values, equations, costs = _run(case)
    solution = _solution(case, values, equations, costs, free, scatter)
    return Photometry(solution=solution, predictions=_predictions(case, values))


def _black_is_open(case: _Case, equations: tiles.Normal) -> bool:
    """Whether a black level was fitted that the captures do not tell from ambient light."""
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
    images: tuple[Image, ...],
    sensor: Sensor,
    free: Sequence[str],
    *,
    eliminate: bool,
    means: bool,
) -> _Case:
    """Choose what can be moved at all, and where everything starts."""
    scenes = sorted({image.scene for image in images})
    strengths = {image.scene: image.ambient_w_m2 for image in images}
    values = light_model.start(sensor, strengths)
    for image in images:  # No pixel is darker than black and dark current, but for noise.
        name = light_model.black_name(image.side)
        values[name] = min(values[name], image.lowest_dn)
    names = [name for name in _COMMON if name in free]
    exposed = all(image.exposure_known for image in images)
    if eliminate or not exposed:
        names = [name for name in names if name != POWER]
    if eliminate:
        names = [name for name in names if name != VIGNETTING]
    if means:
        names = [name for name in names if name not in (HAZE, BLUR)]
    if sensor.projector.haze == 1:  # Where no dots are, nothing stands out.
        names = [name for name in names if name != HAZE]
    if any(image.side == "right" for image in images):
        names += [RIGHT_BLACK] if LEFT_BLACK in free else []
        names += [] if eliminate else [RIGHT_GAIN]
    pairs = {(image.scene, image.on) for image in images}
    for scene in scenes:
        both = {(scene, True), (scene, False)} <= pairs
        if AMBIENT in free and ((scene, True) in pairs or not eliminate):
            names.append(ambient(scene))
        if not exposed:
            names += [exposure_ratio(scene, on=False)] if both else []
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


def _run(case: _Case) -> tuple[dict[str, float], tiles.Normal, list[float]]:
    """Gauss-Newton; noise and blur follow the model."""
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
    """Step without leaving what is possible, or what the step was linear over."""
    if name == BLUR:
        change = float(np.clip(change, -0.3, 0.3))
    if name.startswith(("exposure_ratio", "scene.ambient")) or name == POWER:
        value = max(value, _LEAST)
        change = float(np.clip(change, -value / 2, value))
    low, high = _LIMITS.get(name, (-np.inf, np.inf))
    return float(np.clip(value + change, low, high))


def _equations(case: _Case, values: Mapping[str, float]) -> tiles.Normal:
    """Normal equations of all images at these values."""
    groups: dict[tuple[str, str], list[NDArray]] = {}
    counts: dict[tuple[str, str], NDArray] = {}
    light_model.forget(case.formed, values[BLUR])
    for image in case.images:
        column = light_model.columns(image, values, case.sensor, case.names, case.formed)
        residual = light_model.above_black(image, values, case.sensor)
        factor = weights.tile_factor(image, residual, column.model, around=_AROUND)
        given = factor if case.eliminate else None
        weight = weights.weight(image, column, given)
        if not case.means:
            misfit = weights.dots_misfit(image, residual, column, weight)
            weight = weights.weight(image, column, given, misfit=misfit)
        bases = [column.model]
        if case.eliminate and not case.means:
            bases += [column.model * ramp for ramp in tiles.ramps(image.level.shape)]
        gram = tiles.grams([residual, *bases, *column.derivatives], weight, means=case.means)
        pixels = (tiles.tiled(weight) > 0).sum(axis=1) * (gram[:, 1, 1] > 0)
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
    return tiles.normal(np.concatenate(grams), np.concatenate(sizes), np.concatenate(cluster))


def _jacobian(gram: NDArray, case: _Case, side: str) -> NDArray:
    """Turn products of level and model into those of residual and Jacobian, c eliminated or 1.

    The black level's column is no model's derivative: it is not scaled by the reflectance.
    """
    if case.eliminate:
        inner, factor = tiles.eliminated(gram, gram.shape[1] - 1 - len(case.names))
    else:
        change = np.eye(gram.shape[1])
        change[1, 0] = -1.0  # Residual = level - black - model.
        moved = change.T @ gram @ change
        inner, factor = np.delete(np.delete(moved, 1, 1), 1, 2), np.ones(len(gram))
    scale = np.repeat(factor[:, None], inner.shape[1], axis=1)
    scale[:, 0] = 1.0
    for number, name in enumerate(case.names):
        if name in (LEFT_BLACK, RIGHT_BLACK):
            scale[:, 1 + number] = 1.0
    return inner * scale[:, :, None] * scale[:, None, :]


def _scatter(case: _Case, values: Mapping[str, float]) -> float:
    """Scatter of the tiles' reflectance over the given, beyond what noise makes."""
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
    seen = 1.4826 * np.median(np.abs(log - np.median(log)))
    tail = (np.quantile(log, 0.95) - np.quantile(log, 0.05)) / 3.29
    return float(np.sqrt(max(max(seen, tail) ** 2 - np.median(noise), 0.0)))


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
    equations: tiles.Normal,
    costs: list[float],
    free: Sequence[str],
    scatter: float | None,
) -> Solution:
    """State values and deviations; what was asked for and not fitted is open."""
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
    open_ = sentences(
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
        undetermined=open_,
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
    """Set what was fitted; both imagers have one lens."""
    edits = {name: values[name] for name in (POWER, HAZE, FALLOFF)}
    edits |= {name.replace("left", "imager"): values[name] for name in (VIGNETTING, BLUR)}
    edits |= {name: max(values[name], 0.0) for name in (LEFT_BLACK, RIGHT_BLACK)}
    edits[RIGHT_GAIN] = values[RIGHT_GAIN]
    return sensor_edits.with_values(sensor, list(edits.items()))
