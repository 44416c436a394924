"""Empty figures and the bytes of their picture files; no window system is needed."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_JPEG_QUALITY = 62


def empty(size_in: tuple[float, float], dpi: float, **options: Any) -> Figure:
    """Make a white figure.

    Args:
        size_in: width and height [inch].
        dpi: pixels an inch.
        options: of matplotlib's `Figure`.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size_in, dpi=dpi, facecolor="white", **options)
    FigureCanvasAgg(figure)
    return figure


def encoded(figure: Figure, kind: Literal["png", "jpeg"] = "png") -> bytes:
    """The figure as a picture file."""
    buffer = io.BytesIO()
    quality = {"quality": _JPEG_QUALITY} if kind == "jpeg" else None
    figure.savefig(buffer, format=kind, pil_kwargs=quality)
    return buffer.getvalue()
