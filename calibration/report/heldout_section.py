"""The part of a report on held-out scenes: how like their real infrared they come out, as HTML."""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape
from typing import Any

import numpy as np

from starling.calibration import correlation
from starling.calibration.heldout import SMOOTHING_PX, Scored, Side
from starling.calibration.report import pictures as report_pictures
from starling.calibration.report.pictures import ImagerPictures, Residual
from starling.calibration.result import Calibration
from starling.sim.report.elements import NONE, TIMES, figure, number, table


def section(calibration: Calibration, found: dict[str, Any]) -> str:
    """Say what was compared, with the table of scenes and pictures of three of them.

    Args:
        calibration: with the images.
        found: its `report.heldout_figures`.
    """
    if not calibration.heldout:
        return (
            "<p>No scene was held out, so nothing here tells whether the model fits beyond the "
            "captures it was fitted to. Hold out a room.</p>"
        )
    window = f"{correlation.WINDOW_PX} {TIMES} {correlation.WINDOW_PX} px"
    text = (
        "<p>Each scene was simulated by the calibrated sensor and compared with its real infrared "
        "images: normalised cross-correlation of both, high-passed, in windows of "
        f"{window} away from depth edges; 1 is equal, 0 is chance. A cell holds the windows' "
        "median and, in brackets, their lower quartile.</p>"
        '<ul class="quiet"><li><b>Scale</b>: of the pattern, a number taken from the scene '
        "itself, as the laser's wavelength drifts.</li>"
        "<li><b>Before</b>: by the sensor that the fit began from.</li>"
        "<li><b>Ceiling</b>: the camera's own right image, moved into the left view by the "
        "reference depth, against the left one. Both carry noise; a simulation has none and may "
        "exceed it.</li><li><b>Mirrored</b>: by the pattern turned over, the control. It must be "
        "about 0.</li><li>Reflectance comes from the scene's own left image, smoothed by a "
        f"Gaussian of {SMOOTHING_PX:g} px so that no dot is left in it, and so does ambient "
        "light. The right image has no say in either.</li></ul>"
    )
    before = {one.scene: one for one in calibration.before}
    pictures = "".join(
        _scene(one, before.get(one.scene), word)
        for word, one in _chosen(calibration.heldout).items()
    )
    return text + _table(found) + pictures


def _chosen(heldout: Iterable[Scored]) -> dict[str, Scored]:
    """The scenes whose pictures are shown, by what they are among all."""

    def median(one: Scored) -> float:
        windows = np.concatenate([*one.ncc.values(), np.empty(0, np.float32)])
        return float(np.median(windows)) if windows.size else -1.0

    ordered = sorted(heldout, key=median)
    words = {0: "worst", len(ordered) // 2: "middling", len(ordered) - 1: "best"}
    if len(ordered) == 1:
        words = {0: "only"}
    return {words[i]: ordered[i] for i in sorted(words, reverse=True)}


def _scene(scored: Scored, before: Scored | None, word: str) -> str:
    sides: tuple[Side, ...] = ("left", "right")
    drawn = {
        side: report_pictures.of_imager(scored, before, side)
        for side in sides
        if side in scored.real and side in scored.simulated
    }
    parts = [_imager(side, pictures) for side, pictures in drawn.items()]
    return (
        f"<h3>Scene {escape(scored.scene)}, room {escape(scored.room)}: the {word} of those held "
        f"out</h3>{''.join(parts)}"
    )


def _imager(side: str, drawn: ImagerPictures) -> str:
    height, width = drawn.shape
    shares = (
        *(drawn.crop.left / width, drawn.crop.top / height),
        *(drawn.crop.width / width, drawn.crop.height / height),
    )
    place = "left:{:.2%};top:{:.2%};width:{:.2%};height:{:.2%}".format(*shares)
    box = f'<span class="crop" style="{place}"></span>'
    zoom = f"{report_pictures.ZOOM}{TIMES}"
    pictures = [
        figure(drawn.real, f"<b>Real</b>, {side}. {_levels(drawn.real_dn)}", box),
        figure(drawn.simulated, f"<b>Re-simulated</b>. {_levels(drawn.simulated_dn)}", box),
        figure(
            drawn.real_zoomed,
            f"<b>Real, {zoom}</b>: the frame above, where the correlation "
            f"({number(drawn.crop_ncc, '.2f')}) is the median of the image's parts.",
            zoomed=True,
        ),
        figure(drawn.simulated_zoomed, f"<b>Re-simulated, {zoom}</b>.", zoomed=True),
    ]
    before = drawn.before
    residuals = [
        *(_residual(before, "before", zoom) if before else ()),
        *_residual(drawn.residual, "after", zoom),
    ]
    order = (0, 2, 1, 3) if before else (0, 1)  # Before beside after, the zoomed ones below.
    limit = report_pictures.RESIDUAL_LIMIT
    return (
        f"<h4>{side.capitalize()} imager</h4>"
        f'<div class="pictures">{"".join(pictures)}</div>'
        '<p class="quiet">Residuals: the real image less the re-simulated one by the factor that '
        "leaves least, both high-passed to a local deviation of 1. Grey is no difference; white, "
        f"real brighter by {limit:g}; black, darker.</p>"
        f'<div class="pictures">{"".join(residuals[i] for i in order)}</div>'
    )


def _residual(one: Residual, when: str, zoom: str) -> tuple[str, str]:
    left = f"{one.unexplained:.0%} of the high-passed image's variance is left."
    return (
        figure(one.whole, f"<b>Residual {when}</b>. {left}"),
        figure(one.zoomed, f"<b>Residual {when}, {zoom}</b>.", zoomed=True),
    )


def _levels(limits: tuple[float, float]) -> str:
    return f"Shown {number(limits[0], '.0f')} to {number(limits[1], '.0f')} DN."


def _table(found: dict[str, Any]) -> str:
    """Held-out scenes: correlation before and after against the ceiling."""
    head = (
        *("Scene", "Room", "Scale", "Before", "After", "Left", "Right"),
        *("Ceiling", "After / ceiling", "Mirrored"),
    )
    rows = [
        [
            escape(name),
            escape(one["room"]),
            number(one["pattern_scale"], ".5f"),
            _quartiles(one["before"]),
            _quartiles(one),
            _quartiles(one["left"]),
            _quartiles(one["right"]),
            _quartiles(one, "ceiling"),
            _ratio(one),
            number(one["mirrored"], ".3f"),
        ]
        for name, one in found["scenes"].items()
    ]
    rows.append(
        [
            *("Median", "", "", _quartiles(found["before"]), _quartiles(found), "", ""),
            *(_quartiles(found, "ceiling"), _ratio(found), number(found["mirrored"], ".3f")),
        ]
    )
    return table(head, rows, words=2, total=True)


def _ratio(one: dict[str, Any]) -> str:
    """Correlation over ceiling, median and quartile, in per cent."""
    shares = (_over(one["ncc"], one["ceiling"]), _over(one["ncc_p25"], one["ceiling_p25"]))
    median, quartile = (number(100 * share, ".0f") for share in shares)
    return f"{median}% ({quartile}%)" if math.isfinite(shares[0]) else NONE


def _over(value: float, ceiling: float) -> float:
    return value / ceiling if ceiling > 0 else math.nan


def _quartiles(one: dict[str, Any], name: str = "ncc") -> str:
    if not math.isfinite(one[name]):
        return NONE
    return f"{number(one[name], '.3f')} ({number(one[f'{name}_p25'], '.3f')})"
