"""Pictures of an evaluation: curves of all methods, and predictions of some scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from starling.learning.data.example import Image, known_holes
from starling.learning.evaluation.evaluate import HolePrediction, Scores
from starling.sim.plotting import panels, sheet
from starling.sim.plotting.sheet import Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIZE_IN = (13.0, 6.2)
_DPI = 100
_GRID = "#dfe2e6"
_COLOURS = "tab20"
_SCENES = 4  # Number of scenes: those where the last method misses most holes.
_SURE = 0.5  # Least probability of a detected hole.


def curves(methods: Mapping[str, Scores]) -> bytes:
    """Draw the ROC and reliability curves of all methods side by side, as PNG bytes."""
    from matplotlib import colormaps

    figure = sheet.new_figure(_SIZE_IN, _DPI, layout="constrained")
    ranking, calibration = figure.subplots(1, 2)
    for number, (name, scores) in enumerate(methods.items()):
        colour = colormaps[_COLOURS](number % 20)
        label = f"{name}, AUC {scores.mean.auc:.3f}"
        curve, reliability = scores.curve, scores.reliability
        ranking.plot(
            curve.false_positive_rate, curve.true_positive_rate, color=colour, lw=1.6, label=label
        )
        calibration.plot(
            np.maximum(reliability.predicted, 1e-5),
            np.maximum(reliability.observed, 1e-5),
            "o-",
            color=colour,
            ms=3.5,
            lw=1.2,
        )
    ranking.set(xlim=(0, 0.3), ylim=(0.3, 1), xlabel="false-positive rate")
    ranking.set_ylabel("share of holes detected")
    ranking.legend(frameon=False, fontsize=9, loc="lower right")
    calibration.plot([1e-4, 1], [1e-4, 1], "--", color=panels.INK, lw=0.8)
    calibration.set(xscale="log", yscale="log", xlim=(1e-4, 1), ylim=(1e-4, 1))
    calibration.set(xlabel="predicted probability", ylabel="share of pixels without depth")
    for axes in (ranking, calibration):
        axes.grid(color=_GRID, lw=0.7)
    return sheet.encode(figure)


def scenes(methods: Mapping[str, Sequence[HolePrediction]]) -> bytes:
    """Draw the worst scenes of the last method: reference, holes, all predictions; as PNG bytes."""
    last = list(methods)[-1]
    order = np.argsort([-_missed(prediction) for prediction in methods[last]])[:_SCENES]
    rows = [
        _row({name: predictions[number] for name, predictions in methods.items()})
        for number in order
    ]
    return sheet.draw(rows, methods[last][0].probability.shape, panel_in=3.4)


def _row(methods: Mapping[str, HolePrediction]) -> list[Panel]:
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
    for name, prediction in methods.items():
        image = np.where(counted, prediction.probability, np.nan)
        drawn.append(Panel(draw=partial(_probability, image=image, title=name)))
    return drawn


def _probability(axes: Axes, image: Image, title: str) -> None:
    axes.imshow(image, cmap="magma", vmin=0, vmax=1, interpolation="nearest")
    panels.finish(axes, title, "0 black, 1 bright")


def _missed(prediction: HolePrediction) -> int:
    """Number of counted holes with a probability below 0.5."""
    ndp, counted = known_holes(prediction.example)
    return int(np.count_nonzero(ndp & counted & (prediction.probability < _SURE)))
