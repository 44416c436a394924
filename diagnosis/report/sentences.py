"""The answer in three sentences: where, which, how far."""

from __future__ import annotations

from collections.abc import Iterator

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.reduction import Closed
from starling.diagnosis.report import group_names
from starling.diagnosis.report.words import words
from starling.diagnosis.where import frames
from starling.diagnosis.which.search import Accepted
from starling.diagnosis.which.segment import Found
from starling.sim.effects.effect import Value

_SUMMARY = {"ndp_brier": "holes (Brier score)"}  # Figures that one sentence has room for.
STAGES = {
    "image": "the infrared images",
    "depth": "the device's matcher and filters",
    "whole": "depth",
}

ESTIMATED = "reflectance and light, which were estimated"
FRAMES: dict[frames.Stays, str] = {
    "camera": "stays in the camera's image",
    "projector": "stays in the projector's field",
    "both": "stays in the camera's image or the projector's field",
}


def answer(of: Diagnosis) -> list[str]:
    """Say what was found, one sentence for each question."""
    return [_where(of), _which(of), " ".join([_howfar(of), *_residual(of)])]


def _where(of: Diagnosis) -> str:
    part = of.where.parts["ndp_rate"]
    real = part.device if part.device is not None else part.rematched
    base = part.base_device if part.base_device is not None else part.base
    if real is None or base is None:
        return "Nothing was captured that depth could be told from."
    beside = words(of.against).beside
    said = f"{_percent(real)} of the pixels have no depth, {beside} {_percent(base)}"
    if part.image_share is not None and part.image is not None and part.matcher is not None:
        said += (
            f"; of the gap {_points(part.image[0])} arise in the images and "
            f"{_points(part.matcher[0])} in matcher and filters"
        )
    if of.where.rules:
        rule = of.where.rules[0]
        said += f"; most where {rule.text} ({_points(rule.gap)} in {_percent(rule.area)})"
    return said + "."


def _which(of: Diagnosis) -> str:
    if of.kind == "cannot tell":
        return "These captures cannot tell which effect it is."
    if of.kind == "no gap":
        return "No gap was found that an effect would have to explain."
    if of.kind == "effects":
        named = [_named(of, one) for arm in of.arms for one in arm.search.accepted]
        return f"The gap is consistent with {', with '.join(named)}."
    leads = [
        f"{STAGES[arm.bench.arm.value]}: {lead(arm)}{stays(of, arm)}"
        for arm in of.arms
        if arm.unexplained
    ]
    rest = "None of the known effects explains the gap; what is left shows in " + "; ".join(leads)
    return " ".join([f"{rest}.", *_beside(of)])


def _beside(of: Diagnosis) -> Iterator[str]:
    """What is named though a half is left unexplained: stand-ins there, effects in the other."""
    for arm in of.arms:
        named = [_named(of, one) for one in arm.search.accepted]
        stage = STAGES[arm.bench.arm.value]
        if named and arm.unexplained:
            yield f"Stand-ins in {stage}: {', '.join(named)}."
        elif named:
            yield f"The gap in {stage} is consistent with {', with '.join(named)}."


def with_stand_ins(of: Diagnosis) -> bool:
    """Whether anything that is accepted stands in for an effect that is not known."""
    return any(arm.unexplained and arm.search.accepted for arm in of.arms)


def lead(arm: Found) -> str:
    """Name what an arm leaves unexplained."""
    said = [", ".join(map(group_names.told, arm.lead))] if arm.lead else []
    if arm.varying:
        said.append(f"{', '.join(map(group_names.told, arm.varying))}, in each scene otherwise")
    return "; ".join(said) or "no single group of features"


def stays(of: Diagnosis, arm: Found) -> str:
    """Say in which frame rooms agree about where an arm's gap is, as the end of a clause."""
    found = frames.of_arm(of.where.maps, arm.bench.arm.value)
    return "" if found is None else f" (before any effect its place {FRAMES[found]})"


def _named(of: Diagnosis, one: Accepted) -> str:
    low, high = (number(end) for end in one.interval)
    said = f"{one.fit.name} {number(one.fit.value)} (90 %: {low} to {high})"
    names = [rival.name for rival in one.rivals]
    if one.fit.name in of.taken_up:
        names.append(ESTIMATED)
    if names:
        said += f" (not separable from {', '.join(names)})"
    return said


def _howfar(of: Diagnosis) -> str:
    if of.howfar is None:
        return "How far it closes was not judged."
    said = [
        f"{_SUMMARY.get(name, name)} {_closed(one)}"
        for name, one in of.howfar.figures.items()
        if name in _SUMMARY or name.startswith("features")
    ]
    scenes = "1 scene" if len(of.locked) == 1 else f"{len(of.locked)} scenes"
    if not said:
        return f"On {scenes} that had no say there was nothing to close."
    by = " with stand-ins" if with_stand_ins(of) else ""
    return f"Closed of the gap on {scenes} that had no say{by}: " + ", ".join(said) + "."


def _residual(of: Diagnosis) -> list[str]:
    """What a network that corrects the base reaches, and what effects leave it to learn."""
    if of.residual is None:
        return []
    before, bound = (f"{one['ndp_brier']:.3g}" for one in (of.residual.alone, of.residual.bound))
    said = f"A learned residual takes the Brier score of holes from {before} to {bound}"
    one = of.residual.absorption
    if not one.closable:
        return [f"{said}, not surely more than where nothing is off."]
    said += f", by {one.gain_before - one.gain_floor:.2g} more than where nothing is off."
    if one.share is None:
        return [said]
    ends = ""
    if one.interval is not None:
        ends = f" [{100 * one.interval[0]:.0f}, {100 * one.interval[1]:.0f}]"
    return [said, f"The effects take over {100 * one.share:.0f} %{ends} of that."]


def _closed(one: Closed) -> str:
    if one.closed_pct is None:
        return "not identifiable"
    said = f"{one.closed_pct:.0f} %"
    if one.interval is None:
        return said
    return f"{said} (95 %: {one.interval[0]:.0f} to {one.interval[1]:.0f})"


def number(value: Value) -> str:
    """Write a parameter's value."""
    return value if isinstance(value, str) else f"{value:.3g}"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _points(share: float) -> str:
    return f"{100 * share:+.1f} points"
