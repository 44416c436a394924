"""Plot the reports of `benchmarks/diagnosis/diagnose_faro.py`, without captured images.

Usage:
    python benchmarks/diagnosis/diagnose_plots.py --out DIR \
        --report preset=OUT/report calibrated=OUT/report
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

from starling.diagnosis.report.sentences import describe_group
from starling.sim.plotting import sheet

Reports = Mapping[str, Mapping[str, Any]]

DIFFERENCES = {
    "image": "real minus simulated infrared, both with our matcher",
    "matcher": "device depth minus our matcher's depth, real minus simulated",
}
PARTS = {
    "ndp_rate": ("no depth [%]", 100.0),
    "bias_px": ("bias of disparity [px]", 1.0),
    "nmad_px": ("NMAD of disparity [px]", 1.0),
    "bad1_pct": ("error above 1 px [%]", 1.0),
}
MAPS = {
    "error": ("disparity: device minus\nsimulated device [px]", 1.0),
    "holes": ("no depth: device minus\nsimulated device [points]", 100.0),
}
SEGMENTS = {"image": "images", "depth": "matcher and filters", "whole": "depth alone"}
GROUPS = 14  # Number of feature groups in the plot.
DPI = 110


def parts(reports: Reports) -> bytes:
    """Plot the parts of the gap due to images and due to the matcher, with 95 % intervals."""
    figure = sheet.new_figure((10, 0.9 + 0.6 * len(reports)), DPI, layout="constrained")
    drawn = figure.subplots(1, len(PARTS), sharey=True)
    for axes, (name, (title, scale)) in zip(drawn, PARTS.items(), strict=True):
        for turn, (part, label) in enumerate(DIFFERENCES.items()):
            estimates = [report["where"]["parts"][name][part] for report in reports.values()]
            values = scale * np.array([[_number(end) for end in ends] for ends in estimates])
            rows = np.arange(len(reports)) + (turn - 0.5) * 0.3
            axes.plot(values[:, 0], rows, "o", color=f"C{turn}", markersize=4, label=label)
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
    return sheet.encode(figure)


def places(reports: Reports) -> bytes:
    """Plot maps of the gap over the image, mean over scenes, for each report."""
    figure = sheet.new_figure((3.9 * len(reports), 4.6), DPI, layout="constrained")
    rows = figure.subplots(len(MAPS), len(reports), squeeze=False)
    for row, (quantity, (title, scale)) in zip(rows, MAPS.items(), strict=True):
        maps = [_map(report, quantity) * scale for report in reports.values()]
        limit = max(float(np.nanpercentile(np.abs(values), 98)) for values in maps)
        shades = colormaps["RdBu_r"].with_extremes(bad="0.8")  # Grey: unknown.
        colours = ScalarMappable(Normalize(-limit, limit), shades)
        for axes, label, values in zip(row, reports, maps, strict=True):
            axes.imshow(values, cmap=colours.cmap, norm=colours.norm, extent=(0, 16, 0, 9))
            axes.set_axis_off()
            axes.set_title(label, fontsize=9)
        bar = figure.colorbar(colours, ax=row, shrink=0.9, extend="both")
        bar.set_label(title, fontsize=8)
    return sheet.encode(figure)


def groups(reports: Reports) -> bytes:
    """Plot the gap by group of features, before and after, for each pipeline segment.

    Gap sizes of different sensors are not comparable, so each has its own axis.
    """
    segments = [
        segment
        for segment in SEGMENTS
        if any(segment in report["which"] for report in reports.values())
    ]
    size = (2.6 + 2.4 * len(reports), (0.6 + 0.2 * GROUPS) * len(segments))
    figure = sheet.new_figure(size, DPI, layout="constrained")
    rows = figure.subplots(len(segments), len(reports), squeeze=False, sharey="row")
    for row, segment in zip(rows, segments, strict=True):
        groups_by_report = {
            name: report["which"].get(segment, {}).get("by_group", {})
            for name, report in reports.items()
        }
        known = {name for by_group in groups_by_report.values() for name in by_group}
        names = sorted(known, key=lambda name: -_largest(groups_by_report.values(), name))[:GROUPS]
        row[0].set_yticks(range(len(names)), [describe_group(name) for name in names], fontsize=8)
        row[0].invert_yaxis()
        for axes, (label, by_group) in zip(row, groups_by_report.items(), strict=True):
            sizes = [by_group.get(name, {"before": 0.0, "after": 0.0}) for name in names]
            before, after = ([size[when] for size in sizes] for when in ("before", "after"))
            axes.barh(range(len(names)), before, 0.8, color="0.8", label="before")
            axes.barh(range(len(names)), after, 0.35, color="C0", label="after")
            axes.set_title(f"{SEGMENTS[segment]}\n{label}", fontsize=8)
            axes.tick_params(axis="x", labelsize=7)
    for axes in rows[-1]:
        axes.set_xlabel("share of the gap size,\nseparate scales", fontsize=8)
    handles, labels = rows[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    return sheet.encode(figure)


def _largest(reports: Iterable[Mapping[str, Mapping[str, float]]], name: str) -> float:
    return max(by_group[name]["before"] for by_group in reports if name in by_group)


def _map(report: Mapping[str, Any], quantity: str) -> np.ndarray:
    for entry in report["where"]["maps"]:
        if (entry["quantity"], entry["frame"]) == (quantity, "camera"):
            return np.array(entry["mean"], float)
    raise SystemExit(f"report has no map of {quantity}; a map needs at least two scenes")


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def main() -> None:
    """Read the reports and write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--report", nargs="+", required=True, metavar="NAME=FOLDER")
    options = parser.parse_args()
    reports = {}
    for argument in options.report:
        name, _, folder = argument.partition("=")
        reports[name] = json.loads((Path(folder) / "report.json").read_text(encoding="utf-8"))
    options.out.mkdir(parents=True, exist_ok=True)
    for name, draw in {"parts": parts, "places": places, "groups": groups}.items():
        (options.out / f"d415-{name}.png").write_bytes(draw(reports))


if __name__ == "__main__":
    main()
