"""`starling sweep`: measure depth error and holes against distance for many cameras."""

from __future__ import annotations

import csv
import io
import math
import time
import warnings
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from starling.patterns import errors
from starling.sim.commands.sweep import axes as sweep_axes
from starling.sim.commands.sweep.axes import AXES
from starling.sim.commands.sweep.figures import Figures, SweepScenes, measure
from starling.sim.commands.sweep.figures import Sweep as Sweep
from starling.sim.console import progress, record
from starling.sim.console.output import RECORD, OutputFolder
from starling.sim.render import backend, emission
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

DISTANCES_M = (0.4, 0.6, 0.9, 1.3, 2.0, 3.0, 4.0, 6.0)
REFERENCE_M = 1.0  # The law's disparity noise is the base's at the distance nearest to this [m].


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
        base: the base camera; the others differ from it.
        axes: values by axis in `starling.sim.commands.sweep.axes.AXES`, in addition to the base's
            value. Empty sweeps all axes with their default values.
        distances_m: distances of the scenes [m], 0.1 to 10.
        full: all combinations of the values; otherwise one axis at a time.
        seed: seed of the noise, the same for all cameras.
        track: wraps the loop over cameras and distances.

    Raises:
        InputError: if the base, a value or a distance is invalid; raised before any rendering.
    """
    cameras = sweep_axes.cameras(base, sweep_axes.chosen(base, axes), full=full)
    distances = sorted(set(map(float, distances_m)))
    if not distances:
        raise errors.refuse("distance_m", "must hold a distance", "none", "Give metres: 0.5 1 2.")
    for distance in distances:
        errors.in_interval("distance_m", distance, 0.1, 10.0, "Give metres.")
    errors.in_interval("seed", seed, 0, 2**63 - 1, "Give a whole number from 0.")
    for camera in cameras:  # Refuses invalid patterns now, and caches the valid ones.
        part = camera.sensor.projector
        for number in range(len(emission.emitters(part))):
            emission.irradiance_at_unit_distance(part, number)
    from starling.sim import simulate

    simulate.refuse_impossible(base, 1)
    measured: list[list[Figures]] = [[] for _ in cameras]
    stages = None
    for distance, number in track(list(product(distances, range(len(cameras)))), "sweep"):
        if stages is None or number == 0:
            stages = SweepScenes.at_distance(distance)
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
    options: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Sweep and write a folder: `sweep.png`, `sweep.csv`, `sweep.json`, `sensor.toml` of the base.

    Args:
        base: as in `sweep`, and so are `axes`, `full`, `seed` and `track`.
        axes: an axis without values is ignored.
        out: folder to create.
        distances_m: empty uses `DISTANCES_M`.
        force: replace an earlier sweep.
        options: further command-line options to record, as typed.

    Returns:
        `{"out", "files", "seconds", "reference_m", "sigma_d_px", "cameras": {NAME: {"noise_mm",
        "law_mm", "holes_pct", "wrong_pct"}}}`, the cameras' figures at the reference distance.

    Raises:
        InputError: as `sweep`, or if the folder cannot be written; no partial output remains.
    """
    started = time.perf_counter()
    with OutputFolder(out, force=force) as folder:
        result = sweep(
            base, axes, distances_m=distances_m or DISTANCES_M, full=full, seed=seed, track=track
        )
        from starling.sim.commands.sweep import picture

        figures = summary(result)
        _warn_of_unmeasured(result)
        arguments = {
            "axes": sweep_axes.chosen(base, axes),
            "distance_m": result.distances_m,
            "full": full,
            "seed": seed,
            **(options or {}),
        }
        files: dict[str, bytes | str] = {
            "sweep.png": picture.draw(result),
            "sweep.csv": table(result),
            "sweep.json": record.dumps(listed(result)),
            "sensor.toml": presets.dumps(base),
            RECORD: record.of_run("sweep", arguments, figures, backend.renderer()),
        }
        for name, content in files.items():
            folder.write(name, content)
    return {
        "out": str(folder.path),
        "files": len(files),
        "seconds": round(time.perf_counter() - started, 3),
        **figures,
    }


def summary(result: Sweep) -> dict[str, Any]:
    """Return the cameras' figures at the reference distance, in millimetres and percent."""
    reference = result.reference
    return {
        "reference_m": result.distances_m[reference],
        "sigma_d_px": round(result.sigma_d_px, 4),
        "cameras": {
            result.name(camera): {
                "noise_mm": round(1e3 * figures[reference].noise_m, 3),
                "law_mm": round(1e3 * result.law_m(camera)[reference], 3),
                "holes_pct": round(100 * figures[reference].hole_rate, 2),
                "wrong_pct": round(100 * figures[reference].wrong, 2),
            }
            for camera, figures in zip(result.cameras, result.figures, strict=True)
        },
    }


def _warn_of_unmeasured(result: Sweep) -> None:
    """Warn of cameras without figures at the reference distance, and name the main cause."""
    causes = {}
    for camera, figures in zip(result.cameras, result.figures, strict=True):
        point = figures[result.reference]
        if not math.isfinite(point.noise_m):
            causes[result.name(camera)] = max(point.holes, key=lambda name: point.holes[name])
    if causes:
        listed_causes = ", ".join(f"{name} ({cause})" for name, cause in causes.items())
        warnings.warn(
            f"no figures at {result.distances_m[result.reference]:g} m, where most of the wall has "
            f"no depth: {listed_causes}.",
            stacklevel=2,
        )


def listed(result: Sweep) -> dict[str, Any]:
    """Return all figures as plain values in SI units and shares."""
    from starling.sim.commands.sweep import figures as sweep_figures

    cameras = []
    for camera, figures in zip(result.cameras, result.figures, strict=True):
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
                result.distances_m, figures, result.law_m(camera), strict=True
            )
        ]
        cameras.append(
            {
                "name": result.name(camera),
                **camera.values,
                "focal_baseline_px_m": camera.sensor.focal_baseline_px_m,
                "nearest_m": sweep_figures.nearest_m(camera.sensor),
                "points": points,
            }
        )
    return {
        "reference_m": result.distances_m[result.reference],
        "sigma_d_px": result.sigma_d_px,
        "cameras": cameras,
    }


def table(result: Sweep) -> str:
    """Return the figures of `listed` as CSV: one row per camera and distance."""
    rows = [
        {
            **{name: camera[name] for name in ("name", *AXES, "focal_baseline_px_m", "nearest_m")},
            **{key: value for key, value in point.items() if key != "holes"},
            **{f"holes_{cause}": share for cause, share in point["holes"].items()},
        }
        for camera in listed(result)["cameras"]
        for point in camera["points"]
    ]
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _cell(value) for key, value in row.items()} for row in rows)
    return text.getvalue()


def _cell(value: Any) -> Any:
    """Format a number with six digits; empty if it is not finite."""
    if not isinstance(value, float):
        return value
    return f"{value:.6g}" if math.isfinite(value) else ""
