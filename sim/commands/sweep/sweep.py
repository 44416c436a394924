"""The work of `starling sweep`: cameras by parameters in; depth error and holes by distance out."""

from __future__ import annotations

import csv
import io
import math
import time
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.commands.sweep import axes as sweep_axes
from starling.sim.commands.sweep.axes import AXES
from starling.sim.commands.sweep.figures import Figures, Stages, measure
from starling.sim.commands.sweep.result import Sweep as Sweep
from starling.sim.console import progress, record
from starling.sim.console.output import RECORD, OutputFolder
from starling.sim.render import backend, emission
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

DISTANCES_M = (0.4, 0.6, 0.9, 1.3, 2.0, 3.0, 4.0, 6.0)
REFERENCE_M = 1.0  # The disparity noise of the law is the base's at the distance nearest to this.


def sweep(
    base: Sensor,
    axes: Mapping[str, Sequence[float]],
    *,
    distances_m: Sequence[float] = DISTANCES_M,
    full: bool = False,
    seed: int = 0,
    track: progress.Progress = progress.silent,
) -> Sweep:
    """Simulate and measure every camera of a sweep at every distance.

    Args:
        base: the camera that the others depart from.
        axes: values by axis (see `starling.sim.commands.sweep.axes.AXES`); the base's own is always among them.
            Empty: all axes with their usual values.
        distances_m: of what the cameras look at [m], 0.1 to 10.
        full: all combinations of the values; else one axis at a time.
        seed: of the noise, the same for all cameras.
        track: wraps the loop over cameras and distances.

    Raises:
        InputError: whatever is wrong with the base, a value or a distance; before any rendering.
    """
    cameras = sweep_axes.cameras(base, sweep_axes.chosen(base, axes), full=full)
    distances = sorted(set(map(float, distances_m)))
    if not distances:
        raise errors.refuse("distance_m", "must hold a distance", "none", "Give metres: 0.5 1 2.")
    for distance in distances:
        errors.in_interval("distance_m", distance, 0.1, 10.0, "Give metres.")
    errors.in_interval("seed", seed, 0, 2**63 - 1, "Give a whole number from 0.")
    for camera in cameras:  # A pattern that cannot be had is refused now; made ones are kept.
        part = camera.sensor.projector
        for number in range(len(emission.emitters(part))):
            emission.irradiance_at_unit_distance(part, number)
    from starling.sim import simulate

    simulate.refuse_impossible(base, 1)
    measured: list[list[Figures]] = [[] for _ in cameras]
    stages = None
    for distance, number in track(list(product(distances, range(len(cameras)))), "sweep"):
        if stages is None or number == 0:
            stages = Stages.at(distance)
        measured[number].append(measure(cameras[number].sensor, stages, seed=seed))
    nearest = min(distances, key=lambda z: abs(math.log(z / REFERENCE_M)))
    return Sweep(
        cameras=tuple(cameras),
        distances_m=tuple(distances),
        figures=tuple(map(tuple, measured)),
        reference=distances.index(nearest),
    )


