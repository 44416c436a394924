"""The three sentences that answer where, which and how far."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.evidence import SurrogateReason
from starling.diagnosis.howfar.reduction import GapReduction
from starling.diagnosis.report.words import side_names
from starling.diagnosis.where import frames
from starling.diagnosis.where.remainder import RemainderPlace, Scale
from starling.diagnosis.which.search import AcceptedEffect
from starling.diagnosis.which.segment import SegmentResult
from starling.sim.effects.effect import Value
from starling.sim.report.elements import counted

_LEVEL_RATIO = 1.25  # Ratio of levels from which the exposure is called off.
REASONS: dict[SurrogateReason, str] = {
    "rival": "another effect explains more",
    "range": "its value is at the end of what is possible",
    "held out": "it does not help on held-out rooms",
    "misfit": "it leaves much of the gap in the features that it changes",
    "worse": "it makes other figures worse",
}
SCALES: dict[Scale, str] = {
    "pixels": "single pixels",
    "dots": "dots, up to 16 px",
    "image": "the image, beyond 16 px",
}
FIGURES = {
    "ndp_brier": "the Brier score of holes",
    "ndp_1_auc": "the ranking of holes",
    "ndp_ece": "the calibration of holes",
    "ndp_1_iou": "the overlap of holes",
    "bias_px": "the bias of disparity",
    "log_nmad": "the noise of disparity",
    "error_distribution_px": "the distribution of disparity errors",
    "dot_contrast": "the contrast of dots",
    "infrared_nll": "the likelihood of the images",
    "log_noise_in_time": "the noise in time",
}
SEGMENTS = {
    "image": "the infrared images",
    "depth": "the device's matcher and filters",
    "whole": "depth",
}

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


def answer(diagnosis: Diagnosis) -> list[str]:
    """Return one sentence for each of the three questions."""
    return [
        _where(diagnosis),
        _which(diagnosis),
        " ".join([_howfar(diagnosis), *_residual(diagnosis)]),
    ]


def notes(diagnosis: Diagnosis) -> list[str]:
    """Return what the answer leaves out: levels, all effects, surrogates and the remainder."""
    return [
        *_levels(diagnosis),
        *(
            _note(diagnosis, effect)
            for segment in diagnosis.segments
            for effect in segment.search.accepted
        ),
        *(_too_weak(segment) for segment in diagnosis.segments if segment.weak),
        *_remainders(diagnosis),
    ]


def _where(diagnosis: Diagnosis) -> str:
    part = diagnosis.where.parts["ndp_rate"]
    real = part.device if part.device is not None else part.rematched
    base = part.base_device if part.base_device is not None else part.base
    if real is None or base is None:
        return "The captures hold nothing from which depth could be measured."
    clause = side_names(diagnosis.against).reference_clause
    text = f"{_percent(real)} of the pixels have no depth, against {_percent(base)} {clause}"
    if part.image_share is not None and part.image is not None and part.matcher is not None:
        text += (
            f"; images contribute {_points(part.image[0])}, matcher and filters "
            f"{_points(part.matcher[0])}"
        )
    return text + "."


def _which(diagnosis: Diagnosis) -> str:
    if diagnosis.kind == "cannot tell":
        return "These captures cannot identify the effect."
    if diagnosis.kind == "no gap":
        return "No gap beyond noise was found, so no effect is reported."
    reported = reported_effects(diagnosis)
    if reported:
        further = len(reported) - 1
        text = f"The gap is consistent with {_with_interval(reported[0])}"
        text += f" and {counted(further, 'further effect')}" if further else ""
        shares = [left.share for left in diagnosis.remainders.values() if left.share is not None]
        return f"{text}; {_percent(max(shares))} of it stays unexplained." if shares else f"{text}."
    surrogates = list(diagnosis.evidence)
    if surrogates:
        return f"No known effect explains the gap; {surrogates[0]} only imitates its cause."
    weak = [(segment, fit) for segment in diagnosis.segments for fit in segment.weak]
    if weak:
        segment, best = max(weak, key=lambda item: item[1].total)
        return (
            f"There is a gap, but each known effect is too weak to name; {best.name} comes first, "
            f"with a gain of {best.total:.0f} of {segment.search.threshold:.0f}."
        )
    return "There is a gap, but no known effect reduces it."


def reported_effects(diagnosis: Diagnosis) -> list[AcceptedEffect]:
    """Return the effects that are no surrogates, by decreasing gain."""
    reported = [
        effect
        for segment in diagnosis.segments
        for effect in segment.search.accepted
        if effect.fit.name in diagnosis.settings
    ]
    return sorted(reported, key=lambda effect: -effect.fit.total)


def _levels(diagnosis: Diagnosis) -> Iterator[str]:
    """Report that captures are brighter or darker than the base, which is no effect yet."""
    ratios = diagnosis.where.levels
    if not ratios:
        return
    middle = float(np.median(list(ratios.values())))
    if 1 / _LEVEL_RATIO < middle < _LEVEL_RATIO:
        return
    sides = side_names(diagnosis.against)
    low, high = min(ratios.values()), max(ratios.values())
    yield (
        f"Your exposure is off by {middle:.2g}: that is the level of {sides.have[0]} over "
        f"{sides.have[1]}, {low:.2g} to {high:.2g} by room."
    )


def _note(diagnosis: Diagnosis, effect: AcceptedEffect) -> str:
    """Describe one accepted effect, and why it is a surrogate if it is one."""
    text = f"{_with_interval(effect)}"
    names = [rival.name for rival in effect.rivals]
    if effect.fit.name in diagnosis.absorbed:
        names.append(ESTIMATED)
    text += f", not separable from {', '.join(names)}" if names else ""
    text += ", at the end of its range" if effect.at_end else ""
    reasons = diagnosis.evidence[effect.fit.name].reasons
    if reasons:
        return f"Surrogate: {text}; {' and '.join(REASONS[reason] for reason in reasons)}."
    return f"Effect: {text}."


def _too_weak(segment: SegmentResult) -> str:
    """Name the best candidates where no effect gains enough."""
    best = ", ".join(f"{fit.name} ({fit.total:.0f})" for fit in segment.weak)
    needed = f"{segment.search.threshold:.0f}"
    name = SEGMENTS[segment.table.segment.value]
    return f"Too weak to name in {name}: {best}; a gain of {needed} is needed."


def _remainders(diagnosis: Diagnosis) -> Iterator[str]:
    """Describe how much of each segment's gap stays unexplained, and where."""
    for segment in diagnosis.segments:
        name = segment.table.segment.value
        left = diagnosis.remainders[name]
        if not left.share:
            continue
        ends = ""
        if left.interval is not None:
            ends = f" (95 %: {100 * left.interval[0]:.0f} to {100 * left.interval[1]:.0f})"
        yield f"Unexplained in {SEGMENTS[name]}: {100 * left.share:.0f} %{ends} of the gap."
        if segment.lead or segment.varying:
            yield f"It shows in {lead(segment)}."
        place = diagnosis.places.get(name)
        if place is not None and (words := _place(place)):
            yield f"It {words}."


