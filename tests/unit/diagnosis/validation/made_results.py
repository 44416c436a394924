"""Verdicts as JSON, and cases with their verdicts."""

from __future__ import annotations

from typing import Any

from starling.diagnosis.validation.camera.catalogue import ROWS
from starling.diagnosis.validation.protocol import verdict
from starling.diagnosis.validation.protocol.case import Case, CaseKind
from starling.diagnosis.validation.protocol.verdict import CaseResult

FAMILIES = {"lens_blur": "lens_blur", "corner_blur": "lens_blur"}


def make_effect(
    name: str,
    value: float | str = 1.0,
    *equivalent: str,
    segment: str = "image",
    gain: float = 10.0,
    surrogate: bool = False,
) -> dict[str, Any]:
    """Return the JSON of an effect and its credible set."""
    ends = [value, value] if isinstance(value, str) else [value - 0.1, value + 0.1]
    return {
        "name": name,
        "arm": segment,
        "parameters": {name: value},
        "interval": ends,
        "set": [name, *equivalent],
        "gain": gain,
        "stand_in": surrogate,
        "base": "unknown keys are ignored",
    }


def make_verdict(
    kind: str,
    *effects: dict[str, Any],
    closed: float | None = 90.0,
    metric: str = "features of the image",
    **baselines: str | None,
) -> dict[str, Any]:
    """Return the JSON of a verdict."""
    metrics = {"before": 2.0, "after": 1.1, "floor": 1.0, "closed_pct": closed}
    return {
        "verdict": kind,
        "effects": list(effects),
        "left": {
            "image": {"beyond": 2.0 if kind == "none of the known" else 0.5, "below": 1.0},
            "depth": {"beyond": 0.1, "below": 1.0},
        },
        "howfar": {metric: {**metrics, "interval": [80.0, 95.0]}},
        "baselines": baselines,
        "baselines_by_arm": {"image": baselines, "depth": {}},
        "seconds": 2.0,
    }


def make_result(
    settings: dict[str, float],
    table: dict[str, Any],
    number: int = 0,
    set_number: int = 0,
    **imperfections: float,
) -> CaseResult:
    """Return a case with its verdict, and the imperfections of its base."""
    kinds: tuple[CaseKind, ...] = ("null", "single", "pair")
    outside = any(ROWS[name].kind == "outside" for name in settings)
    kind = "unknown" if outside else kinds[len(settings)]
    case = Case(number=number, kind=kind, settings=settings, seed=1, imperfections=imperfections)
    return CaseResult(case=case, verdict=verdict.from_table(table), set_number=set_number)
