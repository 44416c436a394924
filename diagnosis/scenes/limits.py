"""What captures cannot tell of a gap, and what is wrong with them: a sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from starling.diagnosis.scenes.fit_scene import SCALE, SHIFT, TURN
from starling.diagnosis.scenes.scene_model import Subject
from starling.diagnosis.which.attribution import FEWEST, LOCKED
from starling.diagnosis.which.candidates import LEFT_OUT, Arm

_SAME = 0.01  # Share by which exposures differ that count as one.
_ACTED_ON = {Arm.IMAGE: "images", Arm.DEPTH: "matcher and filters", Arm.WHOLE: "depth"}


def limits_of(
    device: str,
    subjects: Sequence[Subject],
    *,
    locked: bool,
    aside: Sequence[str],
    incomplete: Sequence[str],
    families: Sequence[str] | None,
    untried: Sequence[Arm],
) -> list[str]:
    """List them.

    Args:
        device: that the captures say they are of, or those that they are compared with.
        subjects: all scenes, at least one.
        locked: whether some of them have no say in what is named.
        aside: scenes that only one of two capture sets has.
        incomplete: scenes that hold less than the others.
        families: of effects that were tried; None tried all.
        untried: arms on which none of these families acts.
    """
    return [
        *_asked(device, subjects, aside, families, untried),
        *_incomplete(subjects, incomplete),
        *_rooms(subjects, locked=locked),
        *_captured(subjects),
        *_light(subjects),
        "Not tried, as single static readings of one size do not show them: "
        f"{', '.join(sorted(LEFT_OUT))}.",
    ]


def _asked(
    device: str,
    subjects: Sequence[Subject],
    aside: Sequence[str],
    families: Sequence[str] | None,
    untried: Sequence[Arm],
) -> Iterator[str]:
    called = subjects[0].sensor.name
    if device != called:
        whose = "These" if subjects[0].against is None else "The other set's"
        yield (
            f"{whose} captures say that they are of a {device}; the sensor at hand is called "
            f"{called}."
        )
    if families is not None:
        yield f"Only effects of these families were tried: {', '.join(sorted(families))}."
    for arm in untried:
        yield f"None of them acts on {_ACTED_ON[arm]}: what made a gap there is not told."
    if aside:
        yield f"Only one of the two sets has these scenes, left aside: {', '.join(aside)}."


def _incomplete(subjects: Sequence[Subject], incomplete: Sequence[str]) -> Iterator[str]:
    if incomplete:
        paired = all(one.real.left is not None for one in subjects)
        measured = all(one.real.device_px is not None for one in subjects)
        held = [
            *(["infrared pairs"] if paired else []),
            *(["depth of the device's own"] if measured else []),
        ]
        yield (
            f"Asked about are scenes that hold {' and '.join(held)}; these do not, left aside: "
            f"{', '.join(incomplete)}."
        )


def _rooms(subjects: Sequence[Subject], *, locked: bool) -> Iterator[str]:
    if len({one.room for one in subjects}) < FEWEST:
        yield "One room alone: nothing can be held out, so no effect is named."
    elif not locked:
        yield f"Fewer than {LOCKED} rooms: how far the gap closes is not judged."


def _captured(subjects: Sequence[Subject]) -> Iterator[str]:
    blind = [one.name for one in subjects if one.real.left is None]
    if blind:
        yield (
            f"No infrared{_of(blind, subjects)}: what images do cannot be told from what matcher "
            "and filters do."
        )
    lit = [
        one.name
        for one in subjects
        if one.sensor.projector.power_w == 0 and one.real.left is not None and not one.real.unlit
    ]
    if lit:
        yield (
            f"The sensor at hand has its projector off, and no pair{_of(lit, subjects)} is named "
            "as captured so (ir_left_off.png, ir_right_off.png): the ordinary ones are taken for "
            "it."
        )
    pairs_alone = [one.name for one in subjects if one.real.device_px is None]
    if pairs_alone:
        yield (
            f"No depth of the device's own{_of(pairs_alone, subjects)}: its matcher and filters "
            "are not judged."
        )
    single = [one.name for one in subjects if one.frames < 2]
    if single:
        yield f"One frame{_of(single, subjects)} alone: noise in time is not seen there."
    moved = [
        one.name
        for one in subjects
        if one.real.moved or (one.against is not None and one.against.moved)
    ]
    if moved:
        yield (
            f"Repeats of {', '.join(moved)} differ by more than noise and light, as if something "
            "had moved: what they tell of noise in time may be wrong."
        )


def _light(subjects: Sequence[Subject]) -> Iterator[str]:
    estimated = [one for one in subjects if one.estimates]
    if any(one.real.left is not None for one in estimated):
        yield (
            "Reflectance and ambient light were estimated from these images: light, exposure, "
            "gain, fall-off and reflectance are partly taken up by them, and are not separable."
        )
    elif estimated:
        yield (
            "Reflectance and ambient light are not known, and without images one of each was "
            "supposed: light, exposure, gain and reflectance are not separable."
        )
    elif len({repr(one.scene.ambient) for one in subjects}) > 1:
        yield "Scenes differ in ambient light: what is tried of it departs from the first scene's."
    yield from _fitted(subjects)
    yield from _exposures(subjects)


def _moved(subjects: Sequence[Subject]) -> Iterator[str]:
    """How far references were moved before anything was asked."""
    fitted = [one.nuisances for one in subjects if TURN[0] in one.nuisances]
    if fitted:
        turn, shift = (
            max(float(np.linalg.norm([one[name].own for name in names])) for one in fitted)
            for names in (TURN, SHIFT)
        )
        yield (
            f"References were moved to where disparity has them, by up to {1e3 * shift:.1f} mm and "
            f"{turn:.2f} degree: offset, scale and tilt of the camera itself are partly taken up "
            "by that."
        )


def _fitted(subjects: Sequence[Subject]) -> Iterator[str]:
    yield from _moved(subjects)
    named = {name for one in subjects for name in one.nuisances}
    names = sorted(named - {*TURN, *SHIFT})
    if names:
        spans = []
        for name in names:
            values = [one.nuisances[name].own for one in subjects if name in one.nuisances]
            ends = dict.fromkeys(f"{end:.5g}" for end in (min(values), max(values)))
            spans.append(f"{name} {' to '.join(ends)}")
        tried = any(one.against is not None for one in subjects)
        yield (
            f"Fitted to each scene by itself: {', '.join(spans)}. "
            + ("Effects depart from that." if tried else "So these are not tried as effects.")
        )
    dotted = [one for one in subjects if one.estimates and one.real.right is not None]
    strange = [
        one.name
        for one in dotted
        if one.sensor.projector.power_w > 0 and SCALE not in one.nuisances
    ]
    if strange:
        yield (
            f"Dots{_of(strange, subjects)} are not where this sensor's pattern has them, however "
            "far it is spread: features of where dots stand tell that the pattern is another."
        )


def _exposures(subjects: Sequence[Subject]) -> Iterator[str]:
    imager = subjects[0].sensor.left
    base = [one.real if one.against is None else one.against for one in subjects]
    told = [one.exposure for one in base if one.exposure is not None]
    if not told or imager.auto_exposure_level:
        return
    amounts = [one.exposure_s * one.gain for one in told]
    if max(amounts) > (1 + _SAME) * min(amounts):
        yield (
            f"Scenes were exposed differently, {max(amounts) / min(amounts):.2f} times as much at "
            "most, as their frame.json tells; the sensor at hand exposes all alike. Give it "
            "auto_exposure_level, or diagnose those apart that were exposed alike."
        )
    elif abs(np.log(amounts[0] / (imager.exposure_s * imager.gain))) > _SAME:
        yield (
            f"frame.json tells of {told[0].exposure_s:g} s at gain {told[0].gain:g}; the sensor "
            f"at hand has {imager.exposure_s:g} s at gain {imager.gain:g}. Set what is true there."
        )


def _of(names: Sequence[str], subjects: Sequence[Subject]) -> str:
    """Of which scenes, where it is not all of them."""
    return f" of {', '.join(names)}" if len(names) < len(subjects) else ""
