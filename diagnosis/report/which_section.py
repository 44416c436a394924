"""Which effect the gap is consistent with, as a part of a page."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.report import group_names, sentences
from starling.diagnosis.report.elements import Bar, chart, prose
from starling.diagnosis.which.discrimination import Told
from starling.diagnosis.which.search import Accepted
from starling.diagnosis.which.segment import Found
from starling.diagnosis.which.sensitivity import Noticed
from starling.sim.effects import setting as setting
from starling.sim.report.elements import counted, number, table

ALONE = 15  # Effects whose gain alone is drawn.
GROUPS = 10  # Of features, that are listed.


def section(of: Diagnosis) -> str:
    """Write the answer to the second question as HTML."""
    if not of.arms:
        return prose("No effect was tried: these captures cannot tell.")
    return "".join(_arm(of, arm) for arm in of.arms) + _tell_apart(of) + _noticed(of.noticed)


def _noticed(of: Sequence[Noticed]) -> str:
    if not of:
        return ""
    rows = [
        [
            f"<code>{escape(one.name)}</code>",
            *(
                "" if end is None else escape(sentences.number(end))
                for end in (one.below, one.base, one.above)
            ),
            escape(_unit(one.name)),
        ]
        for one in of
    ]
    said = (
        "No gap does not say that nothing is off. From these values on an effect would have been "
        "noticed in half of such captures or more, roughly, by what it does to these scenes where "
        "it was simulated; weaker it would hardly have been. Where none stands it would not have "
        "been at any strength that was simulated."
    )
    head = ["Effect", "Noticed at or below", "Base", "Noticed at or above", "Unit"]
    return f"<h3>What would have been noticed</h3>{prose(said)}{table(head, rows)}"


def _unit(name: str) -> str:
    _, parameter = setting.parameter_of(name)
    return "" if parameter.unit == "1" else parameter.unit


def _arm(of: Diagnosis, arm: Found) -> str:
    stage = sentences.STAGES[arm.bench.arm.value]
    before, after = (number(size, ".3g") for size in arm.sizes)
    said = (
        f"Size of the gap, the mean squared deviation of its features: before {before}, with the "
        f"accepted effects {after}. Chance alone makes up to {number(arm.screen.noise, '.3g')}. "
        "Less what accepted effects may be off by, as none is simulated as it truly is, "
        f"{number(arm.beyond, '.3g')} is left; up to {number(arm.explained_below, '.3g')} counts "
        "as explained."
    )
    return (
        f"<h3>In {escape(stage)}</h3>"
        + prose(said)
        + _accepted(of, arm)
        + _lead(of, arm)
        + _groups(arm)
        + f"<h4>Held-out gain of single effects, each alone</h4>{_alone(arm)}"
    )


def _accepted(of: Diagnosis, arm: Found) -> str:
    accepted = arm.search.accepted
    if not accepted:
        return prose("No effect is accepted here.")
    rows = []
    for one in accepted:
        low, high = (sentences.number(end) for end in one.interval)
        rows.append(
            [
                f"<code>{escape(one.fit.name)}</code>",
                escape(sentences.number(one.fit.value)),
                escape(f"[{low}, {high}]"),
                escape(_unit(one.fit.name)),
                escape(sentences.number(one.fit.signature.candidate.base)),
                number(one.fit.total, ".1f"),
            ]
        )
    role = "Stand-in" if arm.unexplained else "Consistent with"
    head = [role, "Value", "90 % interval", "Unit", "Base", "Held-out gain"]
    sets = "".join(f"<li>{_set(of, one, stand_in=arm.unexplained)}</li>" for one in accepted)
    return f"{table(head, rows)}<ul>{sets}</ul>"


def _set(of: Diagnosis, one: Accepted, *, stand_in: bool) -> str:
    effect, _ = setting.parameter_of(one.fit.name)
    name = f"<b>{escape(one.fit.name)}</b>"
    imitates = f'<br><span class="quiet">It imitates: {escape(effect.imitates)}</span>'
    taken_up = one.fit.name in of.taken_up
    if not one.rivals and stand_in:
        return f"{name} takes part of the gap away and does not explain it.{imitates}"
    if not one.rivals and not taken_up:
        return f"{name} is separable from the other effects that were looked at closely.{imitates}"
    rivals = [
        f"{rival.name} {sentences.number(rival.value)} "
        f"[{sentences.number(low)}, {sentences.number(high)}] "
        f"(gain {number(rival.total, '.1f')})"
        for rival, (low, high) in zip(one.rivals, one.rival_intervals, strict=True)
    ]
    told = ", ".join([*rivals, *([sentences.ESTIMATED] if taken_up else [])])
    return f"{name} is not separable from {escape(told)}.{imitates}"


def _lead(of: Diagnosis, arm: Found) -> str:
    if not arm.unexplained:
        return ""
    shows = sentences.lead(arm) + sentences.stays(of, arm)
    return (
        f'<ul class="open"><li>None of the known effects explains what is left here. It shows in '
        f"{escape(shows)}.</li></ul>"
    )


def _groups(arm: Found) -> str:
    """Which features the gap is made of, before and after."""
    rows = [
        [escape(group_names.told(name)), number(before, ".3f"), number(after, ".3f")]
        for name, (before, after) in list(arm.by_group.items())[:GROUPS]
    ]
    said = "Features that tell alike, and what each such group adds to the gap's size."
    made = f"<h4>What it is made of</h4>{prose(said)}{table(['Of', 'Before', 'After'], rows)}"
    return made + _alike(arm)


def _alike(arm: Found) -> str:
    """Which single features are off after, the same way in every scene."""
    found = list(arm.alike.items())
    if not found:
        return ""
    said = (
        f"{counted(len(found), 'feature')} of {len(arm.bench.names)} are off the same way in every "
        "scene after that; deviations left, those first that are off most and have most votes."
    )
    rows = [
        [f"<code>{escape(name)}</code>", number(min(each), ".1f"), number(max(each), ".1f")]
        for name, each in found[:GROUPS]
    ]
    return f"<h4>Off alike in every scene</h4>{prose(said)}{table(['Of', 'Least', 'Most'], rows)}"


def _alone(arm: Found) -> str:
    found = arm.search
    gaining = [one for one in found.alone if one.total > 0][:ALONE]
    above = sum(one.total >= found.threshold for one in found.alone)
    said = (
        "Gain in log likelihood on scenes that an effect was not fitted to; 3 are odds of 20 to 1. "
        f"Of {counted(len(found.alone), 'parameter')} of effects tried, {above} gain at least the "
        f"threshold {number(found.threshold, '.1f')} (dashed line) alone."
    )
    if not gaining:
        return prose(said, "None gains anything.")
    accepted = {one.fit.name for one in found.accepted}
    bars = [
        Bar(
            name=one.name,
            value=one.total,
            told=f"{number(one.total, '.1f')} at {sentences.number(one.value)}",
            kind="third" if one.name in accepted else "first",
        )
        for one in gaining
    ]
    note = prose("Accepted effects have a colour of their own.", quiet=True) if accepted else ""
    return prose(said) + chart(bars, line=found.threshold) + note


def _tell_apart(of: Diagnosis) -> str:
    if not of.tell_apart:
        return ""
    said = "".join(f"<li>{escape(_capture(told))}</li>" for told in of.tell_apart)
    return f"<h3>The capture that would tell</h3><ul>{said}</ul>"


def _capture(told: Told) -> str:
    pair = _against(told)
    far = f"{number(told.deviations, '.1f')} deviations apart"
    if told.enough:
        return f"{pair}: take {told.capture}; they would stand {far}."
    return (
        f"{pair}: no capture that was tried tells them apart for sure; the best, {told.capture}, "
        f"sets them {far}."
    )


def _against(told: Told) -> str:
    """Name both rivals, and what acts beside either."""
    one, other = (names.split(", ") for names in told.rivals)
    common = [name for name in one if name in other]
    pair = [", ".join(name for name in names if name not in common) for names in (one, other)]
    beside = f" (beside {', '.join(common)})" if common else ""
    return f"{' against '.join(pair)}{beside}"
