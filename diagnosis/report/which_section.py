"""Report section on the effects with which the gap is consistent."""

from __future__ import annotations

from html import escape

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.report import sentences
from starling.diagnosis.which.discrimination import Discrimination
from starling.diagnosis.which.search import AcceptedEffect
from starling.diagnosis.which.segment import SegmentResult
from starling.sim.effects import setting
from starling.sim.report.elements import Bar, chart, counted, number, prose, table

ALONE = 15  # Largest number of single-effect gains drawn.
GROUPS = 10  # Largest number of feature groups listed.


def section(diagnosis: Diagnosis) -> str:
    """Write the section as HTML."""
    if not diagnosis.segments:
        return prose("No effect was tried: these captures cannot identify one.")
    return (
        "".join(_segment(diagnosis, segment) for segment in diagnosis.segments)
        + _discriminations(diagnosis)
        + _sensitivities(diagnosis)
    )


def _sensitivities(diagnosis: Diagnosis) -> str:
    limits = diagnosis.sensitivities
    if not limits:
        return ""
    rows = [
        [
            f"<code>{escape(limit.name)}</code>",
            *(
                "" if end is None else escape(sentences.number(end))
                for end in (limit.below, limit.base, limit.above)
            ),
            escape(sentences.unit(limit.name)),
        ]
        for limit in limits
    ]
    seen = (
        "No gap does not mean that no effect is present. From the listed values on, about half of "
        "such captures or more would show the effect."
        if diagnosis.kind == "no gap"
        else "An effect that is not accepted may still be present. From the listed values on, it "
        "would have gained enough despite the remaining gap."
    )
    text = (
        f"{seen} Weaker effects would rarely be detected. The values are rough: they come from the "
        "simulated change of these scenes at few strengths. An empty cell means that no simulated "
        "strength would be detected."
    )
    head = ["Effect", "Detected at or below", "Base", "Detected at or above", "Unit"]
    return f"<h3>Detection limits</h3>{prose(text)}{table(head, rows)}"


def _segment(diagnosis: Diagnosis, segment: SegmentResult) -> str:
    name = sentences.SEGMENTS[segment.table.segment.value]
    before, after = (number(size, ".3g") for size in segment.sizes)
    text = (
        f"The size of the gap is the weighted mean-square deviation of its features: {before} "
        f"before and {after} with the accepted effects. Noise alone reaches up to "
        f"{number(segment.screening.noise, '.3g')}. After allowing for model error of the "
        f"accepted effects, {number(segment.unexplained_size, '.3g')} remains unexplained; up to "
        f"{number(segment.explained_below, '.3g')} counts as explained."
    )
    return (
        f"<h3>In {escape(name)}</h3>"
        + prose(text)
        + _accepted(diagnosis, segment)
        + _lead(diagnosis, segment)
        + _groups(segment)
        + f"<h4>Held-out gain of each effect alone</h4>{_alone(segment)}"
    )


def _accepted(diagnosis: Diagnosis, segment: SegmentResult) -> str:
    accepted = segment.search.accepted
    if not accepted:
        return prose("No effect is accepted here.")
    rows = []
    for effect in accepted:
        low, high = (sentences.number(end) for end in effect.interval)
        rows.append(
            [
                f"<code>{escape(effect.fit.name)}</code>",
                escape(sentences.number(effect.fit.value)),
                escape(f"[{low}, {high}]"),
                escape(sentences.unit(effect.fit.name)),
                escape(sentences.number(effect.fit.signature.candidate.base)),
                number(effect.fit.total, ".1f"),
                "effect" if effect.fit.name in diagnosis.settings else "surrogate",
            ]
        )
    head = ["Effect", "Value", "90 % interval", "Unit", "Base", "Held-out gain", "Role"]
    items = "".join(f"<li>{_credible_set(diagnosis, effect)}</li>" for effect in accepted)
    return f"{table(head, rows)}<ul>{items}</ul>"


