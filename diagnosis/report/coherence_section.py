"""Report section on the coherence split: one picture, its numbers, and the disparity errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

from starling.diagnosis.report import first_answer
from starling.diagnosis.report.words import side_names
from starling.diagnosis.where.coherence.disparity_split import SIDES
from starling.diagnosis.where.coherence.scene_split import FEWEST_WINDOWS
from starling.diagnosis.where.coherence.shares import (
    ALL,
    CoherenceSplit,
    DisparityShares,
    Estimate,
    ImageShares,
    RoomShares,
)
from starling.diagnosis.where.coherence.spectra import WINDOW_PX
from starling.sim.report.elements import Stack, interval, number, prose, stacks, table

PARTS = {
    "explained": "explained by {}",
    "pattern": "pattern: repeats in the projector field",
    "camera": "repeats in the camera image",
    "scene": "texture and light: repeats in neither",
    "unseparated": "on surfaces, frames not separable",
    "imager": "fixed pattern of one imager",
    "noise": "noise of one imager",
}
_DISPARITY_PARTS = {
    "edges": "near depth edges",
    "camera": "warp: repeats in the camera image",
    "image": "follows the image",
    "rest": "rest",
}
_TITLE = "<h3>Coherence: what is missing, and what it moves with</h3>"
_NUMBERS = ("explained", "coherent", "pattern", "camera", "noise_ratio", "gain")
_HEAD = ("Period", "Of the power", "Explained", "Of the rest, common to both imagers")
_HEAD += ("In the projector field", "In the camera image", "Noise ratio", "Gain")


def section(split: CoherenceSplit, against: str | None) -> str:
    """Write the section as HTML; a single sentence where too few windows have no depth edge.

    Args:
        split: the coherence split.
        against: capture set that is compared; None for comparison with simulation.
    """
    if not split.images and not split.disparity:
        least = f"No scene has {FEWEST_WINDOWS} windows of {WINDOW_PX} px without depth edges"
        return _TITLE + prose(f"{least}, so images are not split by coherence.", quiet=True)
    return (
        _TITLE
        + prose(*first_answer.coherence_sentences(split, against))
        + _images(split, against)
        + _disparity(split, against)
    )


def _images(split: CoherenceSplit, against: str | None) -> str:
    if not split.images:
        return ""
    sides = side_names(against)
    legend = [text.format(sides.have[1]) for text in PARTS.values()]
    rows = [_stack(_name(shares.band), shares) for shares in reversed(split.images)]
    rows += [_stack(room, shares) for room, shares in split.rooms.items()]
    text = (
        f"Power of {sides.have[0]}' images in windows of 64 px without depth edges, by period and "
        "by room. The right image is registered on the left one."
    )
    notes = (
        "What both imagers see lies on surfaces; what one of them sees is noise or its fixed "
        "pattern. Rooms are compared at equal directions of the projector and at equal pixels.",
        "Where reflectance is estimated from these images, long periods agree by construction.",
        "Noise ratio: power of single imagers, simulated over real. Gain: real over simulated "
        "amplitude. Shares are unbiased, so small ones can be below 0.",
    )
    return (
        f"<h4>Infrared images</h4>{prose(text)}"
        + stacks(rows, legend)
        + _table(split.images)
        + prose(*notes, quiet=True)
    )


def _name(band: str) -> str:
    return "All periods" if band == ALL else f"Period {band}"


def _stack(name: str, shares: ImageShares | RoomShares) -> Stack:
    values = [_value(getattr(shares, part)) for part in PARTS]
    ratio = _value(shares.noise_ratio)
    return Stack(
        name=name,
        shares=values,
        text=f"explained {100 * values[0]:.0f} %, noise ratio {number(ratio, '.2f')}",
    )


def _table(images: Sequence[ImageShares]) -> str:
    rows = [
        [
            escape(_name(shares.band)),
            f"{number(100 * shares.power[0], '.1f')} %",
            *(_cell(getattr(shares, name), name) for name in _NUMBERS),
        ]
        for shares in images
    ]
    return table(_HEAD, rows)


def _cell(estimate: Estimate, name: str) -> str:
    """Write an estimate with its interval: a share in percent, or a ratio."""
    is_ratio = name in ("noise_ratio", "gain")
    scale, digits = (1, ".2f") if is_ratio else (100, ".1f")
    value, *ends = estimate
    low, high = (math.nan if end is None else scale * end for end in ends)
    written = number(scale * value, digits) + ("" if is_ratio else " %")
    return written if math.isnan(low) else f"{written} {interval(low, high, digits)}"


def _disparity(split: CoherenceSplit, against: str | None) -> str:
    if not split.disparity:
        return ""
    sides = side_names(against)
    titles = dict(zip(SIDES, (*sides.pair, f"{sides.pair[0]} minus {sides.pair[1]}"), strict=True))
    rows = [
        _disparity_stack(titles[side], split.edges[side][0], shares[-1])
        for side, shares in split.disparity.items()
    ]
    text = (
        "Squared disparity errors against the reference, up to 2 px. The image is followed if a "
        "filter of it, fitted to other rooms, predicts errors."
    )
    return f"<h4>Disparity</h4>{prose(text)}" + stacks(rows, list(_DISPARITY_PARTS.values()))


def _disparity_stack(name: str, edges: float, shares: DisparityShares) -> Stack:
    surfaces = [_value(getattr(shares, part)) for part in ("camera", "image", "rest")]
    values = [edges, *((1 - edges) * share for share in surfaces)]
    return Stack(
        name=name.capitalize(),
        shares=values,
        text=f"{number(shares.rms_px[0], '.3f')} px on surfaces",
    )


def _value(estimate: Estimate | float) -> float:
    return estimate[0] if isinstance(estimate, tuple) else estimate
