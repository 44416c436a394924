"""The picture of a sweep: a row for each axis; depth noise by its law, holes, their reasons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from starling.sim.commands.sweep import axes as sweep_axes
from starling.sim.commands.sweep.axes import AXES, Camera
from starling.sim.commands.sweep.figures import BEHIND, Figures, nearest_m
from starling.sim.plotting import canvas

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from starling.sim.commands.sweep.result import Sweep

# What keeps a pixel from having depth, in groups that a designer can do something about.
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


def draw(found: Sweep) -> bytes:
    """Draw a sweep as PNG bytes.

    A row holds the cameras that differ from the base in its axis alone; of a full factorial the
    other combinations are in the tables only.
    """
    shown = {name: sweep_axes.along(name, found.cameras) for name in AXES}
    rows = {name: cameras for name, cameras in shown.items() if len(cameras) > 1}
    rows = rows or {next(iter(AXES)): list(found.cameras)}  # The base alone.
    height = _HEAD_IN + _FOOT_IN + _ROW_IN * len(rows)
    figure = canvas.empty((_WIDTH_IN, height), _DPI)
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
        _noise(noise, found, name, cameras)
        _holes(holes, found, name, cameras)
        _reasons(reasons, found, name, cameras)
        place = noise.get_position()
        above = {"x": 0.012, "y": place.y1 + 0.36 / height, "s": AXES[name].label}
        figure.text(**above, fontsize=12.5, weight="bold", color=_INK)
        last = number == len(rows) - 1
        for axes in (noise, holes):
            axes.set_xlabel("distance [m]" if last else "")
        reasons.set_xlabel("share of the image [%]" if last else "")
    _headings(figure, found, height)
    return canvas.encoded(figure)


def _headings(figure: Any, found: Sweep, height: float) -> None:
    base = found.cameras[0]
    own = ", ".join(f"{axis.word} {axis.shown(base.values[name])}" for name, axis in AXES.items())
    top = 1 - 0.08 / height
    said = f"Cameras about the {base.sensor.name}: {own}"
    figure.text(0.012, top, said, fontsize=14, weight="bold", color=_INK, va="top")
    reference_m = found.distances_m[found.reference]
    sigma = "\N{GREEK SMALL LETTER SIGMA}"
    law = (
        f"Solid: simulated. Dashed, left: the law z\N{SUPERSCRIPT TWO} {sigma} / (f b), {sigma} = "
        f"{found.sigma_d_px:.3f} px measured on the base at {reference_m:g} m; middle: what the "
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


def _noise(axes: Axes, found: Sweep, name: str, cameras: Sequence[Camera]) -> None:
    """Depth noise against distance, both logarithmic, with the law dashed."""
    from matplotlib.ticker import LogLocator, StrMethodFormatter

    for camera, colour in zip(cameras, _colours(found, cameras), strict=True):
        figures = found.of(camera)
        noise = [1e3 * point.noise_m for point in figures]
        law = [1e3 * value for value in found.law_m(camera)]
        label = AXES[name].shown(camera.values[name])
        axes.plot(found.distances_m, noise, "o-", color=colour, ms=3.5, lw=1.6, label=label)
        axes.plot(found.distances_m, law, "--", color=colour, lw=1.0)
        if nearest_m(camera.sensor) > found.distances_m[0]:
            axes.axvline(nearest_m(camera.sensor), color=colour, lw=1.0, ls=":")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 3)))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    _finish(axes, found, "depth noise on a wall [mm]")
    _legend(axes, found, name)


def _holes(axes: Axes, found: Sweep, name: str, cameras: Sequence[Camera]) -> None:
    """Share of pixels without depth against distance, what geometry hides dashed."""
    for camera, colour in zip(cameras, _colours(found, cameras), strict=True):
        figures = found.of(camera)
        rate = [100 * point.hole_rate for point in figures]
        unseen = [100 * point.unseen for point in figures]
        label = AXES[name].shown(camera.values[name])
        axes.plot(found.distances_m, rate, "o-", color=colour, ms=3.5, lw=1.6, label=label)
        axes.plot(found.distances_m, unseen, "--", color=colour, lw=1.0)
    axes.set_ylim(0, None)
    _finish(axes, found, f"holes, posts before a wall {BEHIND:g}x as far [%]")


def _reasons(axes: Axes, found: Sweep, name: str, cameras: Sequence[Camera]) -> None:
    """Why pixels have no depth, and how many a wrong one, at the reference distance."""
    labels = [AXES[name].shown(camera.values[name]) for camera in cameras]
    points: list[Figures] = [found.of(camera)[found.reference] for camera in cameras]
    start = [0.0] * len(cameras)
    for colour, causes in GROUPS.values():
        shares = [100 * sum(point.holes[cause] for cause in causes) for point in points]
        axes.barh(labels, shares, left=start, color=colour, height=0.7)
        start = [low + share for low, share in zip(start, shares, strict=True)]
    axes.barh(
        labels, [100 * point.wrong for point in points], left=start, color=_WRONG[1], height=0.7
    )
    axes.invert_yaxis()
    title = f"holes by reason, and wrong depth, at {found.distances_m[found.reference]:g} m [%]"
    axes.set_title(title, loc="left", fontsize=11, color=_INK)
    axes.grid(axis="x", color=_GRID, lw=0.7)
    axes.set_axisbelow(True)
    _plain(axes)


def _colours(found: Sweep, cameras: Sequence[Camera]) -> list[Any]:
    """The base is black; the others go from dark to light with their value."""
    from matplotlib import colormaps

    others = [camera for camera in cameras if camera is not found.cameras[0]]
    steps = max(1, len(others) - 1)
    ramp = {id(camera): 0.05 + 0.8 * n / steps for n, camera in enumerate(others)}
    plasma = colormaps["plasma"]
    return [plasma(ramp[id(camera)]) if id(camera) in ramp else _INK for camera in cameras]


def _legend(axes: Axes, found: Sweep, name: str) -> None:
    own = AXES[name].shown(found.cameras[0].values[name])
    legend = axes.legend(fontsize=9, frameon=False, loc="upper left", handlelength=1.4)
    for text in legend.get_texts():
        if text.get_text() == own:
            text.set_text(f"{own} (base)")


def _finish(axes: Axes, found: Sweep, title: str) -> None:
    axes.set_xscale("log")
    axes.set_xticks(found.distances_m, [f"{z:g}" for z in found.distances_m])
    axes.minorticks_off()
    axes.grid(color=_GRID, lw=0.7)
    axes.set_title(title, loc="left", fontsize=11, color=_INK)
    _plain(axes)


def _plain(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=9.5, color=_INK, labelcolor=_INK)
