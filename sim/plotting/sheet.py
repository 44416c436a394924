"""Figures without a window system, and sheets of panels in rows."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GAP_IN = 0.25  # Gap between columns [inch].
_TALLEST = 4.0  # Height of a panel over its width; higher images are drawn narrower.
_HEADING_IN = 0.36  # Height of a panel's heading [inch].

_JPEG_QUALITY = 62  # Small files at adequate quality.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Panel:
    """A drawing and the height of the scale bar or legend below it [inch]."""

    draw: Callable[[Axes], None]
    below_in: float = 0.05


def draw(
    rows: Sequence[Sequence[Panel]],
    shape: tuple[int, int],
    *,
    panel_in: float = 6.2,
    dpi: float = 110,
    kind: Literal["png", "jpeg"] = "png",
) -> bytes:
    """Draw panels of images of one shape.

    Args:
        rows: Rows of panels from the top, each from the left.
        shape: (h, w) of the images.
        panel_in: Width of a panel [inch].
        dpi: Pixels per inch.
        kind: Type of the picture file.
    """
    columns = max(map(len, rows))
    high_in = panel_in * min(shape[0] / shape[1], _TALLEST)
    below_in = [max(panel.below_in for panel in row) for row in rows]
    width = columns * (panel_in + _GAP_IN) + _GAP_IN
    height = len(rows) * (_HEADING_IN + high_in) + sum(below_in) + 0.1
    figure = new_figure((width, height), dpi)
    y = height
    for row, below in zip(rows, below_in, strict=True):
        y -= _HEADING_IN + high_in
        for column, panel in enumerate(row):
            x = _GAP_IN + column * (panel_in + _GAP_IN)
            place = (x / width, y / height, panel_in / width, high_in / height)
            panel.draw(figure.add_axes(place))
        y -= below
    return encode(figure, kind)


def new_figure(size_in: tuple[float, float], dpi: float, **options: Any) -> Figure:
    """Create a white figure.

    Args:
        size_in: Width and height [inch].
        dpi: Pixels per inch.
        options: Options of matplotlib's `Figure`.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size_in, dpi=dpi, facecolor="white", **options)
    FigureCanvasAgg(figure)
    return figure


def encode(figure: Figure, kind: Literal["png", "jpeg"] = "png") -> bytes:
    """Encode a figure as a picture file."""
    buffer = io.BytesIO()
    quality = {"quality": _JPEG_QUALITY} if kind == "jpeg" else None
    figure.savefig(buffer, format=kind, pil_kwargs=quality)
    return buffer.getvalue()
