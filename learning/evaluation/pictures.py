"""Pictures of an evaluation: curves of all methods, and scenes with what was told of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from starling.learning.data.example import Image
from starling.learning.data.learnable import known_holes
from starling.learning.evaluation.evaluate import Scores, Told
from starling.sim.plotting import canvas, panels, sheet
from starling.sim.plotting.sheet import Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIZE_IN = (13.0, 6.2)
_DPI = 100
_GRID = "#dfe2e6"
_COLOURS = "tab20"
_SCENES = 4  # Shown: those with the most holes missed by the last method.
_SURE = 0.5


def curves(methods: Mapping[str, Scores]) -> bytes:
    """ROC and reliability of all methods side by side, as PNG bytes."""
    from matplotlib import colormaps

    figure = canvas.empty(_SIZE_IN, _DPI, layout="constrained")
    ranking, honesty = figure.subplots(1, 2)
    for number, (name, scores) in enumerate(methods.items()):
        colour = colormaps[_COLOURS](number % 20)
        label = f"{name}, AUC {scores.mean.auc:.3f}"
        curve, told = scores.curve, scores.reliability
        ranking.plot(
            curve.false_positive_rate, curve.true_positive_rate, color=colour, lw=1.6, label=label
        )
        honesty.plot(
            np.maximum(told.told, 1e-5),
            np.maximum(told.observed, 1e-5),
            "o-",
            color=colour,
            ms=3.5,
            lw=1.2,
        )
    ranking.set(xlim=(0, 0.3), ylim=(0.3, 1), xlabel="false-positive rate")
    ranking.set_ylabel("share of the holes that are found")
    ranking.legend(frameon=False, fontsize=9, loc="lower right")
    honesty.plot([1e-4, 1], [1e-4, 1], "--", color=panels.INK, lw=0.8)
    honesty.set(xscale="log", yscale="log", xlim=(1e-4, 1), ylim=(1e-4, 1))
    honesty.set(xlabel="probability told", ylabel="share of pixels without depth")
    for axes in (ranking, honesty):
        axes.grid(color=_GRID, lw=0.7)
    return canvas.encoded(figure)


def scenes(methods: Mapping[str, Sequence[Told]]) -> bytes:
    """Worst scenes of the last method: reference, holes, what each method told; as PNG bytes."""
    last = list(methods)[-1]
    order = np.argsort([-_missed(told) for told in methods[last]])[:_SCENES]
    rows = [_row({name: told[number] for name, told in methods.items()}) for number in order]
    return sheet.draw(rows, methods[last][0].probability.shape, panel_in=3.4)


def _row(methods: Mapping[str, Told]) -> list[Panel]:
    example = next(iter(methods.values())).example
    ndp, counted = known_holes(example)
    limits = panels.depth_limits(example.depth_m)
    title = f"{example.scene}: reference"
    drawn = [
        Panel(
            draw=partial(panels.depth, depth_m=example.depth_m, limits=limits, title=title),
            below_in=panels.BAR_IN,
        ),
        Panel(draw=partial(_probability, image=np.where(counted, ndp, np.nan), title="no depth")),
    ]
    for name, told in methods.items():
        image = np.where(counted, told.probability, np.nan)
        drawn.append(Panel(draw=partial(_probability, image=image, title=name)))
    return drawn


def _probability(axes: Axes, image: Image, title: str) -> None:
    axes.imshow(image, cmap="magma", vmin=0, vmax=1, interpolation="nearest")
    panels.finish(axes, title, "0 black, 1 bright")


def _missed(told: Told) -> int:
    """Number of counted holes told with less than 0.5."""
    ndp, counted = known_holes(told.example)
    return int(np.count_nonzero(ndp & counted & (told.probability < _SURE)))
