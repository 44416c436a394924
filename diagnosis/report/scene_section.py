"""An example scene in the report: captured, simulated before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from starling.diagnosis.report import pictures
from starling.diagnosis.report.words import SideNames
from starling.diagnosis.scenes.observation import (
    DepthObservation,
    SceneObservation,
    StereoObservation,
)
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.scenes.strata import Image, Strata
from starling.sim.effects.effect import Value
from starling.sim.report.elements import colour_bar, figure, grid, number, percent, prose
from starling.sim.report.pictures import grey_limits

_SEED = 0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SceneImages:
    """Readings of one scene."""

    scene: str
    real: SceneObservation
    # Simulated with the base, or the capture that `real` is compared with.
    before: SceneObservation
    after: SceneObservation | None  # Simulated with effects; None without any.
    strata: Strata


def scene_images(scene_model: SceneModel, settings: Mapping[str, Value]) -> SceneImages:
    """Simulate a scene before and after with common noise.

    Nothing is simulated if two captures are compared.

    Args:
        scene_model: the scene.
        settings: value by effect; if empty, `after` is None.
    """
    if scene_model.against is not None:
        before, after = scene_model.against, None
    else:
        before = scene_model.observe(scene_model.request({}, seed=_SEED))
        effects = scene_model.request(settings, seed=_SEED)
        after = scene_model.observe(effects) if settings else None
    return SceneImages(
        scene=scene_model.name,
        real=scene_model.real,
        before=before,
        after=after,
        strata=scene_model.strata,
    )


def section(
    images: SceneImages,
    sides: SideNames,
    *,
    applied: str,
    held_out: bool,
    tried: bool,
    estimated: bool,
) -> str:
    """Draw a scene's infrared images and disparity errors as HTML.

    Args:
        images: observations of the scene.
        sides: names of the two sides of the gap.
        applied: the effects of `images.after` in words.
        held_out: whether the scene was not used to select effects.
        tried: whether any effect was tried.
        estimated: whether reflectance was estimated from the captured images.
    """
    titled = [(sides.title, images.real), (sides.reference_title, images.before)]
    if images.after is not None:
        titled.append((f"Simulated, {applied}", images.after))
    texts = []
    if tried:
        select = "used to select the effects."
        held = f"This scene is held out: it was not {select}"
        texts.append(held if held_out else f"This scene was {select}")
    if images.after is None and not sides.gap:
        texts.append("No effect is applied, so there is no picture with effects.")
    if estimated:
        texts.append("Its reflectance is estimated from its images, so simulated surfaces blur.")
    return (prose(*texts) if texts else "") + _infrared(titled) + _errors(titled, images.strata)


def _infrared(titled: Sequence[tuple[str, SceneObservation]]) -> str:
    frames = [
        (name, observation.left[0])
        for name, observation in titled
        if isinstance(observation, StereoObservation)
    ]
    paired = isinstance(titled[0][1], StereoObservation)
    note = "" if paired else "No infrared images of it were captured."
    if not frames:
        return prose(note)
    limits = grey_limits(*(frame for _, frame in frames))
    grey = f"{number(limits[0], '.0f')} to {number(limits[1], '.0f')} DN"
    whole = grid(
        (
            figure(
                pictures.infrared(frame, limits),
                f"{name}: left infrared, mean {number(float(frame.mean()), '.1f')} DN",
                alt=f"{name}: left infrared image, mean {frame.mean():.1f} DN.",
            )
            for name, frame in frames
        ),
        columns=3,
    )
    middle = grid(
        (
            figure(
                pictures.infrared(frame, limits, zoomed=True),
                f"{name}: its middle, enlarged",
                alt=f"{name}: middle of the left infrared image, enlarged.",
                sharp=True,
            )
            for name, frame in frames
        ),
        columns=3,
    )
    return (
        (prose(note) if note else "")
        + whole
        + middle
        + prose(f"Common grey scale: black to white is {grey}, by a square root.", quiet=True)
    )


def _errors(titled: Sequence[tuple[str, SceneObservation]], strata: Strata) -> str:
    drawn = []
    for name, observation in titled:
        source = "device depth" if isinstance(observation, DepthObservation) else "our matcher"
        drawn.append(_error(f"{name}, {source}", observation.depth_px[0], strata))
    ends = [f"{number(sign * pictures.ERROR_LIMIT_PX, '+.0f')} px" for sign in (-1, 1)]
    return (
        f'{grid(drawn, columns=3)}<div class="scale">{colour_bar(pictures.scale(), *ends)}'
        "disparity error against the reference; red: too near; dark: no depth; grey: no reference"
        "</div>"
    )


def _error(name: str, disparity_px: Image, strata: Strata) -> str:
    holes = percent(float(np.mean(~np.isfinite(disparity_px[strata.counted]))))
    return figure(
        pictures.errors(disparity_px, strata),
        f"{name}: disparity error; {holes} without depth",
        alt=f"{name}: disparity error, {holes} without depth.",
    )
