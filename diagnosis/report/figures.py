"""All figures of a diagnosis in the structure of `report.json`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.evaluation import Evaluation
from starling.diagnosis.howfar.evidence import EffectEvidence
from starling.diagnosis.howfar.reduction import GapReduction
from starling.diagnosis.howfar.residual import LearnedResidual
from starling.diagnosis.report import notes, sentences
from starling.diagnosis.where import frames
from starling.diagnosis.where.maps import GapMap
from starling.diagnosis.where.remainder import RemainderPlace
from starling.diagnosis.which.search import AcceptedEffect
from starling.diagnosis.which.segment import SegmentResult


def figures(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the content of `report.json`, with NaN for unknown values.

    `starling.sim.console.record.dumps` writes NaN as null.
    """
    return {
        "verdict": diagnosis.kind,
        "against": diagnosis.against,
        "says": sentences.answer(diagnosis),
        "next": sentences.next_step(diagnosis),
        "notes": notes.notes(diagnosis),
        "effects": [
            {**effect, "taken_up": effect["name"] in diagnosis.absorbed}
            for effect in effects(diagnosis.segments, diagnosis.evidence, diagnosis.howfar)
        ],
        "unexplained_share": {
            segment: dataclasses.asdict(left) for segment, left in diagnosis.remainders.items()
        },
        "weak": weak_candidates(diagnosis.segments),
        "noticed": [dataclasses.asdict(limits) for limits in diagnosis.sensitivities],
        "tell_apart": [
            {**dataclasses.asdict(pair), "enough": pair.enough}
            for pair in diagnosis.discriminations
        ],
        "where": {
            "parts": {name: _part(part) for name, part in diagnosis.where.parts.items()},
            "rules": [dataclasses.asdict(rule) for rule in diagnosis.where.rules],
            "rows": [dataclasses.asdict(row) for row in diagnosis.where.hole_bins],
            "off": [dataclasses.asdict(row) for row in diagnosis.where.error_bins],
            "maps": [_map(gap_map) for gap_map in diagnosis.where.maps],
            "frames": {
                quantity: frames.common_frame(diagnosis.where.maps, quantity)
                for quantity in dict.fromkeys(each.quantity for each in diagnosis.where.maps)
            },
            "coherence": dataclasses.asdict(diagnosis.where.coherence),
            "levels": diagnosis.where.levels,
            "bodies": [dataclasses.asdict(body) for body in diagnosis.where.bodies],
        },
        "which": {
            segment.table.segment.value: {
                **_segment(segment),
                "frame": frames.segment_frame(diagnosis.where.maps, segment.table.segment.value),
                "remainder": _place(diagnosis.places.get(segment.table.segment.value)),
            }
            for segment in diagnosis.segments
        },
        "howfar": _with_bound(howfar(diagnosis.howfar), diagnosis.residual),
        "shares": {} if diagnosis.howfar is None else diagnosis.howfar.shares,
        "absorption": (
            {} if diagnosis.residual is None else dataclasses.asdict(diagnosis.residual.absorption)
        ),
        "scenes": diagnosis.scenes,
        "locked": diagnosis.held_out,
        "fitted": diagnosis.fitted,
        "limits": diagnosis.limits,
    }


def effects(
    segments: Sequence[SegmentResult],
    evidence: Mapping[str, EffectEvidence],
    evaluation: Evaluation | None,
) -> list[dict[str, Any]]:
    """Return the figures of each accepted effect."""
    return [
        _effect(segment, effect, evidence[effect.fit.name], evaluation)
        for segment in segments
        for effect in segment.search.accepted
    ]


def weak_candidates(segments: Sequence[SegmentResult]) -> list[dict[str, Any]]:
    """Return the best candidates of segments with a gap in which no effect is accepted."""
    return [
        {
            "name": fit.name,
            "arm": segment.table.segment.value,
            "value": fit.value,
            "gain": fit.total,
            "needed": segment.search.threshold,
        }
        for segment in segments
        for fit in segment.weak
    ]


def howfar(evaluation: Evaluation | None) -> dict[str, Any]:
    """Return before, after, floor and reduction of each figure."""
    if evaluation is None:
        return {}
    return _reductions(evaluation.figures)


def _reductions(figures: Mapping[str, GapReduction]) -> dict[str, Any]:
    return {name: dataclasses.asdict(reduction) for name, reduction in figures.items()}


def _with_bound(figures: dict[str, Any], residual: LearnedResidual | None) -> dict[str, Any]:
    """Add to each figure the bound that a learned residual reaches on the base."""
    if residual is None:
        return figures
    unknown = dict.fromkeys(("before", "after", "floor", "closed_pct", "interval"))
    bounds = {
        name: {**figures.get(name, {**unknown, "before": residual.alone[name]}), "bound": bound}
        for name, bound in residual.bound.items()
    }
    return figures | bounds


def _part(part: Any) -> dict[str, Any]:
    return {**dataclasses.asdict(part), "image_share": part.image_share}


def _place(place: RemainderPlace | None) -> dict[str, Any] | None:
    if place is None:
        return None
    return {**dataclasses.asdict(place), "maps": [_map(gap_map) for gap_map in place.maps]}


def _map(gap_map: GapMap) -> dict[str, Any]:
    return {
        "quantity": gap_map.quantity,
        "frame": gap_map.frame,
        "mean": gap_map.mean.tolist(),
        "deviations": gap_map.deviations.tolist(),
        "agreement": gap_map.agreement.tolist(),
    }


def _effect(
    segment: SegmentResult,
    effect: AcceptedEffect,
    evidence: EffectEvidence,
    evaluation: Evaluation | None,
) -> dict[str, Any]:
    return {
        "name": effect.fit.name,
        "arm": segment.table.segment.value,
        "parameters": {effect.fit.name: effect.fit.value},
        "interval": list(effect.interval),
        "base": effect.fit.signature.candidate.base,
        "set": [effect.fit.name, *(rival.name for rival in effect.rivals)],
        "rivals": {rival.name: rival.value for rival in effect.rivals},
        "rival_intervals": {
            rival.name: list(ends)
            for rival, ends in zip(effect.rivals, effect.rival_intervals, strict=True)
        },
        "rival_gains": {rival.name: rival.total for rival in effect.rivals},
        "gain": effect.fit.total,
        "at_end": effect.at_end,
        "stand_in": bool(evidence.reasons),
        "evidence": dataclasses.asdict(evidence),
        "closes": {} if evaluation is None else _reductions(evaluation.alone[effect.fit.name]),
    }


def _segment(segment: SegmentResult) -> dict[str, Any]:
    before, after = segment.sizes
    gap = dict(zip(segment.table.names, segment.likelihood.gap.T.tolist(), strict=True))
    return {
        "before": before,
        "after": after,
        "beyond": segment.unexplained_size,
        "noise": segment.screening.noise,
        "threshold": segment.search.threshold,
        "explained_below": segment.explained_below,
        "unexplained": segment.unexplained,
        "lead": segment.lead,
        "varying": segment.varying,
        "by_scene": _before_and_after(segment.by_scene),
        "by_group": _before_and_after(segment.by_group),
        "alike": {
            name: {"gap": gap[name], "left": each} for name, each in segment.consistent.items()
        },
        "features": len(segment.table.names),
        "votes": float(segment.screening.weight.sum()),
        "alone": [
            {"name": fit.name, "value": fit.value, "gain": fit.total}
            for fit in segment.search.alone
        ],
    }


def _before_and_after(sizes: Mapping[str, tuple[float, float]]) -> dict[str, dict[str, float]]:
    return {name: {"before": before, "after": after} for name, (before, after) in sizes.items()}
