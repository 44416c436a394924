"""One scene's pictures, as a part of a page: captured, simulated before and after."""

from __future__ import annotations

import numpy as np

from starling.diagnosis.report import pictures
from starling.diagnosis.report.elements import percent, picture, prose
from starling.diagnosis.report.scene_images import Shown
from starling.diagnosis.report.words import Words
from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.scenes.strata import Image
from starling.sim.report.elements import bar, number


def section(of: Shown, named: Words, *, locked: bool, tried: bool) -> str:
    """Draw a scene's infrared images and disparity errors as HTML.

    Args:
        of: the scene.
        named: what its readings are called.
        locked: whether it had no say in what is named.
        tried: whether effects were tried at all.
    """
    said = []
    if tried:
        said.append(f"It had {'no' if locked else 'a'} say in what is named.")
    if of.after is None and not named.gap:
        said.append("There is no picture after: nothing was named that can be set.")
    return (prose(*said) if said else "") + _infrared(of, named) + _errors(of, named)


def _readings(of: Shown, named: Words) -> list[tuple[str, Reading]]:
    found = [(named.one, of.real), (named.other, of.before)]
    return found if of.after is None else [*found, ("Simulated, accepted effects", of.after)]


def _infrared(of: Shown, named: Words) -> str:
    images = [(name, one.left[0]) for name, one in _readings(of, named) if one.left is not None]
    note = "" if of.real.left is not None else "No infrared was captured of it."
    if not images:
        return prose(note)
    limits = pictures.levels([image for _, image in images])
    grey = f"{number(limits[0], '.0f')} to {number(limits[1], '.0f')} DN"
    whole = "".join(
        picture(
            pictures.infrared(image, limits),
            alt=f"{name}: left infrared image, mean {image.mean():.1f} DN.",
            caption=f"{name}: left infrared, mean {number(float(image.mean()), '.1f')} DN",
        )
        for name, image in images
    )
    middle = "".join(
        picture(
            pictures.infrared(image, limits, zoomed=True),
            alt=f"{name}: middle of the left infrared image, enlarged.",
            caption=f"{name}: its middle, enlarged",
            sharp=True,
        )
        for name, image in images
    )
    return (
        (prose(note) if note else "")
        + f'<div class="threes">{whole}</div><div class="threes">{middle}</div>'
        + prose(f"All drawn alike: black to white is {grey}, by a square root.", quiet=True)
    )


def _errors(of: Shown, named: Words) -> str:
    drawn = []
    for name, one in _readings(of, named):
        maps, whose = one.ours_px, "our matcher"
        if one.device_px is not None:
            maps, whose = one.device_px, "own depth"
        if maps is not None:
            drawn.append(_error(f"{name}, {whose}", maps[0], of))
    ends = [f"{number(sign * pictures.ERROR_LIMIT_PX, '+.0f')} px" for sign in (-1, 1)]
    return (
        f'<div class="threes">{"".join(drawn)}</div><div class="scale">'
        f"{bar(pictures.scale(), *ends)}"
        "disparity error against the reference; red: too near; dark: no depth; grey: the "
        "reference is not known</div>"
    )


def _error(name: str, disparity_px: Image, of: Shown) -> str:
    holes = percent(float(np.mean(~np.isfinite(disparity_px[of.ground.counted]))))
    return picture(
        pictures.errors(disparity_px, of.ground),
        alt=f"{name}: disparity error, {holes} without depth.",
        caption=f"{name}: disparity error; {holes} without depth",
    )
