"""Figures of a calibration, as written to `report.json` and printed by `--json`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.calibration.fit_sensor import Calibration
from starling.calibration.heldout import SceneScore
from starling.calibration.solution import Estimate

_NAN = float("nan")


def calibration_figures(calibration: Calibration) -> dict[str, Any]:
    """Convert a calibration to plain values; a missing value is NaN, and null in JSON.

    Returns:
        - `parameters`, `derived`: by name `value`, `sd`, `unit`, `start`. If several solutions
          fitted a parameter, the last one counts. `sd` is inf for an unidentifiable parameter.
        - `undetermined`, `warnings`: sentences.
        - `heldout`: medians over scenes, and `scenes`; see `heldout_figures`.
        - `scenes`: values by scene, such as pattern scale and ambient light.
        - `rooms`: fitted rooms. `seconds`: total wall time. `stages`: wall time by stage [s].
    """
    solutions = calibration.solutions.values()
    return {
        "parameters": {estimate.name: _estimate(estimate) for estimate in calibration.estimates},
        "derived": {
            estimate.name: _estimate(estimate)
            for solution in solutions
            for estimate in solution.derived
        },
        "undetermined": list(calibration.undetermined),
        "warnings": list(calibration.warnings),
        "heldout": heldout_figures(calibration),
        "scenes": _scenes(calibration),
        "rooms": list(calibration.fitted_rooms),
        "seconds": float(sum(calibration.seconds.values())),
        "stages": {stage: float(seconds) for stage, seconds in calibration.seconds.items()},
    }


def heldout_figures(calibration: Calibration) -> dict[str, Any]:
    """Summarise the correlation of simulated and real infrared images of held-out scenes.

    Returns:
        - `ncc`, `ncc_p25`: median over scenes of the windows' median and lower quartile. Windows
          of both imagers are pooled.
        - `ceiling`, `ceiling_p25`: the same for the real right image in the left view.
        - `mirrored`: the median with the mirrored pattern.
        - `before`: `ncc` and `ncc_p25` of the initial sensor.
        - `scenes`: the same by scene, and by imager. A missing value is NaN.
    """
    before = {scored.scene: scored for scored in calibration.before}
    scenes = {
        scored.scene: _scored(scored, before.get(scored.scene)) for scored in calibration.heldout
    }
    names = ("ncc", "ncc_p25", "ceiling", "ceiling_p25", "mirrored")
    before_scores = [scene["before"] for scene in scenes.values()]
    return {
        **{name: _median(scene[name] for scene in scenes.values()) for name in names},
        "before": {
            name: _median(scored[name] for scored in before_scores) for name in ("ncc", "ncc_p25")
        },
        "scenes": scenes,
    }


def scene_parameter(name: str) -> tuple[str, str]:
    """Split `NAME[SCENE]`, the name of a parameter of one scene; otherwise the scene is ""."""
    base, bracket, scene = name.partition("[")
    return (base, scene[:-1]) if bracket and scene.endswith("]") else (name, "")


def _estimate(estimate: Estimate) -> dict[str, Any]:
    numbers = {key: float(getattr(estimate, key)) for key in ("value", "sd", "start")}
    return {**numbers, "unit": estimate.unit}


def _scenes(calibration: Calibration) -> dict[str, dict[str, float]]:
    scenes: dict[str, dict[str, float]] = {}
    for estimate in calibration.estimates:
        name, scene = scene_parameter(estimate.name)
        if scene:
            scenes.setdefault(scene, {})[name] = float(estimate.value)
    for solution in calibration.solutions.values():
        for scene, values in solution.scenes.items():
            scenes.setdefault(scene, {}).update(
                {name: float(value) for name, value in values.items()}
            )
    return scenes


def _scored(scored: SceneScore, before: SceneScore | None) -> dict[str, Any]:
    ceiling = _windows([scored.ceiling])
    return {
        "room": scored.room,
        "pattern_scale": float(scored.scale),
        **_by_imager(scored.ncc),
        "ceiling": ceiling["ncc"],
        "ceiling_p25": ceiling["ncc_p25"],
        "mirrored": _windows(scored.mirrored.values())["ncc"],
        "before": _by_imager(before.ncc if before else {}),
    }


def _by_imager(ncc: Mapping[Any, NDArray[np.float32]]) -> dict[str, Any]:
    """Return the figures of both imagers' pooled windows, and of each imager."""
    return {
        **_windows(ncc.values()),
        **{side: _windows([ncc[side]] if side in ncc else []) for side in ("left", "right")},
    }


def _windows(parts: Iterable[NDArray[np.float32]]) -> dict[str, float]:
    """Return median and lower quartile of the windows' correlations; NaN without windows."""
    pooled = np.concatenate([*parts, np.empty(0, np.float32)])
    if not pooled.size:
        return {"ncc": _NAN, "ncc_p25": _NAN}
    quartile, median = np.percentile(pooled, (25, 50))
    return {"ncc": float(median), "ncc_p25": float(quartile)}


def _median(values: Iterable[float]) -> float:
    """Return the median of the finite values."""
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else _NAN
