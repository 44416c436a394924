"""Recover a projector's pattern and the positions of its emitters from captures.

The pattern is first recovered as an image, by least squares. If its spectrum shows lattices, each
lattice belongs to one emitter and is fitted directly. Otherwise image, position and scales are
solved alternately.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from starling.calibration.pattern import emitter_model, image_recovery, lattice, pattern_fit
from starling.calibration.pattern.emission import RightAlignment
from starling.calibration.pattern.emitter_model import EmitterModel, PatternEmitter
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.pattern_fit import PatternFit
from starling.calibration.pattern.unprojected import PatternImage
from starling.calibration.pattern.views import Modulation, PatternView
from starling.patterns import errors
from starling.sim.console import progress
from starling.sim.sensor.sensor import Sensor

# Maximum rounds of position and image. After an initial error of 3 mm, the last moves 1e-5 m.
_ROUNDS = 8
_ROUNDS_AGAIN = 3
_SCALES = np.arange(-6e-3, 6.01e-3, 5e-4)  # Grid of initial pattern scales, minus 1.
_EVERY_PX = 3  # Sampling step of the search for a scale.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RecoveredPattern:
    """A pattern with its emitters, and its image."""

    fitted: PatternFit
    image: PatternImage  # As from one emitter at the projector's position, at the mean scale.

    @property
    def model(self) -> EmitterModel:
        """The fitted model."""
        return self.fitted.model

    @property
    def lattices(self) -> tuple[Lattice, ...]:
        """The emitters' lattices; empty if the pattern is an image."""
        sources = [emitter.source for emitter in self.fitted.model.emitters]
        return tuple(source for source in sources if isinstance(source, Lattice))


def recover(
    views: Sequence[PatternView], sensor: Sensor, *, track: progress.Progress = progress.silent
) -> RecoveredPattern:
    """Recover the pattern from views.

    Args:
        views: views of known surfaces with the projector on.
        sensor: initial sensor, with the projector's position and field.
        track: progress callback around the loop over steps.

    Raises:
        InputError: if no view shows a part of the projector's field.
    """
    if not any(view.usable.any() for view in views):
        raise errors.refuse(
            "captures",
            "must show surfaces that the projector lights",
            "none",
            "Check its position.",
        )
    scenes = dict.fromkeys((view.scene for view in views), 1.0)
    start = EmitterModel(
        emitters=(),
        rotation_deg=sensor.projector.rotation_deg,
        scales=scenes,
    )
    position = np.asarray(sensor.projector.position_m, np.float64)
    modulated = image_recovery.modulations(views, sensor)
    image = image_recovery.solve_image(views, sensor, start, position, modulated)
    lattices = lattice.find(image)
    if lattices:
        emitters = tuple(
            PatternEmitter(position_m=position, source=lattice_source)
            for lattice_source in lattices
        )
        return RecoveredPattern(
            fitted=pattern_fit.fit(views, sensor, replace(start, emitters=emitters)), image=image
        )
    model = replace(start, emitters=(PatternEmitter(position_m=position, source=image),))
    return _from_image_fit(
        image_recovery.fit_image(views, sensor, model, rounds=_ROUNDS, track=track)
    )


def refine(
    recovered: RecoveredPattern, views: Sequence[PatternView], sensor: Sensor
) -> RecoveredPattern:
    """Repeat the fit on views that use the recovered alignment of the right image.

    The first fit shifts the right image at constant depth of each pixel. On a slanted surface
    this has an error of shift times slope. With aligned views, almost no shift remains.

    Args:
        recovered: result of `recover`.
        views: views of the same scenes by `sensor`.
        sensor: sensor with the recovered alignment (`pattern_sensor.with_alignment`).

    Returns:
        The refined pattern; its alignment refers to the initial sensor of `recover`.
    """
    before = recovered.model
    model = replace(before, alignment=RightAlignment())
    if recovered.lattices:
        refined = replace(recovered, fitted=pattern_fit.fit(views, sensor, model))
    else:
        refined = _from_image_fit(
            image_recovery.fit_image(views, sensor, model, rounds=_ROUNDS_AGAIN)
        )
    total = before.alignment.as_vector() + refined.model.alignment.as_vector()
    model_with_total = replace(refined.model, alignment=RightAlignment.from_vector(total))
    return replace(refined, fitted=replace(refined.fitted, model=model_with_total))


def _from_image_fit(fitted: PatternFit) -> RecoveredPattern:
    (emitter,) = fitted.model.emitters
    assert isinstance(emitter.source, PatternImage)
    return RecoveredPattern(fitted=fitted, image=emitter.source)


def scene_scale(views: Sequence[PatternView], sensor: Sensor, model: EmitterModel) -> float:
    """Estimate the pattern scale of a scene, with all other parameters fixed.

    Args:
        views: views of one scene.
        sensor: sensor of the captures.
        model: model recovered from other scenes.
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
        only=(emitter_model.scene_scale_name(name),),
    )
    return fitted.model.scales[name]


def _agreement(
    view: PatternView, modulated: Modulation, sensor: Sensor, model: EmitterModel, scale: float
) -> float:
    """Return the correlation of a view with the model's light at one scale."""
    surface = pattern_fit.surface_points(view, sensor, _EVERY_PX)
    light = np.sum(
        [emitter_light.light for emitter_light in emitter_model.illuminate(surface, model, scale)],
        axis=0,
    )
    sparse = (slice(None, None, _EVERY_PX), slice(None, None, _EVERY_PX))
    usable = modulated.weight[sparse].ravel() > 0
    return float(np.corrcoef(modulated.value[sparse].ravel()[usable], light[usable])[0, 1])
