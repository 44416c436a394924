"""Report section on the learned residual."""

from __future__ import annotations

from html import escape

from starling.diagnosis.howfar.residual import Absorption, LearnedResidual
from starling.diagnosis.report.elements import Bar, chart, interval, prose
from starling.sim.report.elements import number


def section(residual: LearnedResidual) -> str:
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
