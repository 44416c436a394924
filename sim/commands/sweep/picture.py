"""Picture of a sweep: one row per axis with depth noise, holes and reasons of holes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from starling.sim.commands.sweep import axes as sweep_axes
from starling.sim.commands.sweep.axes import AXES, Camera
from starling.sim.commands.sweep.figures import BEHIND, Figures, nearest_m
from starling.sim.plotting import sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from starling.sim.commands.sweep.figures import Sweep

# Reasons for missing depth, grouped by what a camera designer can change: colour and reasons.
GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "outside the overlap": ("#1f5fa8", ("outside_overlap",)),
    "occluded from the right imager": ("#4cb0ea", ("occluded",)),
    "shadowed from the projector": ("#2e9e6b", ("shadowed",)),
    "too little or too much light": ("#f2c21a", ("low_signal", "saturated")),
    "refused by the matcher": (
        "#8a4fa8",
        ("ambiguous", "left_right", "support", "speckle", "post_filter", "out_of_range"),
    ),
    "no surface": ("#5f656d", ("no_surface", "unknown")),
}
_WRONG = ("depth off by more than 1 px", "#e8590c")
_INK = "#23262b"
_GRID = "#dfe2e6"
_ROW_IN = 3.2
_WIDTH_IN = 15.0
_HEAD_IN = 1.25
_FOOT_IN = 0.75
_DPI = 100


def draw(result: Sweep) -> bytes:
    """Draw a sweep as PNG bytes.

    A row shows the cameras that differ from the base in its axis only. The other combinations of
    a full factorial sweep are in the tables only.
    """
    shown = {name: sweep_axes.along(name, result.cameras) for name in AXES}
    rows = {name: cameras for name, cameras in shown.items() if len(cameras) > 1}
    rows = rows or {next(iter(AXES)): list(result.cameras)}  # Only the base.
    height = _HEAD_IN + _FOOT_IN + _ROW_IN * len(rows)
    figure = sheet.new_figure((_WIDTH_IN, height), _DPI)
    grid = figure.add_gridspec(
        len(rows),
        3,
        left=0.055,
        right=0.985,
        top=1 - _HEAD_IN / height,
        bottom=_FOOT_IN / height,
        hspace=0.44,
        wspace=0.26,
    )
    for number, (name, cameras) in enumerate(rows.items()):
        noise, holes, reasons = (figure.add_subplot(grid[number, column]) for column in range(3))
        _noise(noise, result, name, cameras)
        _holes(holes, result, name, cameras)
        _reasons(reasons, result, name, cameras)
        place = noise.get_position()
        above = {"x": 0.012, "y": place.y1 + 0.36 / height, "s": AXES[name].label}
        figure.text(**above, fontsize=12.5, weight="bold", color=_INK)
        last = number == len(rows) - 1
        for axes in (noise, holes):
            axes.set_xlabel("distance [m]" if last else "")
        reasons.set_xlabel("share of the image [%]" if last else "")
    _headings(figure, result, height)
    return sheet.encode(figure)


def _headings(figure: Any, result: Sweep, height: float) -> None:
    base = result.cameras[0]
    base_values = ", ".join(
        f"{axis.word} {axis.shown(base.values[name])}" for name, axis in AXES.items()
    )
    top = 1 - 0.08 / height
    heading = f"Cameras about the {base.sensor.name}: {base_values}"
    figure.text(0.012, top, heading, fontsize=14, weight="bold", color=_INK, va="top")
    reference_m = result.distances_m[result.reference]
    sigma = "\N{GREEK SMALL LETTER SIGMA}"
    law = (
        f"Solid: simulated. Dashed, left: the law z\N{SUPERSCRIPT TWO} {sigma} / (f b), {sigma} = "
        f"{result.sigma_d_px:.3f} px measured on the base at {reference_m:g} m; middle: what the "
        "right imager or the projector cannot see. Dotted: end of the matcher's search."
    )
    figure.text(0.012, top - 0.3 / height, law, fontsize=10.5, color=_INK, va="top")
    from matplotlib.patches import Patch

    listed = {word: colour for word, (colour, _) in GROUPS.items()} | dict([_WRONG])
    figure.legend(
        handles=[Patch(color=colour, label=word) for word, colour in listed.items()],
        loc="lower right",
        bbox_to_anchor=(0.99, 0.0),
        ncols=len(listed),
        frameon=False,
        fontsize=10,
        handlelength=1.0,
        columnspacing=1.2,
    )


def _noise(axes: Axes, result: Sweep, name: str, cameras: Sequence[Camera]) -> None:
    """Depth noise against distance, both logarithmic, with the law dashed."""
    from matplotlib.ticker import LogLocator, StrMethodFormatter

    for camera, colour in zip(cameras, _colours(result, cameras), strict=True):
        figures = result.figures_of(camera)
        noise = [1e3 * point.noise_m for point in figures]
        law = [1e3 * value for value in result.law_m(camera)]
        label = AXES[name].shown(camera.values[name])
        axes.plot(result.distances_m, noise, "o-", color=colour, ms=3.5, lw=1.6, label=label)
        axes.plot(result.distances_m, law, "--", color=colour, lw=1.0)
        if nearest_m(camera.sensor) > result.distances_m[0]:
            axes.axvline(nearest_m(camera.sensor), color=colour, lw=1.0, ls=":")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 3)))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    _finish(axes, result, "depth noise on a wall [mm]")
    _legend(axes, result, name)


def _holes(axes: Axes, result: Sweep, name: str, cameras: Sequence[Camera]) -> None:
    """Share of pixels without depth against distance; dashed: pixels hidden by geometry."""
    for camera, colour in zip(cameras, _colours(result, cameras), strict=True):
        figures = result.figures_of(camera)
        rate = [100 * point.hole_rate for point in figures]
        unseen = [100 * point.unseen for point in figures]
        label = AXES[name].shown(camera.values[name])
        axes.plot(result.distances_m, rate, "o-", color=colour, ms=3.5, lw=1.6, label=label)
        axes.plot(result.distances_m, unseen, "--", color=colour, lw=1.0)
    axes.set_ylim(0, None)
    _finish(axes, result, f"holes, posts before a wall {BEHIND:g}x as far [%]")


def _reasons(axes: Axes, result: Sweep, name: str, cameras: Sequence[Camera]) -> None:
    """Shares of missing depth by reason, and of wrong depth, at the reference distance."""
    labels = [AXES[name].shown(camera.values[name]) for camera in cameras]
    points: list[Figures] = [result.figures_of(camera)[result.reference] for camera in cameras]
    start = [0.0] * len(cameras)
    for colour, causes in GROUPS.values():
        shares = [100 * sum(point.holes[cause] for cause in causes) for point in points]
        axes.barh(labels, shares, left=start, color=colour, height=0.7)
        start = [low + share for low, share in zip(start, shares, strict=True)]
    axes.barh(
        labels, [100 * point.wrong for point in points], left=start, color=_WRONG[1], height=0.7
    )
    axes.invert_yaxis()
    title = f"holes by reason, and wrong depth, at {result.distances_m[result.reference]:g} m [%]"
    axes.set_title(title, loc="left", fontsize=11, color=_INK)
    axes.grid(axis="x", color=_GRID, lw=0.7)
    axes.set_axisbelow(True)
    _plain(axes)


def _colours(result: Sweep, cameras: Sequence[Camera]) -> list[Any]:
    """Return colours: black for the base, dark to light with increasing value for the others."""
    from matplotlib import colormaps

    others = [camera for camera in cameras if camera is not result.cameras[0]]
    steps = max(1, len(others) - 1)
    ramp = {id(camera): 0.05 + 0.8 * n / steps for n, camera in enumerate(others)}
    plasma = colormaps["plasma"]
    return [plasma(ramp[id(camera)]) if id(camera) in ramp else _INK for camera in cameras]


def _legend(axes: Axes, result: Sweep, name: str) -> None:
    base_label = AXES[name].shown(result.cameras[0].values[name])
    legend = axes.legend(fontsize=9, frameon=False, loc="upper left", handlelength=1.4)
    for text in legend.get_texts():
        if text.get_text() == base_label:
            text.set_text(f"{base_label} (base)")


def _finish(axes: Axes, result: Sweep, title: str) -> None:
    axes.set_xscale("log")
    axes.set_xticks(result.distances_m, [f"{z:g}" for z in result.distances_m])
    axes.minorticks_off()
    axes.grid(color=_GRID, lw=0.7)
    axes.set_title(title, loc="left", fontsize=11, color=_INK)
    _plain(axes)


def _plain(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=9.5, color=_INK, labelcolor=_INK)
