"""Creation and encoding of figures without a window system."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_JPEG_QUALITY = 62  # Small files at adequate quality.


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
