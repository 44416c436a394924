"""Plot what `benchmarks/diagnosis/diagnose_faro.py` found, as numbers: no captured image.

Usage:
    python benchmarks/diagnosis/diagnose_plots.py --out DIR --report preset=OUT/report calibrated=OUT/report
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from starling.diagnosis.report.group_names import told as told_as
from starling.sim.plotting import canvas

Reports = Mapping[str, Mapping[str, Any]]

DIFFERENCES = {
    "image": "real less simulated infrared, both by our matcher",
    "matcher": "depth less our matcher's of its infrared: the device's less the simulated device's",
}
PARTS = {
    "ndp_rate": ("no depth [%]", 100.0),
    "bias_px": ("bias of disparity [px]", 1.0),
    "nmad_px": ("NMAD of disparity [px]", 1.0),
    "bad1_pct": ("off by more than 1 px [%]", 1.0),
}
MAPS = {
    "error": ("disparity: device's less\nthe simulated device's [px]", 1.0),
    "holes": ("no depth, likewise [points]", 100.0),
}
ARMS = {"image": "images", "depth": "matcher and filters", "whole": "depth alone"}
GROUPS = 14  # Of features, that are drawn.
DPI = 110


def parts(reports: Reports) -> bytes:
    """Draw what the images, and what matcher and filters, make of the gap, with 95 % intervals."""
    figure = canvas.empty((10, 0.9 + 0.6 * len(reports)), DPI, layout="constrained")
    drawn = figure.subplots(1, len(PARTS), sharey=True)
    for axes, (name, (title, scale)) in zip(drawn, PARTS.items(), strict=True):
        for turn, (part, told) in enumerate(DIFFERENCES.items()):
            found = [one["where"]["parts"][name][part] for one in reports.values()]
            values = scale * np.array([[_number(one) for one in each] for each in found])
            rows = np.arange(len(reports)) + (turn - 0.5) * 0.3
            axes.plot(values[:, 0], rows, "o", color=f"C{turn}", markersize=4, label=told)
            axes.hlines(rows, values[:, 1], values[:, 2], color=f"C{turn}")
        axes.axvline(0, color="0.4", linewidth=0.8)
        axes.tick_params(labelsize=7)
        axes.locator_params(axis="x", nbins=4)
        axes.set_title(title, fontsize=9)
    labels = [name.replace(", ", "\n") for name in reports]
    drawn[0].set_yticks(range(len(reports)), labels, fontsize=7)
    drawn[0].set_ylim(len(reports) - 0.5, -0.5)
    handles, labels = drawn[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    return canvas.encoded(figure)


def places(reports: Reports) -> bytes:
    """Draw where in the image the real camera differs, mean over scenes, for each base."""
    figure = canvas.empty((3.9 * len(reports), 4.6), DPI, layout="constrained")
    rows = figure.subplots(len(MAPS), len(reports), squeeze=False)
    for row, (quantity, (title, scale)) in zip(rows, MAPS.items(), strict=True):
        maps = [_map(one, quantity) * scale for one in reports.values()]
        limit = max(float(np.nanpercentile(np.abs(one), 98)) for one in maps)
        shades = colormaps["RdBu_r"].with_extremes(bad="0.8")  # Grey: not known.
        colours = ScalarMappable(Normalize(-limit, limit), shades)
        for axes, label, one in zip(row, reports, maps, strict=True):
            axes.imshow(one, cmap=colours.cmap, norm=colours.norm, extent=(0, 16, 0, 9))
            axes.set_axis_off()
            axes.set_title(label, fontsize=9)
        bar = figure.colorbar(colours, ax=row, shrink=0.9, extend="both")
        bar.set_label(title, fontsize=8)
    return canvas.encoded(figure)


def groups(reports: Reports) -> bytes:
    """Draw which features a gap is made of, before and after, in each half of the chain.

    Sizes of gaps from different sensors do not compare, so each has axes of its own.
    """
    arms = [arm for arm in ARMS if any(arm in one["which"] for one in reports.values())]
    size = (2.6 + 2.4 * len(reports), (0.6 + 0.2 * GROUPS) * len(arms))
    figure = canvas.empty(size, DPI, layout="constrained")
    rows = figure.subplots(len(arms), len(reports), squeeze=False, sharey="row")
    for row, arm in zip(rows, arms, strict=True):
        told = {
            name: one["which"].get(arm, {}).get("by_group", {}) for name, one in reports.items()
        }
        known = {name for by_group in told.values() for name in by_group}
        names = sorted(known, key=lambda name: -_largest(told.values(), name))[:GROUPS]
        row[0].set_yticks(range(len(names)), [told_as(name) for name in names], fontsize=8)
        row[0].invert_yaxis()
        for axes, (label, by_group) in zip(row, told.items(), strict=True):
            sizes = [by_group.get(name, {"before": 0.0, "after": 0.0}) for name in names]
            before, after = ([one[when] for one in sizes] for when in ("before", "after"))
            axes.barh(range(len(names)), before, 0.8, color="0.8", label="before")
            axes.barh(range(len(names)), after, 0.35, color="C0", label="after")
            axes.set_title(f"{ARMS[arm]}\n{label}", fontsize=8)
            axes.tick_params(axis="x", labelsize=7)
    for axes in rows[-1]:
        axes.set_xlabel("part of the gap's size,\neach its own scale", fontsize=8)
    handles, labels = rows[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    return canvas.encoded(figure)


def _largest(told: Iterable[Mapping[str, Mapping[str, float]]], name: str) -> float:
    return max(one[name]["before"] for one in told if name in one)


def _map(report: Mapping[str, Any], quantity: str) -> np.ndarray:
    for one in report["where"]["maps"]:
        if (one["quantity"], one["frame"]) == (quantity, "camera"):
            return np.array(one["mean"], float)
    raise SystemExit(f"report has no map of {quantity}: two scenes at least give one")


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def main() -> None:
    """Read the reports and write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--report", nargs="+", required=True, metavar="NAME=FOLDER")
    asked = parser.parse_args()
    reports = {}
    for one in asked.report:
        name, _, folder = one.partition("=")
        reports[name] = json.loads((Path(folder) / "report.json").read_text(encoding="utf-8"))
    asked.out.mkdir(parents=True, exist_ok=True)
    for name, draw in {"parts": parts, "places": places, "groups": groups}.items():
        (asked.out / f"d415-{name}.png").write_bytes(draw(reports))


if __name__ == "__main__":
    main()