def _credible_set(diagnosis: Diagnosis, accepted: AcceptedEffect) -> str:
    effect, _ = setting.parameter_of(accepted.fit.name)
    name = f"<b>{escape(accepted.fit.name)}</b>"
    imitates = f'<br><span class="quiet">It imitates: {escape(effect.imitates)}</span>'
    absorbed = accepted.fit.name in diagnosis.absorbed
    if not accepted.rivals and not absorbed:
        return f"{name} is separable from the other effects that were examined closely.{imitates}"
    rivals = [
        f"{rival.name} {sentences.number(rival.value)} "
        f"[{sentences.number(low)}, {sentences.number(high)}] "
        f"(gain {number(rival.total, '.1f')})"
        for rival, (low, high) in zip(accepted.rivals, accepted.rival_intervals, strict=True)
    ]
    names = ", ".join([*rivals, *([sentences.ESTIMATED] if absorbed else [])])
    return f"{name} is not separable from {escape(names)}.{imitates}"


def _lead(diagnosis: Diagnosis, segment: SegmentResult) -> str:
    if not segment.unexplained:
        return ""
    groups = sentences.lead(segment) + sentences.fixed_frame(diagnosis, segment)
    text = f"No known effect explains the remainder. It shows in {groups}."
    return f'<ul class="open"><li>{escape(text)}</li></ul>'


def _groups(segment: SegmentResult) -> str:
    """List the feature groups that make up the gap, before and after."""
    rows = [
        [escape(sentences.describe_group(name)), number(before, ".3f"), number(after, ".3f")]
        for name, (before, after) in list(segment.by_group.items())[:GROUPS]
    ]
    text = "Contribution of each group of related features to the size of the gap."
    head = ["Group", "Before", "After"]
    return f"<h4>Composition of the gap</h4>{prose(text)}{table(head, rows)}" + _consistent(segment)


def _consistent(segment: SegmentResult) -> str:
    """List single features that remain off in the same direction in every scene."""
    features = list(segment.consistent.items())
    if not features:
        return ""
    text = (
        f"{counted(len(features), 'feature')} of {len(segment.table.names)} remain off in the same "
        "direction in every scene with the accepted effects. The table gives their deviations over "
        "scenes, in standard deviations; large deviations with a high weight come first."
    )
    rows = [
        [f"<code>{escape(name)}</code>", number(min(each), ".1f"), number(max(each), ".1f")]
        for name, each in features[:GROUPS]
    ]
    head = ["Feature", "Least", "Most"]
    return f"<h4>Features off in every scene</h4>{prose(text)}{table(head, rows)}"


def _alone(segment: SegmentResult) -> str:
    search = segment.search
    gaining = [fit for fit in search.alone if fit.total > 0][:ALONE]
    above = sum(fit.total >= search.threshold for fit in search.alone)
    text = (
        "Gain in log-likelihood on scenes that were not used to fit the effect; a gain of 3 means "
        f"odds of 20 to 1. Of {counted(len(search.alone), 'parameter')} tried, {above} reach the "
        f"threshold {number(search.threshold, '.1f')} (dashed line) alone."
    )
    if not gaining:
        return prose(text, "No effect has a positive gain.")
    accepted = {effect.fit.name for effect in search.accepted}
    bars = [
        Bar(
            name=fit.name,
            value=fit.total,
            text=f"{number(fit.total, '.1f')} at {sentences.number(fit.value)}",
            kind="third" if fit.name in accepted else "first",
        )
        for fit in gaining
    ]
    note = prose("Accepted effects have another colour.", quiet=True) if accepted else ""
    return prose(text) + chart(bars, line=search.threshold) + note


def _discriminations(diagnosis: Diagnosis) -> str:
    if not diagnosis.discriminations:
        return ""
    items = "".join(f"<li>{escape(_capture(pair))}</li>" for pair in diagnosis.discriminations)
    return f"<h3>Captures that would separate the candidates</h3><ul>{items}</ul>"


def _capture(pair: Discrimination) -> str:
    names = _rivals(pair)
    difference = f"{number(pair.deviations, '.1f')} standard deviations"
    if pair.enough:
        return f"{names}: take {pair.capture}; the predictions differ by {difference}."
    return (
        f"{names}: no capture that was tried separates them reliably. The best, {pair.capture}, "
        f"gives a difference of {difference}."
    )


def _rivals(pair: Discrimination) -> str:
    """Name both candidates, and the effects that they have in common."""
    first, second = (names.split(", ") for names in pair.rivals)
    common = [name for name in first if name in second]
    each = [", ".join(name for name in names if name not in common) for names in (first, second)]
    clause = f" (both with {', '.join(common)})" if common else ""
    return f"{' or '.join(each)}{clause}"
