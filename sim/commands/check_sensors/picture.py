"""Picture of the noise of cameras against distance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from starling.sim.plotting import sheet
from starling.sim.plotting.panels import INK

if TYPE_CHECKING:
    from starling.sim.commands.check_sensors.check import CheckedCamera

_GRID = "#dfe2e6"
_SIZE_IN = (7.2, 4.4)
_DPI = 100
_LEGEND_COLUMNS = 4
_MARKERS = "osD^v"


def draw(cameras: Sequence[CheckedCamera]) -> bytes:
    """Draw the plane-fit RMS against distance as PNG bytes, both logarithmic."""
    from matplotlib import colormaps
    from matplotlib.ticker import LogLocator, StrMethodFormatter

    figure = sheet.new_figure(_SIZE_IN, _DPI, layout="constrained")
    axes = figure.add_subplot()
    colours = colormaps["plasma"]
    distances_m: list[float] = []
    for number, camera in enumerate(cameras):
        distances_m = list(camera.noise_mm)
        axes.plot(
            distances_m,
            [camera.noise_mm[z] for z in distances_m],
            f"{_MARKERS[number % len(_MARKERS)]}-",
            color=colours(0.05 + 0.8 * number / max(1, len(cameras) - 1)),
            ms=6,
            mfc="none",  # Cameras of equal noise hide each other.
            lw=1.4,
            label=camera.preset,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(distances_m, [f"{z:g}" for z in distances_m])
    axes.minorticks_off()
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 3)))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.grid(color=_GRID, lw=0.7)
    axes.set_xlabel("distance [m]", color=INK)
    axes.set_title("plane-fit RMS of a flat target [mm]", loc="left", fontsize=11, color=INK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=9.5, color=INK, labelcolor=INK)
    rows = math.ceil(len(cameras) / _LEGEND_COLUMNS)
    figure.legend(
        loc="outside lower center",
        ncols=math.ceil(len(cameras) / rows),
        frameon=False,
        fontsize=9,
        labelcolor=INK,
    )
    return sheet.encode(figure)
