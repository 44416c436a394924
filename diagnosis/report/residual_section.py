"""What a learned residual reaches, as a part of a page."""

from __future__ import annotations

from html import escape

from starling.diagnosis.howfar.residual import Absorption, Residual
from starling.diagnosis.report.elements import Bar, chart, interval, prose
from starling.sim.report.elements import number


def section(of: Residual) -> str:
    """Write what the bound is, and how much of the residual effects take over, as HTML."""
    bound = (
        "A network was trained on the scenes that were asked, to correct where the sensor at hand "
        "has no depth in simulation, and judged on the locked ones: that is the bound. Anything "
        "that knows what the network knows can close as much."
    )
    gain = (
        "Its gain is the Brier score of holes without it less that with it. Floor: its gain where "
        "another simulated capture stands for the real one, so that nothing is off; it learns how "
        "sure a few draws are. After: its gain with the accepted effects in, near floor where they "
        "are true, and as before where they stand in for something else."
    )
    one = of.absorption
    bars = [Bar(name="before", value=one.gain_before, told=number(one.gain_before))]
    if one.gain_after is not None:
        bars.append(
            Bar(name="after", value=one.gain_after, told=number(one.gain_after), kind="second")
        )
    bars.append(Bar(name="floor", value=one.gain_floor, told=number(one.gain_floor), kind="part"))
    return (
        f"<h3>What a learned residual reaches</h3>{prose(bound)}<h4>Gain of the network</h4>"
        f"{prose(gain)}<p>{escape(_taken_over(one))}</p>{chart(bars)}"
    )


def _taken_over(of: Absorption) -> str:
    if not of.closable:
        return "Not identifiable: before and floor do not differ for sure."
    if of.share is None:
        return "No effect is accepted that could take it over."
    said = f"Taken over by the effects: {number(100 * of.share, '.0f')} %"
    if of.interval is None:
        return f"{said}; fewer than three rooms give no interval."
    low, high = of.interval
    return f"{said}, 95 % interval {interval(100 * low, 100 * high, '.0f')} %."
