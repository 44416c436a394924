"""Recover a projector's pattern from captures of known surfaces, with where its emitters stand.

First as an image, by least squares. Where its spectrum shows lattices, each is an emitter's and is
fitted itself; else image, place and scales are solved in turn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.pattern import (
    absorbed,
    emission,
    emitter_model,
    lattice,
    modulation,
    pattern_fit,
    unprojected,
)
from calibration.pattern.absorbed import Absorbed
from calibration.pattern.cosine_image import Grid
from calibration.pattern.emission import Alignment
from calibration.pattern.emitter_model import Emission, Model
from calibration.pattern.lattice import Lattice
from calibration.pattern.modulation import Modulation
from calibration.pattern.pattern_fit import Fitted
from calibration.pattern.unprojected import PatternImage, Placed
from calibration.pattern.views import View
from patterns import errors
from sim import progress
from sim import projector as light
from sim.sensor import Sensor

_ROUNDS = 6  # Of image and place in turn: from 3 mm off, the place moves 1e-5 m in the last.
_ROUNDS_AGAIN = 2
_TEXELS_PER_PIXEL = 0.9  # Of the pattern's image, over the imager's pixels on the axis.
_MARGIN = 1.02  # The grid's extent over the field's.
_SCALES = np.arange(-6e-3, 6.01e-3, 5e-4)  # Pattern scales less 1 that a scene may begin from.
_EVERY_PX = 3  # Pixels between those that a scale is looked for on, and what an image absorbs.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Recovered:
    """A pattern, its emitters, and the image it was first seen as."""

    fitted: Fitted
    image: PatternImage  # As from one emitter at the projector's place, mean scale.

    @property
    def model(self) -> Model:
        """The emitters and all else that was fitted."""
        return self.fitted.model

    @property
    def lattices(self) -> tuple[Lattice, ...]:
        """The emitters' lattices; empty where the pattern is an image."""
        sources = [one.source for one in self.fitted.model.emitters]
        return tuple(source for source in sources if isinstance(source, Lattice))


def recover(
    views: Sequence[View], sensor: Sensor, *, tell: progress.Progress = progress.silent
) -> Recovered:
    """Recover the pattern that some views show.

    Args:
        views: of lit surfaces that are known.
        sensor: whose projector's place and field are believed at first.
        tell: wraps the loop over steps.

    Raises:
        InputError: if no view shows anything of the projector's field.
    """
    if not any(view.usable.any() for view in views):
        raise errors.refuse(
            "captures", "must show surfaces that the projector lights", "none", "Check its place."
        )
    scenes = dict.fromkeys((view.scene for view in views), 1.0)
    start = Model(
        emitters=(),
        rotation_deg=sensor.projector.rotation_deg,
        scales=scenes,
    )
    position = np.asarray(sensor.projector.position_m, np.float64)
    grid = _grid(sensor)
    seen = {id(view): modulation_of(view, sensor) for view in views}
    image = _image(views, sensor, start, position, grid, seen)
    lattices = lattice.find(image)
    if lattices:
        emitters = tuple(Emission(position_m=position, source=found) for found in lattices)
        return Recovered(
            fitted=pattern_fit.fit(views, sensor, replace(start, emitters=emitters)), image=image
        )
    model = replace(start, emitters=(Emission(position_m=position, source=image),))
    recovered = _round(views, sensor, model, seen)
    for _ in tell(range(_ROUNDS - 1), "pattern"):
        recovered = _round(views, sensor, recovered.model, seen)
    return recovered


def again(recovered: Recovered, views: Sequence[View], sensor: Sensor) -> Recovered:
    """Fit once more, to views as the recovered alignment of the right image places them.

    A fit's own move of the right image keeps every pixel's depth; on a slanted surface that errs
    by the move times the slope. Seen anew, next to nothing is left to move.

    Args:
        recovered: from `recover`.
        views: of the same scenes by `sensor`.
        sensor: `pattern_sensor.aligned` by what was recovered.

    Returns:
        What was recovered, its alignment off the sensor that `recover` began from.
    """
    before = recovered.model
    model = replace(before, alignment=Alignment())
    if recovered.lattices:
        found = replace(recovered, fitted=pattern_fit.fit(views, sensor, model))
    else:
        seen = {id(view): modulation_of(view, sensor) for view in views}
        found = replace(recovered, fitted=replace(recovered.fitted, model=model))
        for _ in range(_ROUNDS_AGAIN):
            found = _round(views, sensor, found.model, seen)
    both = before.alignment.as_vector() + found.model.alignment.as_vector()
    whole = replace(found.model, alignment=Alignment.of(both))
    return replace(found, fitted=replace(found.fitted, model=whole))


