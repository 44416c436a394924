"""Every number of a diagnosis, as JSON has them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.evaluation import Judged
from starling.diagnosis.howfar.residual import Residual
from starling.diagnosis.report import sentences
from starling.diagnosis.where import frames
from starling.diagnosis.which.search import Accepted
from starling.diagnosis.which.segment import Found


def figures(of: Diagnosis) -> dict[str, Any]:
    """Return what `starling diagnose --json` prints; NaN is null there (`starling.sim.console.record.dumps`)."""
    return {
        "verdict": of.kind,
        "against": of.against,
        "says": sentences.answer(of),
        "effects": [{**one, "taken_up": one["name"] in of.taken_up} for one in effects(of.arms)],
        "noticed": [dataclasses.asdict(one) for one in of.noticed],
        "tell_apart": [{**dataclasses.asdict(one), "enough": one.enough} for one in of.tell_apart],
        "where": {
            "parts": {name: _part(part) for name, part in of.where.parts.items()},
            "rules": [dataclasses.asdict(rule) for rule in of.where.rules],
            "rows": [dataclasses.asdict(row) for row in of.where.rows],
            "off": [dataclasses.asdict(row) for row in of.where.off],
            "maps": [
                {
                    "quantity": one.quantity,
                    "frame": one.frame,
                    "mean": one.mean.tolist(),
                    "deviations": one.deviations.tolist(),
                    "agreement": one.agreement.tolist(),
                }
                for one in of.where.maps
            ],
            "frames": {
                one.quantity: frames.frame(of.where.maps, one.quantity) for one in of.where.maps
            },
            "bodies": [dataclasses.asdict(body) for body in of.where.bodies],
        },
        "which": {
            arm.bench.arm.value: {
                **_arm(arm),
                "frame": frames.of_arm(of.where.maps, arm.bench.arm.value),
            }
            for arm in of.arms
        },
        "howfar": _with_bound(howfar(of.howfar), of.residual),
        "shares": {} if of.howfar is None else of.howfar.shares,
        "absorption": ({} if of.residual is None else dataclasses.asdict(of.residual.absorption)),
        "scenes": of.scenes,
        "locked": of.locked,
        "fitted": of.fitted,
        "limits": of.limits,
    }


def effects(arms: Sequence[Found]) -> list[dict[str, Any]]:
    """What is told of each accepted effect."""
    return [_effect(arm, one) for arm in arms for one in arm.search.accepted]


def howfar(of: Judged | None) -> dict[str, Any]:
    """What is told of how far the gap closes."""
    if of is None:
        return {}
    return {name: dataclasses.asdict(one) for name, one in of.figures.items()}


def _with_bound(told: dict[str, Any], of: Residual | None) -> dict[str, Any]:
    """Put beside each figure what a learned residual reaches on the base."""
    if of is None:
        return told
    unknown = dict.fromkeys(("before", "after", "floor", "closed_pct", "interval"))
    bounds = {
        name: {**told.get(name, {**unknown, "before": of.alone[name]}), "bound": bound}
        for name, bound in of.bound.items()
    }
    return told | bounds


def _part(part: Any) -> dict[str, Any]:
    return {**dataclasses.asdict(part), "image_share": part.image_share}


def _effect(arm: Found, one: Accepted) -> dict[str, Any]:
    return {
        "name": one.fit.name,
        "arm": arm.bench.arm.value,
        "parameters": {one.fit.name: one.fit.value},
        "interval": list(one.interval),
        "base": one.fit.signature.candidate.base,
        "set": [one.fit.name, *(rival.name for rival in one.rivals)],
        "rivals": {rival.name: rival.value for rival in one.rivals},
        "rival_intervals": {
            rival.name: list(ends)
            for rival, ends in zip(one.rivals, one.rival_intervals, strict=True)
        },
        "rival_gains": {rival.name: rival.total for rival in one.rivals},
        "gain": one.fit.total,
        "stand_in": arm.unexplained,
    }


def _arm(arm: Found) -> dict[str, Any]:
    before, after = arm.sizes
    gap = dict(zip(arm.bench.names, arm.likelihood.gap.T.tolist(), strict=True))
    return {
        "before": before,
        "after": after,
        "beyond": arm.beyond,
        "noise": arm.screen.noise,
        "threshold": arm.search.threshold,
        "explained_below": arm.explained_below,
        "unexplained": arm.unexplained,
        "lead": arm.lead,
        "varying": arm.varying,
        "by_scene": _before_and_after(arm.by_scene),
        "by_group": _before_and_after(arm.by_group),
        "alike": {name: {"gap": gap[name], "left": each} for name, each in arm.alike.items()},
        "features": len(arm.bench.names),
        "votes": float(arm.screen.weight.sum()),
        "alone": [
            {"name": one.name, "value": one.value, "gain": one.total} for one in arm.search.alone
        ],
    }


def _before_and_after(sizes: Mapping[str, tuple[float, float]]) -> dict[str, dict[str, float]]:
    return {name: {"before": before, "after": after} for name, (before, after) in sizes.items()}
