"""Report section on how far the accepted effects close the gap."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape

import numpy as np

from starling.diagnosis.diagnosis import Diagnosis
from starling.diagnosis.howfar.evaluation import Evaluation
from starling.diagnosis.howfar.reduction import GapReduction
from starling.diagnosis.howfar.residual import Absorption, LearnedResidual
from starling.sim.report.elements import Bar, Kind, chart, counted, interval, number, prose, table

_KINDS: dict[str, Kind] = {"after": "second", "floor": "part", "bound": "third"}
TITLES = {
    "ndp_brier": "Holes: Brier score",
    "ndp_1_auc": "Holes: 1 minus area under the ROC curve",
    "ndp_ece": "Holes: expected calibration error",
    "ndp_1_iou": "Holes: 1 minus intersection over union",
    "bias_px": "Disparity: difference of bias [px]",
    "log_nmad": "Disparity: log ratio of spreads (NMAD)",
    "error_distribution_px": "Disparity: distance of error distributions [px]",
    "dot_contrast": "Infrared: difference of dot contrast",
    "infrared_nll": "Infrared: negative log-likelihood per pixel",
    "log_noise_in_time": "Infrared: log ratio of temporal noise",
}


def section(diagnosis: Diagnosis) -> str:
    """Write the section as HTML."""
    residual = diagnosis.residual
    learned = "" if residual is None else _learned(residual)
    bound = {} if residual is None else residual.bound
    if diagnosis.howfar is None or not diagnosis.howfar.figures:
        before = {} if residual is None else residual.alone
        why = (
            "no scene is held out"
            if not diagnosis.held_out
            else "no effect is reported whose contribution can be measured"
        )
        return (
            prose(f"The gap reduction was not evaluated: {why}.")
            + _alone(diagnosis.howfar)
            + "".join(
                f"<h4>{_title(name)}</h4>{_bars(before=before[name], bound=bound[name])}"
                for name in bound
            )
            + learned
        )
    distance = (
        "Each figure is a distance between simulated and real captures; less is better."
        if diagnosis.against is None
        else "Each figure is a distance between these captures and the others over all features: "
        "before, and after the simulated change of the accepted effects is subtracted."
    )
    text = (
        f"Measured on {counted(len(diagnosis.held_out), 'held-out scene')}. {distance} "
        "Floor: the distance between simulated captures by two devices of the same model. If the "
        "device's matcher reads more bits than stored images have, the floor includes these bits. "
        "Gap reduction: (before minus after) over (before minus floor). Above 100 %, the remaining "
        "gap is smaller than the difference of two devices; below 0 %, the gap has grown."
    )
    return (
        prose(text)
        + _overview(diagnosis.howfar.figures)
        + "".join(
            _figure(name, reduction, bound.get(name))
            for name, reduction in diagnosis.howfar.figures.items()
        )
        + _alone(diagnosis.howfar)
        + _shares(diagnosis.howfar.shares)
        + learned
    )


def _alone(evaluation: Evaluation | None) -> str:
    """List what each accepted effect closes by itself, also surrogates."""
    if evaluation is None:
        return ""
    names = list(dict.fromkeys(name for each in evaluation.alone.values() for name in each))
    rows = [
        [f"<code>{escape(effect)}</code>", *(_closed(figures.get(name)) for name in names)]
        for effect, figures in evaluation.alone.items()
    ]
    if not names or not rows:
        return ""
    text = "Gap reduction in percent by each accepted effect alone, surrogates included."
    head = ["Effect", *(f"<code>{escape(name)}</code>" for name in names)]
    return f"<h3>Each effect by itself</h3>{prose(text)}{table(head, rows)}"


def _closed(reduction: GapReduction | None) -> str:
    if reduction is None or reduction.closed_pct is None:
        return ""
    return number(reduction.closed_pct, ".0f")


def _overview(figures: Mapping[str, GapReduction]) -> str:
    """Draw the reduction of every figure in one chart, where it is identifiable."""
    bars = []
    for name, reduction in figures.items():
        if reduction.closed_pct is None:
            continue
        low, high = (math.nan, math.nan) if reduction.interval is None else reduction.interval
        bars.append(
            Bar(
                name=TITLES.get(name, name.capitalize()),
                value=_clipped(reduction.closed_pct),
                text=f"{number(reduction.closed_pct, '.0f')} %",
                low=_clipped(low),
                high=_clipped(high),
                kind="third",
            )
        )
    if not bars:
        return ""
    text = "Gap reduction in percent with 95 % intervals. Bars are clipped to -50 and 150."
    return f"<h4>All figures</h4>{prose(text)}{chart(bars, line=100.0)}"


def _clipped(percent: float) -> float:
    """Limit a bar's end, so that one long bar does not compress all others."""
    return float(np.clip(percent, -50.0, 150.0))