def _round(
    views: Sequence[View], sensor: Sensor, model: Model, seen: Mapping[int, Modulation]
) -> Recovered:
    """Place the emitter of an image that follows it, then take the image anew from there."""
    (emitter,) = model.emitters
    start = emitter.source
    assert isinstance(start, PatternImage)
    follows = replace(emitter, absorbed=_absorbed(views, sensor, model, start.grid, seen))
    fitted = pattern_fit.fit(views, sensor, replace(model, emitters=(follows,)), steps=1)
    (emitter,) = fitted.model.emitters
    image = _image(views, sensor, fitted.model, emitter.position_m, start.grid, seen, start)
    emitter = replace(emitter, source=image, absorbed=None)
    fitted = replace(fitted, model=replace(fitted.model, emitters=(emitter,)))
    return Recovered(fitted=fitted, image=image)


def _absorbed(
    views: Sequence[View],
    sensor: Sensor,
    model: Model,
    grid: Grid,
    modulated: Mapping[int, Modulation],
) -> Absorbed:
    every = (slice(None, None, _EVERY_PX), slice(None, None, _EVERY_PX))
    parts = []
    for view in views:
        seen = pattern_fit.seen_of(view, sensor, _EVERY_PX)
        (laid,) = emitter_model.lay(seen, model, model.scales[view.scene])
        cosines = np.where(np.isfinite(laid.there.cosines), laid.there.cosines, np.float32(9))
        weight = modulated[id(view)].weight[every].ravel()
        parts.append((cosines, weight, emitter_model.partials(seen, view.scene, laid.there, 0)))
    return absorbed.of(parts, grid)


def scene_scale(views: Sequence[View], sensor: Sensor, model: Model) -> float:
    """Pattern scale at which a scene shows a recovered pattern: one number, all else held.

    Args:
        views: of one scene.
        sensor: of the captures.
        model: recovered from other scenes.
    """
    modulated = [(view, modulation_of(view, sensor)) for view in views]
    scores = [
        sum(_agreement(view, seen, sensor, model, 1 + off) for view, seen in modulated)
        for off in _SCALES
    ]
    scale = 1 + float(_SCALES[int(np.argmax(scores))])
    name = views[0].scene
    fitted = pattern_fit.fit(
        views,
        sensor,
        replace(model, scales={name: scale}),
        only=(emitter_model.of_scene(name),),
    )
    return fitted.model.scales[name]


def modulation_of(view: View, sensor: Sensor) -> Modulation:
    """Take reflectance and level out of a view, as its sensor's noise allows."""
    return modulation.of(
        view,
        dn_per_electron=sensor.left.dn_per_electron,
        black_level_dn=sensor.left.black_level_dn,
    )


def imager_blur_px(sensor: Sensor) -> float:
    """Sigma by which the imager itself widens a dot [px]: lens, pixel and resampling."""
    return float(np.sqrt(sensor.left.lens.blur_px**2 + sensor.left.smoothing_px**2 + 1 / 12))


def _grid(sensor: Sensor) -> Grid:
    half_x, half_y = (_MARGIN * half for half in light.half_tangents(sensor.projector))
    return Grid(
        half_a=half_x / np.hypot(1, half_x),
        half_b=half_y / np.hypot(1, half_y),
        step=1 / (_TEXELS_PER_PIXEL * sensor.fx_px),
    )


def _image(
    views: Sequence[View],
    sensor: Sensor,
    model: Model,
    position: NDArray[np.float64],
    grid: Grid,
    seen: Mapping[int, Modulation],
    start: PatternImage | None = None,
) -> PatternImage:
    """Solve for the pattern as an image, all else as the model has it."""
    placed = []
    for view in views:
        points = pattern_fit.seen_of(view, sensor).moved(model.alignment)
        there = emission.directions(
            points,
            position_m=position,
            rotation_deg=model.rotation_deg,
            scale=model.scales[view.scene],
        )
        cosines = np.where(np.isfinite(there.cosines), there.cosines, np.float32(9))
        placed.append(
            Placed(modulation=seen[id(view)], cosines=cosines, blur_px=imager_blur_px(sensor))
        )
    if start is None:
        return unprojected.solve(placed, grid)
    return unprojected.solve(placed, grid, start=start.value, rounds=1)


def _agreement(
    view: View, modulated: Modulation, sensor: Sensor, model: Model, scale: float
) -> float:
    """Correlation of a view with what a model lays on it at one scale, up to a factor."""
    seen = pattern_fit.seen_of(view, sensor, _EVERY_PX)
    laid = np.sum([one.light for one in emitter_model.lay(seen, model, scale)], axis=0)
    every = (slice(None, None, _EVERY_PX), slice(None, None, _EVERY_PX))
    usable = modulated.weight[every].ravel() > 0
    return float(np.corrcoef(modulated.value[every].ravel()[usable], laid[usable])[0, 1])