def _place(place: RemainderPlace) -> str:
    texts = []
    if place.frame is not None:
        texts.append(FRAMES[place.frame])
    if place.zone is not None:
        texts.append(f"is strongest at the {place.zone} of the image")
    if place.scale is not None:
        texts.append(f"has the scale of {SCALES[place.scale]}")
    return ", ".join(texts)


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


def _with_interval(effect: AcceptedEffect) -> str:
    low, high = (number(end) for end in effect.interval)
    return f"{effect.fit.name} {number(effect.fit.value)} (90 %: {low} to {high})"


def _howfar(diagnosis: Diagnosis) -> str:
    if diagnosis.howfar is None or not diagnosis.howfar.figures:
        return "The gap reduction was not evaluated."
    scenes = counted(len(diagnosis.held_out), "held-out scene")
    closed = {
        name: reduction
        for name, reduction in diagnosis.howfar.figures.items()
        if reduction.closed_pct is not None
    }
    if not closed:
        return f"No gap that could be reduced was measured on {scenes}."
    name = max(closed, key=lambda each: min(closed[each].closed_pct or 0.0, 100.0))
    return f"On {scenes}, the reported effects close {_reduction(closed[name])} of {_figure(name)}."


def _figure(name: str) -> str:
    return FIGURES.get(name, f"the {name}")


def _residual(diagnosis: Diagnosis) -> list[str]:
    """Report what a network that corrects the base reaches, and how much of it effects absorb."""
    if diagnosis.residual is None:
        return []
    figures = (diagnosis.residual.alone, diagnosis.residual.bound)
    before, bound = (f"{each['ndp_brier']:.3g}" for each in figures)
    text = f"A learned residual changes the Brier score of holes from {before} to {bound}"
    absorption = diagnosis.residual.absorption
    if not absorption.closable:
        return [f"{text}; this gain does not significantly exceed the gain without a gap."]
    gain = absorption.gain_before - absorption.gain_floor
    text += f"; this gain exceeds the gain without a gap by {gain:.2g}."
    if absorption.share is None:
        return [text]
    ends = ""
    if absorption.interval is not None:
        ends = f" [{100 * absorption.interval[0]:.0f}, {100 * absorption.interval[1]:.0f}]"
    return [text, f"The effects absorb {100 * absorption.share:.0f} %{ends} of that."]


def _reduction(reduction: GapReduction) -> str:
    if reduction.closed_pct is None:
        return "not identifiable"
    text = f"{reduction.closed_pct:.0f} %"
    if reduction.interval is None:
        return text
    return f"{text} (95 %: {reduction.interval[0]:.0f} to {reduction.interval[1]:.0f})"


def number(value: Value) -> str:
    """Write a parameter's value."""
    return value if isinstance(value, str) else f"{value:.3g}"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _points(share: float) -> str:
    return f"{100 * share:+.1f} points"
