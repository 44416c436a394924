"""A calibration's figures, as `report.json` and `--json` have them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.calibration.heldout import Scored
from starling.calibration.result import Calibration
from starling.calibration.solution import Estimate

_NAN = float("nan")


def figures(calibration: Calibration) -> dict[str, Any]:
    """Put a calibration into plain values; what cannot be had is NaN (`starling.sim.console.record.dumps`: null).

    Returns:
        - `parameters`, `derived`: by name `value`, `sd`, `unit`, `start`; of a name that several
          solutions fitted, the last. `sd` is inf where the captures do not determine it.
        - `undetermined`, `warnings`: sentences.
        - `heldout`: medians over scenes, and `scenes`; see `heldout_figures`.
        - `scenes`: by scene, what differs between them: pattern scale, ambient light ...
        - `rooms`: fitted ones. `seconds`: total. `stages`: seconds of each.
    """
    solutions = calibration.solutions.values()
    return {
        "parameters": {one.name: _estimate(one) for one in calibration.estimates},
        "derived": {one.name: _estimate(one) for found in solutions for one in found.derived},
        "undetermined": list(calibration.undetermined),
        "warnings": list(calibration.warnings),
        "heldout": heldout_figures(calibration),
        "scenes": _scenes(calibration),
        "rooms": list(calibration.fitted_rooms),
        "seconds": float(sum(calibration.seconds.values())),
        "stages": {stage: float(seconds) for stage, seconds in calibration.seconds.items()},
    }


def heldout_figures(calibration: Calibration) -> dict[str, Any]:
    """Tell how like their real infrared the re-simulated held-out scenes are.

    Returns:
        `ncc` and `ncc_p25`, `ceiling` and `ceiling_p25`: medians over scenes of the windows' median
        and lower quartile, both imagers' windows in one; `mirrored`: likewise the median by the
        pattern turned over; `before`: `ncc` and `ncc_p25` of the sensor that the fit began from;
        `scenes`: the same of each, by imager too. NaN where there is none.
    """
    before = {one.scene: one for one in calibration.before}
    scenes = {one.scene: _scored(one, before.get(one.scene)) for one in calibration.heldout}
    names = ("ncc", "ncc_p25", "ceiling", "ceiling_p25", "mirrored")
    began = [scene["before"] for scene in scenes.values()]
    return {
        **{name: _median(scene[name] for scene in scenes.values()) for name in names},
        "before": {name: _median(one[name] for one in began) for name in ("ncc", "ncc_p25")},
        "scenes": scenes,
    }


def scene_parameter(name: str) -> tuple[str, str]:
    """Split the name of one scene's own parameter, `NAME[SCENE]`; the scene is "" for any other."""
    own, bracket, scene = name.partition("[")
    return (own, scene[:-1]) if bracket and scene.endswith("]") else (name, "")


def _estimate(one: Estimate) -> dict[str, Any]:
    return {
        "value": float(one.value),
        "sd": float(one.sd),
        "unit": one.unit,
        "start": float(one.start),
    }


def _scenes(calibration: Calibration) -> dict[str, dict[str, float]]:
    scenes: dict[str, dict[str, float]] = {}
    for one in calibration.estimates:
        own, scene = scene_parameter(one.name)
        if scene:
            scenes.setdefault(scene, {})[own] = float(one.value)
    for solution in calibration.solutions.values():
        for scene, values in solution.scenes.items():
            scenes.setdefault(scene, {}).update(
                {name: float(value) for name, value in values.items()}
            )
    return scenes


def _scored(one: Scored, before: Scored | None) -> dict[str, Any]:
    ceiling = _windows([one.ceiling])
    return {
        "room": one.room,
        "pattern_scale": float(one.scale),
        **_by_imager(one.ncc),
        "ceiling": ceiling["ncc"],
        "ceiling_p25": ceiling["ncc_p25"],
        "mirrored": _windows(one.mirrored.values())["ncc"],
        "before": _by_imager(before.ncc if before else {}),
    }


def _by_imager(ncc: Mapping[Any, NDArray[np.float32]]) -> dict[str, Any]:
    """Both imagers' windows in one, and each imager's."""
    return {
        **_windows(ncc.values()),
        **{side: _windows([ncc[side]] if side in ncc else []) for side in ("left", "right")},
    }


def _windows(parts: Iterable[NDArray[np.float32]]) -> dict[str, float]:
    """Median and lower quartile of windows' correlations; NaN of none."""
    pooled = np.concatenate([*parts, np.empty(0, np.float32)])
    if not pooled.size:
        return {"ncc": _NAN, "ncc_p25": _NAN}
    quartile, median = np.percentile(pooled, (25, 50))
    return {"ncc": float(median), "ncc_p25": float(quartile)}


def _median(values: Iterable[float]) -> float:
    """Median of those that are known."""
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else _NAN
