"""Report section with pictures of one scene: captured, simulated before and after."""

from __future__ import annotations

import numpy as np

from starling.diagnosis.report import pictures
from starling.diagnosis.report.elements import percent, picture, prose
from starling.diagnosis.report.scene_images import SceneImages
from starling.diagnosis.report.words import SideNames
from starling.diagnosis.scenes.observation import (
    DepthObservation,
    SceneObservation,
    StereoObservation,
)
from starling.diagnosis.scenes.strata import Image
from starling.sim.report.elements import bar, number


def section(images: SceneImages, sides: SideNames, *, held_out: bool, tried: bool) -> str:
    """Draw a scene's infrared images and disparity errors as HTML.

    Args:
        images: observations of the scene.
        sides: names of the two sides of the gap.
        held_out: whether the scene was not used to select effects.
        tried: whether any effect was tried.
    """
    texts = []
    if tried:
        texts.append(f"This scene was {'not ' if held_out else ''}used to select the effects.")
    if images.after is None and not sides.gap:
        texts.append("No accepted effect can be applied, so there is no picture with effects.")
    return (prose(*texts) if texts else "") + _infrared(images, sides) + _errors(images, sides)


def _observations(images: SceneImages, sides: SideNames) -> list[tuple[str, SceneObservation]]:
    pairs = [(sides.title, images.real), (sides.reference_title, images.before)]
    if images.after is None:
        return pairs
    return [*pairs, ("Simulated, accepted effects", images.after)]


def _infrared(images: SceneImages, sides: SideNames) -> str:
    frames = [
        (name, observation.left[0])
        for name, observation in _observations(images, sides)
        if isinstance(observation, StereoObservation)
    ]
    paired = isinstance(images.real, StereoObservation)
    note = "" if paired else "No infrared images of it were captured."
    if not frames:
        return prose(note)
    limits = pictures.levels([frame for _, frame in frames])
    grey = f"{number(limits[0], '.0f')} to {number(limits[1], '.0f')} DN"
    whole = "".join(
        picture(
            pictures.infrared(frame, limits),
            alt=f"{name}: left infrared image, mean {frame.mean():.1f} DN.",
            caption=f"{name}: left infrared, mean {number(float(frame.mean()), '.1f')} DN",
        )
        for name, frame in frames
    )
    middle = "".join(
        picture(
            pictures.infrared(frame, limits, zoomed=True),
            alt=f"{name}: middle of the left infrared image, enlarged.",
            caption=f"{name}: its middle, enlarged",
            sharp=True,
        )
        for name, frame in frames
    )
    return (
        (prose(note) if note else "")
        + f'<div class="threes">{whole}</div><div class="threes">{middle}</div>'
        + prose(f"Common grey scale: black to white is {grey}, by a square root.", quiet=True)
    )


def _errors(images: SceneImages, sides: SideNames) -> str:
    drawn = []
    for name, observation in _observations(images, sides):
        source = "device depth" if isinstance(observation, DepthObservation) else "our matcher"
        drawn.append(_error(f"{name}, {source}", observation.depth_px[0], images))
    ends = [f"{number(sign * pictures.ERROR_LIMIT_PX, '+.0f')} px" for sign in (-1, 1)]
    return (
        f'<div class="threes">{"".join(drawn)}</div><div class="scale">'
        f"{bar(pictures.scale(), *ends)}"
        "disparity error against the reference; red: too near; dark: no depth; grey: no reference"
        "</div>"
    )


def _error(name: str, disparity_px: Image, images: SceneImages) -> str:
    holes = percent(float(np.mean(~np.isfinite(disparity_px[images.strata.counted]))))
    return picture(
        pictures.errors(disparity_px, images.strata),
        alt=f"{name}: disparity error, {holes} without depth.",
        caption=f"{name}: disparity error; {holes} without depth",
    )
