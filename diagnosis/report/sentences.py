"""The three sentences that answer where, which and how far, and the words that they use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.evidence import SurrogateReason
from starling.diagnosis.howfar.reduction import GapReduction
from starling.diagnosis.report.words import side_names
from starling.diagnosis.where import frames
from starling.diagnosis.where.remainder import Scale
from starling.diagnosis.which.search import AcceptedEffect
from starling.diagnosis.which.segment import SegmentResult
from starling.sim.effects import setting
from starling.sim.effects.effect import Value
from starling.sim.report.elements import counted

_WHOLE_PCT = 99.5  # Gap reduction from which the whole gap is closed.
_LEVEL_RATIO = 1.25  # Ratio of levels from which the exposure is called off.
_MOST_NAMES = 3  # Largest number of names in a sentence.
_LONGEST = 25  # Largest number of words of a sentence.
_MOST_WORDS = 14  # Largest number of words of these names.
REASONS: dict[SurrogateReason, str] = {
    "rival": "another effect explains more",
    "range": "its value lies at the end of its range",
    "held out": "it does not help on held-out rooms",
    "misfit": "its best value leaves much of the gap that it should close",
    "another make": "a matcher of another make would explain as much",
    "remainder": "a gap remains that the scenes cannot explain",
}
SCALES: dict[Scale, str] = {
    "pixels": "from pixel to pixel",
    "dots": "over up to 16 px, the size of dots",
    "image": "smoothly, over more than 16 px",
}
FIGURES = {
    "features of the image": "image features",
    "features of the depth": "features of matcher and filters",
    "features of the whole": "depth features",
    "ndp_brier": "holes (Brier score)",
    "ndp_1_auc": "the ranking of holes",
    "ndp_ece": "the calibration of holes",
    "ndp_1_iou": "the overlap of holes",
    "bias_px": "disparity bias",
    "log_nmad": "disparity noise",
    "error_distribution_px": "the distribution of disparity errors",
    "dot_contrast": "dot contrast",
    "infrared_nll": "the likelihood of the images",
    "log_noise_in_time": "temporal noise",
}
SEGMENTS = {
    "image": "the infrared images",
    "depth": "the device's matcher and filters",
    "whole": "depth",
}
_SHORT = {"image": "images", "depth": "matcher and filters", "whole": "depth images"}

_ALL = frozenset(f"features of the {name}" for name in SEGMENTS)
_RIGHT = "right "
GROUPS = {
    "level": "brightness",
    "codes": "codes used by the converter",
    "noise": "pixel-to-pixel noise",
    "time": "change from frame to frame",
    "texture": "sharpness",
    "dots": "position and width of dots",
    "pair": "difference of right and left image",
    "error": "disparity error",
    "holes": "pixels without depth",
    "surface": "steps and flat parts of the depth map",
    "range": "nearest and farthest depth",
    "against": "sign of the difference between the device's depth and our matcher's",
    "unlike": "size of the difference between the device's depth and our matcher's",
}

ESTIMATED = "reflectance and light, which were estimated"
FRAMES: dict[frames.FixedFrame, str] = {
    "camera": "is fixed in the camera image",
    "projector": "is fixed in the projector field",
    "both": "is fixed in the camera image or the projector field",
}


FIX = "Run this diagnosis with --fix, then again with the sensor.toml that it writes."


def answer(diagnosis: Diagnosis) -> list[str]:
    """Return one sentence of at most 25 words for each of the three questions."""
    return [_where(diagnosis), _which(diagnosis), _howfar(diagnosis)]


def _where(diagnosis: Diagnosis) -> str:
    part = diagnosis.where.parts["ndp_rate"]
    real = part.device if part.device is not None else part.rematched
    base = part.base_device if part.base_device is not None else part.base
    if real is None or base is None:
        return "The captures hold nothing from which depth could be measured."
    clause = side_names(diagnosis.against).reference_clause
    rates = f"{_percent(real)} of pixels have no depth, against {_percent(base)} {clause}."
    evident = [
        _SHORT[name] for name, left in diagnosis.remainders.items() if left.share is not None
    ]
    if evident:
        return f"The gap lies in {' and in '.join(evident)}; {rates}"
    return f"The gap lies within noise; {rates}" if diagnosis.kind == "no gap" else rates


def _which(diagnosis: Diagnosis) -> str:
    if diagnosis.kind == "cannot tell":
        return "These captures cannot identify the effect."
    if diagnosis.kind == "no gap":
        return "No gap beyond noise was found, so no effect is reported."
    accepted = ranked_effects(diagnosis)
    reported = [item for item in accepted if item[1].fit.name in diagnosis.settings]
    if reported:
        segment, effect = reported[0]
        name = segment.table.segment.value
        start = f"{_SHORT[name].capitalize()} are consistent with {strength(effect)}"
        share = diagnosis.remainders[name].share
        end = "" if share is None else f", {100 * share:.0f} % unexplained"
        nothing = [_SHORT[name] for name in without_effect(diagnosis)]
        end += f"; {nothing[0]}: no known effect." if nothing else "."
        fits = [each.fit for _, each in reported[1:]]
        others = [f"{fit.name} {with_unit(fit.name, fit.value)}" for fit in fits]
        return _as_listed(start, others, end)
    if accepted:
        name = accepted[0][1].fit.name
        reason = REASONS[diagnosis.evidence[name].reasons[0]]
        what = f"No {_tried(diagnosis)} effect"
        return f"{what} explains the gap; {name} comes closest, but {reason}."
    weak = [(segment, fit) for segment in diagnosis.segments for fit in segment.weak]
    if weak:
        segment, best = max(weak, key=lambda item: item[1].total)
        return (
            f"There is a gap, but each {_tried(diagnosis)} effect is too weak to name; {best.name} "
            f"comes first, with a gain of {best.total:.0f} of {segment.search.threshold:.0f}."
        )
    return f"There is a gap, but no {_tried(diagnosis)} effect reduces it."


def _as_listed(start: str, names: Sequence[str], end: str) -> str:
    """Return a sentence with as many names as it has room for, and the number of the others."""
    listed = (start, *names)
    sentences = [f"{_first(listed, count)}{end}" for count in range(len(listed), 0, -1)]
    fitting = [each for each in sentences if len(each.split()) <= _LONGEST]
    return fitting[0] if fitting else sentences[-1]


def _tried(diagnosis: Diagnosis) -> str:
    return "tried" if diagnosis.restricted else "known"


def _howfar(diagnosis: Diagnosis) -> str:
    figures = {} if diagnosis.howfar is None else diagnosis.howfar.figures
    if figures:
        scenes = counted(len(diagnosis.held_out), "held-out scene")
        if all(reduction.closed_pct is None for reduction in figures.values()):
            return f"No gap that could be reduced was measured on {scenes}."
        closed = largest_closed(figures)
        if closed is None:
            return f"On {scenes}, the reported effects close no part of any measured gap."
        text = f"On {scenes}, the reported effects close {closed}"
        measured = {name: each for name, each in figures.items() if name not in _ALL}
        also = largest_closed(measured)
        longer = f"{text} and {also}."
        fits = also not in (None, closed) and len(longer.split()) <= _LONGEST
        return longer if fits else f"{text}."
    if diagnosis.kind == "no gap":
        return "There is no gap to close."
    if not diagnosis.settings:
        return "No effect is reported, so no improvement is claimed."
    if not diagnosis.compatible:
        why = "the effects exclude each other in one sensor"
    elif not diagnosis.held_out:
        why = "no scene is held out"
    else:
        why = "the effects cannot be simulated together"
    return f"How far the gap closes was not measured: {why}."


def without_effect(diagnosis: Diagnosis) -> list[str]:
    """Name the segments with an evident gap in which no effect is reported."""
    return [
        segment.table.segment.value
        for segment in diagnosis.segments
        if diagnosis.remainders[segment.table.segment.value].share is not None
        and not diagnosis.settings.keys() & segment.settings.keys()
    ]


def next_step(diagnosis: Diagnosis) -> str:
    """Return one sentence that says what to do next."""
    if diagnosis.kind == "cannot tell":
        return "Capture at least two rooms."
    if diagnosis.kind == "no gap":
        return "Nothing has to be changed; the report lists how strong an effect must be to show."
    separating = [pair for pair in diagnosis.discriminations if pair.enough]
    if separating and diagnosis.settings:
        first, second = separating[0].rivals
        return f"Capture {separating[0].capture}, to separate {first} from {second}."
    if diagnosis.settings and diagnosis.compatible:
        if all(map(setting.acts_on_scene_only, diagnosis.settings)):
            return f"Set {shortened(list(diagnosis.settings))} in scene.toml, and diagnose again."
        return FIX
    if exposure_ratio(diagnosis) is not None:
        return "Check the exposure of the captures and of the sensor file, and diagnose again."
    if diagnosis.restricted:
        return "Run this diagnosis with all families of effects; others were not tried."
    weak = [fit for segment in diagnosis.segments for fit in segment.weak]
    if weak:
        best = max(weak, key=lambda fit: fit.total)
        return f"Capture more rooms, so that {best.name} can be confirmed or excluded."
    return "Look for the cause in the maps of the gap; no known effect is like it."


def exposure_ratio(diagnosis: Diagnosis) -> float | None:
    """Return the median ratio of levels, captured to base; None if it is near 1 or unknown."""
    ratios = list(diagnosis.where.levels.values())
    middle = float(np.median(ratios)) if ratios else 1.0
    return None if 1 / _LEVEL_RATIO < middle < _LEVEL_RATIO else middle


def applied(diagnosis: Diagnosis) -> str:
    """Name the reported effects as a clause: `with pitch 1.04 px and 1 more`."""
    pairs = diagnosis.settings.items()
    return f"with {shortened([f'{name} {with_unit(name, value)}' for name, value in pairs])}"


def largest_closed(figures: Mapping[str, GapReduction]) -> str | None:
    """Return the largest gap reduction in words: `81 % of the gap in disparity noise`, or None.

    Figures with an interval above zero come first, then those of all features of a segment.
    """
    closed = {
        name: reduction.closed_pct
        for name, reduction in figures.items()
        if reduction.closed_pct is not None and reduction.closed_pct > 0
    }

    def rank(name: str) -> tuple[bool, bool, float]:
        ends = figures[name].interval
        significant = ends is not None and ends[0] > 0
        return significant, not significant and name in _ALL, min(closed[name], 100.0)

    name = max(closed, key=rank, default=None)
    if name is None:
        return None
    figure = FIGURES.get(name, f"the {name}")
    if closed[name] >= _WHOLE_PCT:
        return f"the whole gap in {figure}"
    ends = figures[name].interval
    clause = "" if ends is None else f" (95 %: {ends[0]:.0f} to {ends[1]:.0f})"
    return f"{closed[name]:.0f} %{clause} of the gap in {figure}"


def ranked_effects(diagnosis: Diagnosis) -> list[tuple[SegmentResult, AcceptedEffect]]:
    """Return the accepted effects with their segments, by decreasing gain."""
    accepted = [
        (segment, effect) for segment in diagnosis.segments for effect in segment.search.accepted
    ]
    return sorted(accepted, key=lambda item: -item[1].fit.total)


def shortened(names: Sequence[str]) -> str:
    """List names; of many or long ones only the first: `a, b, c and 5 more`."""
    shown = list(names[:_MOST_NAMES])
    while len(shown) > 1 and len(" ".join(shown).split()) > _MOST_WORDS:
        shown.pop()
    return _first(names, len(shown))


def _first(names: Sequence[str], count: int) -> str:
    """List the first names, and count the others."""
    rest = len(names) - count
    return ", ".join(names[:count]) + (f" and {rest} more" if rest else "")


def lead(segment: SegmentResult) -> str:
    """Name the feature groups that a segment leaves unexplained."""
    texts = [", ".join(map(describe_group, segment.lead))] if segment.lead else []
    if segment.varying:
        groups = ", ".join(map(describe_group, segment.varying))
        texts.append(f"{groups}, different in each scene")
    return "; ".join(texts) or "no single group of features"


def fixed_frame(diagnosis: Diagnosis, segment: SegmentResult) -> str:
    """Return a clause that names the frame in which a segment's gap is fixed, or nothing."""
    frame = frames.segment_frame(diagnosis.where.maps, segment.table.segment.value)
    return "" if frame is None else f" (without any effect, its location {FRAMES[frame]})"


def describe_group(group: str) -> str:
    """Describe a group of features in words.

    Args:
        group: name as `starling.diagnosis.which.residuals.group` returns it.
    """
    kind, separator, covariate = group.removeprefix(_RIGHT).partition(" by ")
    side = " of the right image" if group.startswith(_RIGHT) else ""
    return f"{GROUPS[kind]}{side}{separator and ','}{separator}{covariate}"


def strength(effect: AcceptedEffect) -> str:
    """Write an effect with its value, unit and interval."""
    low, high = (number(end) for end in effect.interval)
    return (
        f"{effect.fit.name} {with_unit(effect.fit.name, effect.fit.value)} (90 %: {low} to {high})"
    )


def with_unit(name: str, value: Value) -> str:
    """Write a value of an effect with its unit."""
    return f"{number(value)} {unit(name)}".rstrip()


def unit(name: str) -> str:
    """Return the unit of an effect; nothing for a number without one."""
    _, parameter = setting.parameter_of(name)
    return "" if parameter.unit == "1" else parameter.unit.replace(" / ", "/")


def number(value: Value) -> str:
    """Write a parameter's value."""
    if isinstance(value, str):
        return value
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"