def run(
    base: Sensor,
    axes: Mapping[str, Sequence[float]],
    out: Path,
    *,
    distances_m: Sequence[float] = (),
    full: bool = False,
    seed: int = 0,
    force: bool = False,
    asked: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Sweep and write a folder: `sweep.png`, `sweep.csv`, `sweep.json` and the base `sensor.toml`.

    Args:
        base: as in `sweep`, and so are `axes`, `full`, `seed` and `tell`.
        axes: an axis without values counts as not named.
        out: folder to make.
        distances_m: empty for `DISTANCES_M`.
        force: replace a sweep made before.
        asked: more arguments for the record, as they were typed: sensor, edits.

    Returns:
        `{"out", "files", "seconds", "reference_m", "sigma_d_px", "cameras": {NAME: {"noise_mm",
        "law_mm", "holes_pct", "wrong_pct"}}}`, the cameras' figures at the reference distance.

    Raises:
        InputError: as `sweep`, or a folder that cannot be written; nothing is left.
    """
    started = time.perf_counter()
    with OutputFolder(out, force=force) as folder:
        found = sweep(
            base, axes, distances_m=distances_m or DISTANCES_M, full=full, seed=seed, track=track
        )
        from starling.sim.commands.sweep import picture

        figures = summary(found)
        arguments = {
            "axes": sweep_axes.chosen(base, axes),
            "distance_m": found.distances_m,
            "full": full,
            "seed": seed,
            **(asked or {}),
        }
        files: dict[str, bytes | str] = {
            "sweep.png": picture.draw(found),
            "sweep.csv": table(found),
            "sweep.json": record.dumps(listed(found)),
            "sensor.toml": presets.dumps(base),
            RECORD: record.dumps(
                {
                    "verb": "sweep",
                    "arguments": arguments,
                    "versions": record.versions(),
                    "renderer": backend.renderer(),
                    "figures": figures,
                }
            ),
        }
        for name, content in files.items():
            folder.write(name, content)
    return {
        "out": str(folder.path),
        "files": len(files),
        "seconds": round(time.perf_counter() - started, 3),
        **figures,
    }


def summary(found: Sweep) -> dict[str, Any]:
    """The cameras' figures at the reference distance, in millimetres and percent."""
    at = found.reference
    return {
        "reference_m": found.distances_m[at],
        "sigma_d_px": round(found.sigma_d_px, 4),
        "cameras": {
            found.name(camera): {
                "noise_mm": round(1e3 * figures[at].noise_m, 3),
                "law_mm": round(1e3 * found.law_m(camera)[at], 3),
                "holes_pct": round(100 * figures[at].hole_rate, 2),
                "wrong_pct": round(100 * figures[at].wrong, 2),
            }
            for camera, figures in zip(found.cameras, found.figures, strict=True)
        },
    }


def listed(found: Sweep) -> dict[str, Any]:
    """Everything that was measured, as plain values in SI units and shares."""
    from starling.sim.commands.sweep import figures as sweep_figures

    cameras = []
    for camera, figures in zip(found.cameras, found.figures, strict=True):
        points = [
            {
                "distance_m": distance,
                "bias_m": point.bias_m,
                "noise_m": point.noise_m,
                "law_m": law,
                "noise_px": point.noise_px,
                "wall_holes": point.wall_holes,
                "hole_rate": point.hole_rate,
                "wrong": point.wrong,
                "unseen": point.unseen,
                "holes": dict(point.holes),
            }
            for distance, point, law in zip(
                found.distances_m, figures, found.law_m(camera), strict=True
            )
        ]
        cameras.append(
            {
                "name": found.name(camera),
                **camera.values,
                "focal_baseline_px_m": camera.sensor.focal_baseline_px_m,
                "nearest_m": sweep_figures.nearest_m(camera.sensor),
                "points": points,
            }
        )
    return {
        "reference_m": found.distances_m[found.reference],
        "sigma_d_px": found.sigma_d_px,
        "cameras": cameras,
    }


def table(found: Sweep) -> str:
    """The same as `listed`, as CSV: a row for every camera and distance."""
    rows = [
        {
            **{name: camera[name] for name in ("name", *AXES, "focal_baseline_px_m", "nearest_m")},
            **{key: value for key, value in point.items() if key != "holes"},
            **{f"holes_{cause}": share for cause, share in point["holes"].items()},
        }
        for camera in listed(found)["cameras"]
        for point in camera["points"]
    ]
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _cell(value) for key, value in row.items()} for row in rows)
    return text.getvalue()


def _cell(value: Any) -> Any:
    """Short numbers; an empty cell where nothing could be measured."""
    if not isinstance(value, float):
        return value
    return f"{value:.6g}" if math.isfinite(value) else ""
