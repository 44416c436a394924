"""Bars of parts in a report."""

from __future__ import annotations

import math
import re

from starling.sim.report.elements import Stack, stacks


def test_parts_fill_the_bar() -> None:
    html = stacks(
        [Stack(name="a <b>", shares=(0.25, 0.75), text="x & y")], ["first part", "second part"]
    )
    widths = re.findall(r'class="part(\d)" style="left:([\d.]+)%;width:([\d.]+)%"', html)
    assert widths == [("0", "0.00", "25.00"), ("1", "25.00", "75.00")]
    assert 'aria-label="first part 25 %, second part 75 %"' in html
    assert "a &lt;b&gt;" in html and "x &amp; y" in html


def test_unknown_and_negative_parts_have_no_width() -> None:
    html = stacks([Stack(name="a", shares=(-0.1, math.nan, 0.5), text="")], ["x", "y", "z"])
    assert re.findall(r"width:([\d.]+)%", html) == ["0.00", "0.00", "100.00"]
    nothing = stacks([Stack(name="a", shares=(0.0, math.nan), text="")], ["x", "y"])
    assert re.findall(r"width:([\d.]+)%", nothing) == ["0.00", "0.00"]
