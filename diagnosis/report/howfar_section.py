"""How far the gap closes, as a part of a page."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape

import numpy as np

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.reduction import Closed
from starling.diagnosis.report import residual_section, sentences
from starling.diagnosis.report.elements import Bar, Kind, chart, interval, prose
from starling.sim.report.elements import counted, number

_KINDS: dict[str, Kind] = {"after": "second", "floor": "part", "bound": "third"}
TITLES = {
    "ndp_brier": "Holes: Brier score",
    "ndp_1_auc": "Holes: 1 less area under the curve",
    "ndp_ece": "Holes: calibration error",
    "ndp_1_iou": "Holes: 1 less overlap",
    "bias_px": "Bias of disparity [px]",
    "log_nmad": "Spread of disparity: logarithm of its ratio",
    "error_distribution_px": "Distribution of disparity errors [px]",
    "dot_contrast": "Contrast of the dots",
    "infrared_nll": "Infrared: negative log likelihood of a pixel",
    "log_noise_in_time": "Noise in time: logarithm of its ratio",
}


def section(of: Diagnosis) -> str:
    """Write the answer to the third question as HTML."""
    learnt = "" if of.residual is None else residual_section.section(of.residual)
    bound = {} if of.residual is None else of.residual.bound
    if of.howfar is None:
        before = {} if of.residual is None else of.residual.alone
        why = (
            "no scene is locked"
            if not of.locked
            else "no effect was accepted whose share can be measured"
        )
        return (
            prose(f"How far the gap closes was not judged: {why}.")
            + "".join(
                f"<h4>{_title(name)}</h4>{_bars(before=before[name], bound=bound[name])}"
                for name in bound
            )
            + learnt
        )
    tells = (
        "Each figure tells how far simulated is from real: the less, the better."
        if of.against is None
        else "Each figure tells how far these captures are from the others in all that is looked "
        "at, before and after what simulation says of the accepted effects is taken off."
    )
    said = (
        f"Measured on {counted(len(of.locked), 'scene')} that had no say in what is named. {tells} "
        "Floor: that of two simulated captures by two devices of the kind, and, where their "
        "matcher reads finer bits than images have, by these. Closed: before less after, over "
        "before less floor; above 100 % what is left is less than two devices differ by, below "
        "0 % it is more than before."
    )
    stand_ins = (
        "Stand-ins are among what is named: what they close tells how well they imitate something "
        "unknown, not that they are there."
    )
    return (
        prose(said)
        + (prose(stand_ins) if sentences.with_stand_ins(of) else "")
        + _closings(of.howfar.figures)
        + "".join(_figure(name, one, bound.get(name)) for name, one in of.howfar.figures.items())
        + _shares(of.howfar.shares)
        + learnt
    )


def _closings(figures: Mapping[str, Closed]) -> str:
    """What is closed of every figure side by side, where that can be told."""
    bars = []
    for name, one in figures.items():
        if one.closed_pct is None:
            continue
        low, high = (math.nan, math.nan) if one.interval is None else one.interval
        bars.append(
            Bar(
                name=TITLES.get(name, name.capitalize()),
                value=_shown(one.closed_pct),
                told=f"{number(one.closed_pct, '.0f')} %",
                low=_shown(low),
                high=_shown(high),
                kind="third",
            )
        )
    if not bars:
        return ""
    said = "Closed, in percent, with 95 % intervals; bars end at -50 and 150 at most."
    return f"<h4>All figures</h4>{prose(said)}{chart(bars, line=100.0)}"


def _shown(percent: float) -> float:
    """Where a bar ends, so that a wide one does not squeeze all others."""
    return float(np.clip(percent, -50.0, 150.0))


def _figure(name: str, one: Closed, bound: float | None) -> str:
    drawn = _bars(before=one.before, after=one.after, floor=one.floor, bound=bound)
    return f"<h4>{_title(name)}</h4><p>{escape(_closed(one))}</p>{drawn}"


def _bars(**values: float | None) -> str:
    return chart(
        [
            Bar(name=name, value=value, told=number(value), kind=_KINDS.get(name, "first"))
            for name, value in values.items()
            if value is not None
        ]
    )


def _title(name: str) -> str:
    if name in TITLES:
        return f"{escape(TITLES[name])} <code>{escape(name)}</code>"
    return escape(name.capitalize())


def _closed(one: Closed) -> str:
    if one.closed_pct is None:
        return "Not identifiable: before and floor do not differ for sure."
    said = f"Closed by {number(one.closed_pct, '.0f')} %"
    if one.interval is None:
        return f"{said}; fewer than three rooms give no interval."
    return f"{said}, 95 % interval {interval(*one.interval, '.0f')} %."


def _shares(shares: dict[str, float]) -> str:
    if not shares:
        return ""
    bars = [
        Bar(name=name, value=100 * share, told=f"{number(100 * share, '.0f')} %", kind="third")
        for name, share in shares.items()
    ]
    return (
        "<h3>Share of each effect</h3>"
        + prose("Of what the accepted effects of a half close together in its features (Shapley).")
        + chart(bars)
    )
