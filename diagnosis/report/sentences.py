"""The three sentences that answer where, which and how far."""

from __future__ import annotations

from collections.abc import Iterator

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.reduction import GapReduction
from starling.diagnosis.report.words import side_names
from starling.diagnosis.where import frames
from starling.diagnosis.which.search import AcceptedEffect
from starling.diagnosis.which.segment import SegmentResult
from starling.sim.effects.effect import Value

_SUMMARY = {"ndp_brier": "holes (Brier score)"}  # Figures short enough for the summary sentence.
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
            f"; the images contribute {_points(part.image[0])} to the gap, matcher and filters "
            f"{_points(part.matcher[0])}"
        )
    if diagnosis.where.rules:
        rule = diagnosis.where.rules[0]
        text += (
            f"; the largest part lies where {rule.text} "
            f"({_points(rule.gap)} in {_percent(rule.area)} of the pixels)"
        )
    return text + "."


def _which(diagnosis: Diagnosis) -> str:
    if diagnosis.kind == "cannot tell":
        return "These captures cannot identify the effect."
    if diagnosis.kind == "no gap":
        return "No gap beyond noise was found, so no effect is reported."
    if diagnosis.kind == "effects":
        accepted = [
            _accepted(diagnosis, effect)
            for segment in diagnosis.segments
            for effect in segment.search.accepted
        ]
        return f"The gap is consistent with {' and '.join(accepted)}."
    leads = [
        f"{SEGMENTS[segment.table.segment.value]}: {lead(segment)}{fixed_frame(diagnosis, segment)}"
        for segment in diagnosis.segments
        if segment.unexplained
    ]
    text = "None of the known effects explains the gap. What they leave shows in " + "; ".join(
        leads
    )
    return " ".join([f"{text}.", *_partly_explained(diagnosis)])


def _partly_explained(diagnosis: Diagnosis) -> Iterator[str]:
    """Report accepted effects if a segment is unexplained: surrogates there, effects elsewhere."""
    for segment in diagnosis.segments:
        accepted = [_accepted(diagnosis, effect) for effect in segment.search.accepted]
        name = SEGMENTS[segment.table.segment.value]
        if accepted and segment.unexplained:
            yield f"Surrogate effects in {name}: {', '.join(accepted)}."
        elif accepted:
            yield f"The gap in {name} is consistent with {' and '.join(accepted)}."


def with_surrogates(diagnosis: Diagnosis) -> bool:
    """Whether any accepted effect is a surrogate for an unknown one."""
    return any(segment.unexplained and segment.search.accepted for segment in diagnosis.segments)


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


def _accepted(diagnosis: Diagnosis, effect: AcceptedEffect) -> str:
    low, high = (number(end) for end in effect.interval)
    text = f"{effect.fit.name} {number(effect.fit.value)} (90 %: {low} to {high})"
    names = [rival.name for rival in effect.rivals]
    if effect.fit.name in diagnosis.absorbed:
        names.append(ESTIMATED)
    if names:
        text += f" (not separable from {', '.join(names)})"
    return text


def _howfar(diagnosis: Diagnosis) -> str:
    if diagnosis.howfar is None:
        return "The gap reduction was not evaluated."
    texts = [
        f"{_SUMMARY.get(name, name)} {_reduction(reduction)}"
        for name, reduction in diagnosis.howfar.figures.items()
        if name in _SUMMARY or name.startswith("features")
    ]
    count = len(diagnosis.held_out)
    scenes = "1 held-out scene" if count == 1 else f"{count} held-out scenes"
    if not texts:
        return f"No gap that could be reduced was measured on {scenes}."
    clause = " with surrogate effects" if with_surrogates(diagnosis) else ""
    return f"Gap reduction on {scenes}{clause}: " + ", ".join(texts) + "."


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
