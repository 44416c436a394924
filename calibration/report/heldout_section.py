"""The report's section on held-out scenes: simulated against real infrared images, as HTML."""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape
from typing import Any

import numpy as np

from starling.calibration import correlation
from starling.calibration.fit_sensor import Calibration
from starling.calibration.heldout import SMOOTHING_PX, SceneScore
from starling.calibration.observation import Side
from starling.calibration.report.pictures import (
    RESIDUAL_LIMIT,
    ImagerPictures,
    Residual,
    draw_imager,
)
from starling.sim.report.elements import NONE, TIMES, figure, grid, number, table
from starling.sim.report.pictures import ZOOM


def section(calibration: Calibration, scores: dict[str, Any]) -> str:
    """Explain the comparison, list the scenes, and show pictures of three of them.

    Args:
        calibration: calibration with the held-out images.
        scores: result of `starling.calibration.report.figures.heldout_figures`.
    """
    if not calibration.heldout:
        return (
            "<p>No scene was held out, so this report does not show whether the sensor model "
            "holds for other captures than the fitted ones. Hold out a room.</p>"
        )
    window = f"{correlation.WINDOW_PX} {TIMES} {correlation.WINDOW_PX} px"
    text = (
        "<p>Each scene was simulated with the calibrated sensor and compared with its real "
        "infrared images. The score is the normalised cross-correlation of the high-passed images "
        f"in windows of {window} away from depth edges. 1 means equal images, 0 means chance. A "
        "cell holds the median over the windows and, in brackets, the lower quartile.</p>"
        '<ul class="quiet"><li><b>Scale</b>: scale of the pattern. It is estimated from the scene '
        "itself, because the laser's wavelength drifts.</li>"
        "<li><b>Before</b>: score of the initial sensor.</li>"
        "<li><b>Upper bound</b>: the camera's right image, warped into the left view by the "
        "reference depth, against the left image. Both images have noise. A simulation without "
        "noise may exceed this bound.</li><li><b>Mirrored</b>: control with the mirrored pattern. "
        "It must be about 0.</li><li>Reflectance and ambient light are estimated from the scene's "
        f"left image, smoothed by a Gaussian of sigma {SMOOTHING_PX:g} px that removes the dots. "
        "The right image is not used for either.</li></ul>"
    )
    before = {scene_score.scene: scene_score for scene_score in calibration.before}
    pictures = "".join(
        _scene(scene_score, before.get(scene_score.scene), rank)
        for rank, scene_score in _chosen(calibration.heldout).items()
    )
    return text + _table(scores) + pictures


