"""Panels of capture pictures, each drawn on one matplotlib axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from starling.sim.arrays import Image, Labels
from starling.sim.captures.png import GreyImage
from starling.sim.reason import LABELS, Reason

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK = "#23262b"
ERROR_LIMIT_PX = 1.0
BAR_IN = 0.62  # Height of a scale bar below its panel [inch].
_LEAST_SPAN = 0.05  # Least depth range, relative to depth, so that noise does not fill the scale.
_LEGEND_COLUMNS = 3
_LEGEND_LINE_IN = 0.2
_HOLE = "#ffffff"  # Not a colour of the maps below.
_FRAME = "#c9ccd1"
_DEPTH_COLOURS = "viridis_r"  # Perceptually uniform; near is bright.
_ERROR_COLOURS = "RdBu_r"
_UNKNOWN_TRUTH = "#d8dade"

# Geometric causes are blue to green, photometric ones yellow to red, the matcher's purple to brown.
# Unknown causes are grey.
REASON_COLOURS: dict[Reason, str] = {
    Reason.VALID: "#f1f2f4",
    Reason.NO_SURFACE: "#0b2545",
    Reason.OUTSIDE_OVERLAP: "#1f5fa8",
    Reason.OCCLUDED: "#4cb0ea",
    Reason.SHADOWED: "#2e9e6b",
    Reason.LOW_SIGNAL: "#f2c21a",
    Reason.SATURATED: "#e8590c",
    Reason.AMBIGUOUS: "#6a3fb5",
    Reason.LEFT_RIGHT: "#d04fa8",
    Reason.SUPPORT: "#8a5a34",
    Reason.SPECKLE: "#d3a06c",
    Reason.POST_FILTER: "#9b1d3a",
    Reason.OUT_OF_RANGE: "#7fb7a6",
    Reason.UNKNOWN: "#5f656d",
}


def infrared_limits(image: GreyImage) -> tuple[float, float]:
    """Choose the range of shown levels [DN], in which highlights may saturate."""
    low, high = np.percentile(image, (0.5, 99.7))
    return float(low), float(max(high, low + 1))


def depth_limits(*depths_m: Image | None) -> tuple[float, float]:
    """Choose the range of shown depth over several images [m]."""
    known = [depth[np.isfinite(depth)] for depth in depths_m if depth is not None]
    values = np.concatenate([*known, np.empty(0, np.float32)])
    if values.size == 0:
        return 0.0, 1.0
    near, far = np.percentile(values, (0.5, 99.5))
    widen = max(0.0, _LEAST_SPAN * near - (far - near)) / 2
    return float(near - widen), float(far + widen)


def infrared(axes: Axes, image: GreyImage, limits: tuple[float, float], title: str) -> None:
    """Draw an infrared image; a square root brightens dark surfaces."""
    low, high = limits
    shown = np.sqrt(np.clip((image.astype(np.float32) - low) / (high - low), 0, 1))
    axes.imshow(shown, cmap="gray", vmin=0, vmax=1, interpolation="antialiased")
    finish(axes, title, f"mean {image.mean():.1f} DN, shown {low:.0f} to {high:.0f} DN")


def depth(axes: Axes, depth_m: Image, limits: tuple[float, float], title: str) -> None:
    """Draw depth with a scale bar in metres; holes are white."""
    shown = axes.imshow(
        depth_m,
        cmap=_map(_DEPTH_COLOURS, _HOLE),
        vmin=limits[0],
        vmax=limits[1],
        interpolation="nearest",
    )
    missing = float(np.isnan(depth_m).mean())
    finish(axes, title, f"white: none, {missing:.1%}")
    _bar(axes, shown, "depth [m]")


def legend_in(reason: Labels) -> float:
    """Height of the legend of `reasons` below its panel [inch]."""
    lines = -(-len(np.unique(reason)) // _LEGEND_COLUMNS)
    return 0.15 + lines * _LEGEND_LINE_IN


def reasons(axes: Axes, reason: Labels, title: str) -> None:
    """Draw the reasons of missing depth, with a legend of their shares."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    colours = ListedColormap([REASON_COLOURS[code] for code in Reason])
    axes.imshow(reason, cmap=colours, vmin=-0.5, vmax=len(Reason) - 0.5, interpolation="nearest")
    counts = np.bincount(np.minimum(reason.ravel(), Reason.UNKNOWN), minlength=len(Reason))
    handles = [
        Patch(
            facecolor=REASON_COLOURS[code],
            edgecolor=_FRAME,
            label=f"{LABELS[code]} {_share(counts[code] / reason.size)}",
        )
        for code in Reason
        if counts[code]
    ]
    finish(axes, title, f"{1 - counts[0] / reason.size:.1%} without depth")
    axes.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        ncols=min(_LEGEND_COLUMNS, len(handles)),
        frameon=False,
        fontsize=8,
        labelcolor=INK,
        handlelength=1.1,
        handleheight=1.1,
        columnspacing=0.9,
    )


def error(axes: Axes, error_px: Image, title: str) -> None:
    """Draw the disparity error against truth; grey where either is unknown."""
    shown = axes.imshow(
        error_px,
        cmap=_map(_ERROR_COLOURS, _UNKNOWN_TRUTH),
        vmin=-ERROR_LIMIT_PX,
        vmax=ERROR_LIMIT_PX,
        interpolation="nearest",
    )
    known = error_px[np.isfinite(error_px)]
    note = "no pixel has both"
    if known.size:
        median = float(np.median(known))
        nmad = 1.4826 * float(np.median(np.abs(known - median)))
        note = f"median {median:+.3f} px, NMAD {nmad:.3f} px; grey: unknown"
    finish(axes, title, note)
    _bar(axes, shown, "disparity error [px]; red: too near")


def finish(axes: Axes, title: str, note: str) -> None:
    """Set a panel's heading and frame."""
    axes.set_title(title, loc="left", fontsize=11, fontweight="bold", color=INK, pad=6)
    axes.set_title(note, loc="right", fontsize=8.5, color="#6b7178", pad=6)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(_FRAME)


def _share(share: float) -> str:
    return f"{share:.1%}" if share >= 0.0005 else "<0.1%"


def _map(name: str, missing: str) -> Any:
    from matplotlib import colormaps

    return colormaps[name].with_extremes(bad=missing)


def _bar(axes: Axes, shown: Any, label: str) -> None:
    """Add a scale bar below the panel, so that all panels have equal widths."""
    figure = axes.get_figure(root=True)
    assert figure is not None  # Axes belong to a figure.
    height_in = figure.get_size_inches()[1] * axes.get_position().height
    place = axes.inset_axes((0.0, -0.21 / height_in, 1.0, 0.11 / height_in))
    bar = figure.colorbar(shown, cax=place, orientation="horizontal", extend="both")
    bar.outline.set_edgecolor(_FRAME)
    bar.ax.tick_params(labelsize=8.5, colors=INK, length=3, pad=2)
    bar.set_label(label, fontsize=8.5, color=INK, labelpad=2)
