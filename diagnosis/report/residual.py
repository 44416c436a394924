"""What a learned residual reaches, as a part of a page."""

from __future__ import annotations

from html import escape

from calibration.report.elements import number
from diagnosis.howfar.residual import Absorption, Residual
from diagnosis.report.elements import Bar, chart, interval, prose


def section(of: Residual) -> str:
    """Write what the bound is, and how much of the residual effects take over, as HTML."""
    said = (
        "A network was trained on the scenes that were asked, to correct where the sensor at hand "
        "has no depth in simulation, and judged on the locked ones: that is the bound. So much, if "
        "not more, can be closed by anything that knows what the network knows; what effects leave "
        "above it is still to be explained."
    )
    absorbed = "" if of.absorption is None else _absorption(of.absorption)
    return f"<h3>What a learned residual reaches</h3>{prose(said)}{absorbed}"


def _absorption(of: Absorption) -> str:
    said = (
        "Trained again with the accepted effects in, the network has less left to gain where they "
        "are true, and as much as before where they stand in for something else. Gain: Brier score "
        "of holes without the network less that with it."
    )
    bars = [
        Bar(name="before", value=of.gain_before, told=number(of.gain_before)),
        Bar(name="after", value=of.gain_after, told=number(of.gain_after), kind="second"),
    ]
    return f"<h4>Gain of the network</h4>{prose(said)}<p>{escape(_taken_over(of))}</p>{chart(bars)}"


def _taken_over(of: Absorption) -> str:
    if of.share is None:
        return "Not identifiable: on the sensor at hand the network does not gain for sure."
    said = f"Taken over by the effects: {number(100 * of.share, '.0f')} %"
    if of.interval is None:
        return f"{said}; one scene gives no interval."
    low, high = of.interval
    return f"{said}, 95 % interval {interval(100 * low, 100 * high, '.0f')} %."