def _chosen(heldout: Iterable[SceneScore]) -> dict[str, SceneScore]:
    """Return the scenes to show, keyed by their rank."""

    def median(scored: SceneScore) -> float:
        windows = np.concatenate([*scored.ncc.values(), np.empty(0, np.float32)])
        return float(np.median(windows)) if windows.size else -1.0

    ordered = sorted(heldout, key=median)
    ranks = {0: "worst", len(ordered) // 2: "median", len(ordered) - 1: "best"}
    if len(ordered) == 1:
        ranks = {0: "only"}
    return {ranks[i]: ordered[i] for i in sorted(ranks, reverse=True)}


def _scene(scored: SceneScore, before: SceneScore | None, rank: str) -> str:
    sides: tuple[Side, ...] = ("left", "right")
    pictures_by_side = {
        side: draw_imager(scored, before, side)
        for side in sides
        if side in scored.real and side in scored.simulated
    }
    imagers = [_imager(side, pictures) for side, pictures in pictures_by_side.items()]
    return (
        f"<h3>Scene {escape(scored.scene)}, room {escape(scored.room)}: the {rank} of those held "
        f"out</h3>{''.join(imagers)}"
    )


def _imager(side: str, drawn: ImagerPictures) -> str:
    height, width = drawn.shape
    shares = (
        *(drawn.crop.left / width, drawn.crop.top / height),
        *(drawn.crop.width / width, drawn.crop.height / height),
    )
    place = "left:{:.2%};top:{:.2%};width:{:.2%};height:{:.2%}".format(*shares)
    box = f'<span class="crop" style="{place}"></span>'
    zoom = f"{ZOOM}{TIMES}"
    pictures = [
        figure(drawn.real, f"<b>Real</b>, {side}. {_levels(drawn.real_dn)}", over=box),
        figure(drawn.simulated, f"<b>Simulated</b>. {_levels(drawn.simulated_dn)}", over=box),
        figure(
            drawn.real_zoomed,
            f"<b>Real, {zoom}</b>: the framed part of the image above. Its correlation "
            f"({number(drawn.crop_ncc, '.2f')}) is the median over the image's parts.",
            sharp=True,
        ),
        figure(drawn.simulated_zoomed, f"<b>Simulated, {zoom}</b>.", sharp=True),
    ]
    before = drawn.before
    residuals = [
        *(_residual(before, "before", zoom) if before else ()),
        *_residual(drawn.residual, "after", zoom),
    ]
    order = (0, 2, 1, 3) if before else (0, 1)  # First row: before and after. Second row: zoomed.
    return (
        f"<h4>{side.capitalize()} imager</h4>{grid(pictures)}"
        '<p class="quiet">Residuals: the real image minus the simulated one, which is scaled to '
        "minimise the residual. Both are high-passed to a local standard deviation of 1. Grey "
        "means no difference; white means that the real image is brighter by "
        f"{RESIDUAL_LIMIT:g}, black that it is darker.</p>"
        f"{grid(residuals[i] for i in order)}"
    )


def _residual(residual: Residual, when: str, zoom: str) -> tuple[str, str]:
    remaining = f"It holds {residual.unexplained:.0%} of the high-passed image's variance."
    return (
        figure(residual.whole, f"<b>Residual {when}</b>. {remaining}"),
        figure(residual.zoomed, f"<b>Residual {when}, {zoom}</b>.", sharp=True),
    )


def _levels(limits: tuple[float, float]) -> str:
    return f"Grey scale {number(limits[0], '.0f')} to {number(limits[1], '.0f')} DN."


def _table(scores: dict[str, Any]) -> str:
    """Return the table of held-out scenes: correlation before, after, and its upper bound."""
    head = (
        *("Scene", "Room", "Scale", "Before", "After", "Left", "Right"),
        *("Upper bound", "After / bound", "Mirrored"),
    )
    rows = [
        [
            escape(name),
            escape(scene["room"]),
            number(scene["pattern_scale"], ".5f"),
            _quartiles(scene["before"]),
            _quartiles(scene),
            _quartiles(scene["left"]),
            _quartiles(scene["right"]),
            _quartiles(scene, "ceiling"),
            _ratio(scene),
            number(scene["mirrored"], ".3f"),
        ]
        for name, scene in scores["scenes"].items()
    ]
    rows.append(
        [
            *("Median", "", "", _quartiles(scores["before"]), _quartiles(scores), "", ""),
            *(_quartiles(scores, "ceiling"), _ratio(scores), number(scores["mirrored"], ".3f")),
        ]
    )
    return table(head, rows, words=2, total=True)


def _ratio(scores: dict[str, Any]) -> str:
    """Return correlation over its upper bound, median and quartile, in percent."""
    shares = (
        _over(scores["ncc"], scores["ceiling"]),
        _over(scores["ncc_p25"], scores["ceiling_p25"]),
    )
    median, quartile = (number(100 * share, ".0f") for share in shares)
    return f"{median}% ({quartile}%)" if math.isfinite(shares[0]) else NONE


def _over(value: float, ceiling: float) -> float:
    return value / ceiling if ceiling > 0 else math.nan


def _quartiles(scores: dict[str, Any], name: str = "ncc") -> str:
    if not math.isfinite(scores[name]):
        return NONE
    return f"{number(scores[name], '.3f')} ({number(scores[f'{name}_p25'], '.3f')})"
