"""Recover a projector's pattern from captures of known surfaces, with where its emitters stand.

First as an image, by least squares. Where its spectrum shows lattices, each is an emitter's and is
fitted itself; else image, place and scales are solved in turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from starling.calibration.pattern import emitter_model, image_recovery, lattice, pattern_fit
from starling.calibration.pattern.emission import Alignment
from starling.calibration.pattern.emitter_model import Emission, Model
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.modulation import Modulation
from starling.calibration.pattern.pattern_fit import Fitted
from starling.calibration.pattern.unprojected import PatternImage
from starling.calibration.pattern.views import View
from starling.patterns import errors
from starling.sim.console import progress
from starling.sim.sensor.sensor import Sensor

_ROUNDS = 8  # Of place and image in turn, at most: from 3 mm off, the last moves 1e-5 m.
_ROUNDS_AGAIN = 3
_SCALES = np.arange(-6e-3, 6.01e-3, 5e-4)  # Pattern scales less 1 that a scene may begin from.
_EVERY_PX = 3  # Pixels between those that a scale is looked for on.


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
    views: Sequence[View], sensor: Sensor, *, track: progress.Progress = progress.silent
) -> Recovered:
    """Recover the pattern that some views show.

    Args:
        views: of lit surfaces that are known.
        sensor: whose projector's place and field are believed at first.
        track: wraps the loop over steps.

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
    seen = image_recovery.modulations(views, sensor)
    image = image_recovery.image(views, sensor, start, position, seen)
    lattices = lattice.find(image)
    if lattices:
        emitters = tuple(Emission(position_m=position, source=found) for found in lattices)
        return Recovered(
            fitted=pattern_fit.fit(views, sensor, replace(start, emitters=emitters)), image=image
        )
    model = replace(start, emitters=(Emission(position_m=position, source=image),))
    return _of_image(image_recovery.settled(views, sensor, model, rounds=_ROUNDS, track=track))


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
        found = _of_image(image_recovery.settled(views, sensor, model, rounds=_ROUNDS_AGAIN))
    both = before.alignment.as_vector() + found.model.alignment.as_vector()
    whole = replace(found.model, alignment=Alignment.of(both))
    return replace(found, fitted=replace(found.fitted, model=whole))


def _of_image(fitted: Fitted) -> Recovered:
    (emitter,) = fitted.model.emitters
    assert isinstance(emitter.source, PatternImage)
    return Recovered(fitted=fitted, image=emitter.source)


def scene_scale(views: Sequence[View], sensor: Sensor, model: Model) -> float:
    """Pattern scale at which a scene shows a recovered pattern: one number, all else held.

    Args:
        views: of one scene.
        sensor: of the captures.
        model: recovered from other scenes.
    """
    modulated = image_recovery.modulations(views, sensor)
    scores = [
        sum(_agreement(view, modulated[id(view)], sensor, model, 1 + off) for view in views)
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


def _agreement(
    view: View, modulated: Modulation, sensor: Sensor, model: Model, scale: float
) -> float:
    """Correlation of a view with what a model lays on it at one scale, up to a factor."""
    seen = pattern_fit.seen_of(view, sensor, _EVERY_PX)
    laid = np.sum([one.light for one in emitter_model.lay(seen, model, scale)], axis=0)
    every = (slice(None, None, _EVERY_PX), slice(None, None, _EVERY_PX))
    usable = modulated.weight[every].ravel() > 0
    return float(np.corrcoef(modulated.value[every].ravel()[usable], laid[usable])[0, 1])