def _figure(name: str, reduction: GapReduction, bound: float | None) -> str:
    drawn = _bars(
        before=reduction.before, after=reduction.after, floor=reduction.floor, bound=bound
    )
    return f"<h4>{_title(name)}</h4><p>{escape(_sentence(reduction))}</p>{drawn}"


def _bars(**values: float | None) -> str:
    return chart(
        [
            Bar(name=name, value=value, text=number(value), kind=_KINDS.get(name, "first"))
            for name, value in values.items()
            if value is not None
        ]
    )


def _title(name: str) -> str:
    if name in TITLES:
        return f"{escape(TITLES[name])} <code>{escape(name)}</code>"
    return escape(name.capitalize())


def _sentence(reduction: GapReduction) -> str:
    if reduction.closed_pct is None:
        return "Not identifiable: before and floor do not differ significantly."
    text = f"Gap reduction {number(reduction.closed_pct, '.0f')} %"
    if reduction.interval is None:
        return f"{text}; fewer than three rooms give no interval."
    return f"{text}, 95 % interval {interval(*reduction.interval, '.0f')} %."


def _shares(shares: dict[str, float]) -> str:
    if not shares:
        return ""
    bars = [
        Bar(name=name, value=100 * share, text=f"{number(100 * share, '.0f')} %", kind="third")
        for name, share in shares.items()
    ]
    return (
        "<h3>Share of each effect</h3>"
        + prose(
            "Shapley share of each accepted effect in the gap reduction of its segment's features."
        )
        + chart(bars)
    )


def _learned(residual: LearnedResidual) -> str:
    """Write the bound and the share of the residual that effects absorb as HTML."""
    bound = (
        "A network was trained to correct the simulated no-depth pixels on the scenes that were "
        "not held out. Its figures on the held-out scenes are the bound: any model with the same "
        "inputs can close as much of the gap."
    )
    gain = (
        "The gain of the network is the Brier score of holes without it minus that with it. "
        "Before: its gain on the base. After: its gain with the accepted effects applied. "
        "Floor: its gain if another simulated capture replaces the real one, so that there is no "
        "gap. The network gains there too, because it learns how uncertain a few simulated draws "
        "are. After is near the floor if the effects are true, and near before if they are "
        "surrogates."
    )
    absorption = residual.absorption
    before, floor = absorption.gain_before, absorption.gain_floor
    bars = [Bar(name="before", value=before, text=number(before))]
    if absorption.gain_after is not None:
        after = absorption.gain_after
        bars.append(Bar(name="after", value=after, text=number(after), kind="second"))
    bars.append(Bar(name="floor", value=floor, text=number(floor), kind="part"))
    return (
        f"<h3>Bound by a learned residual</h3>{prose(bound)}<h4>Gain of the network</h4>"
        f"{prose(gain)}<p>{escape(_absorbed(absorption))}</p>{chart(bars)}"
    )


def _absorbed(absorption: Absorption) -> str:
    if not absorption.closable:
        return "Not identifiable: before and floor do not differ significantly."
    if absorption.share is None:
        return "No accepted effect could absorb the residual."
    text = f"Absorbed by the effects: {number(100 * absorption.share, '.0f')} %"
    if absorption.interval is None:
        return f"{text}; fewer than three rooms give no interval."
    low, high = absorption.interval
    return f"{text}, 95 % interval {interval(100 * low, 100 * high, '.0f')} %."
