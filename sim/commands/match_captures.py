"""`starling match`: run our matcher on captured infrared pairs and measure its depth."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import metrics
from starling.sim.captures import capture, writer
from starling.sim.captures.capture import CapturedScene
from starling.sim.console import progress
from starling.sim.console.output import OutputFolder, refuse_own_input
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.reason import Reason
from starling.sim.sensor.post import refuse_single_frame
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo import depth, measurement

_LITTLE = 0.3  # Share of pixels with depth below which a swapped pair is tried.
_SWAPPED = 2.0  # Factor by which a swapped pair must have more depth to be reported.

_Map = NDArray[np.float32]  # (h, w), NaN = no value.


def match_captures(
    captures: str,
    sensor: Sensor,
    *,
    out: Path | None = None,
    force: bool = False,
    options: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Match the first frame of every scene and compare the disparities.

    Args:
        captures: a capture set or one scene in it, with infrared pairs.
        sensor: sensor with the captures' geometry; its matcher and range are used.
        out: folder to create for our depth, as a capture set. None writes no files.
        force: replace an earlier folder.
        options: further command-line options to record, as typed.
        track: wraps the loop over scenes.

    Returns:
        `{"scenes": {NAME: {"pair": P, "ours": F, "device": F, "agreement": F}}, "median": {...}}`,
        with F the figures of `starling.sim.metrics.disparity_figures`. P has `fill`, the share of
        pixels with depth, and `left_right_agreement`, the share of matches that both directions
        confirm; both need no reference. `ours` and `device` compare with
        the reference depth, `agreement` compares ours with the device. Only `agreement` has
        `ndp_iou`, without reference depth over all pixels right of the left band. Figures without
        reference or device depth are None. A warning reports depths of a constant ratio.

    Raises:
        InputError: captures that cannot be read or have no infrared pair, or a folder that
            cannot be written or is the captures' own. Also structured light for a pair.
    """
    refuse_single_frame(sensor.post, 1)  # Only the first frame of each scene is matched.
    opened = capture.open_set(captures)
    scenes = opened.scenes
    figures: dict[str, Any] = {}
    if out is None:
        for scene in track(scenes, "match"):
            figures[scene.name] = _figures(scene, _match(scene, sensor))
        return {"scenes": figures, "median": _medians(figures)}
    refuse_own_input(out, opened.path)
    with OutputFolder(out, force=force) as folder:
        for scene in track(scenes, "match"):
            depth_map = _match(scene, sensor)
            figures[scene.name] = _figures(scene, depth_map)
            _write(folder, scene, depth_map)
        result = {"scenes": figures, "median": _medians(figures)}
        writer.write_set(
            folder,
            dataclasses.replace(
                scenes[0].info,
                **dataclasses.asdict(Pinhole.from_camera(sensor)),
                baseline_m=sensor.baseline_m,  # The depth was computed with it.
                notes=f"depth by starling match {captures}",
            ),
            sensor,
            verb="match",
            arguments={"captures": captures, **(options or {})},
            figures=result,
        )
    return {**result, "out": str(folder.path)}


def _match(scene: CapturedScene, sensor: Sensor) -> depth.DepthMap:
    scene.refuse_other_sensor(sensor)
    frame = scene.frame(scene.frames[0])
    if frame.ir_left is None or (frame.ir_right is None and sensor.kind == "stereo"):
        raise errors.refuse(
            f"scene {scene.name}",
            "must hold ir_left.png and ir_right.png",
            scene.path,
            "Matching needs an infrared pair.",
        )
    depth_map = measurement.measure(frame.ir_left, frame.ir_right, sensor, causes={})
    if frame.ir_right is not None and depth_map.valid.mean() < _LITTLE:
        swapped = measurement.measure(frame.ir_right, frame.ir_left, sensor, causes={})
        if swapped.valid.mean() > _SWAPPED * depth_map.valid.mean():
            fills = f"{depth_map.valid.mean():.2g} and {swapped.valid.mean():.2g} if swapped"
            warnings.warn(
                f"{scene.path}: the share of pixels with depth is {fills}. Are left and right "
                f"swapped?",
                stacklevel=2,
            )
    return depth_map


def _figures(scene: CapturedScene, ours: depth.DepthMap) -> dict[str, dict[str, float | None]]:
    """Measure one scene; without reference depth the device's map locates depth edges."""
    device = _disparity(scene, scene.frame(scene.frames[0]).depth_m)
    truth = _disparity(scene, scene.truth_m())
    known = device if truth is None else truth
    holes = None if device is None else _compared(device, truth)
    _warn_of_scale(scene, ours.disparity_px, device)
    return {
        "pair": _pair_figures(ours),
        "ours": _compare(ours.disparity_px, truth, known),
        "device": _compare(device, truth, known),
        "agreement": _compare(ours.disparity_px, device, known, holes_where=holes),
    }


def _compared(device: _Map, truth: _Map | None) -> NDArray[np.bool_]:
    """Pixels where no-depth pixels are compared: right of the band, with truth if it is known."""
    return metrics.reached_pixels(np.zeros_like(device) if truth is None else truth)


def _warn_of_scale(scene: CapturedScene, ours_px: _Map, device_px: _Map | None) -> None:
    """Warn of a constant ratio of depths: both were computed with different f b."""
    ratio = None if device_px is None else metrics.constant_ratio(ours_px, device_px)
    if ratio is not None:
        stated = scene.info.focal_baseline_px_m
        warnings.warn(
            f"{scene.path}: the device's depth is {ratio:.4f} times ours at all distances. It was "
            f"computed with f b = {ratio * stated:.2f} px m; capture.toml states {stated:.2f}. "
            "Check fx_px and baseline_m.",
            stacklevel=2,
        )


def _pair_figures(ours: depth.DepthMap) -> dict[str, float | None]:
    """Measure what needs no reference: fill, and agreement of both matching directions."""
    disagree = int((ours.reason == Reason.LEFT_RIGHT).sum())
    matched = int(ours.valid.sum()) + disagree
    return {
        "fill": float(ours.valid.mean()),
        "left_right_agreement": 1 - disagree / matched if matched else None,
    }


def _compare(
    disparity_px: _Map | None,
    reference: _Map | None,
    known: _Map | None,
    *,
    holes_where: NDArray[np.bool_] | None = None,
) -> dict[str, float | None]:
    """Return the figures F of one comparison; all None if a map or scored pixels are missing."""
    nothing = dict.fromkeys(field.name for field in dataclasses.fields(metrics.DisparityFigures))
    if disparity_px is None or reference is None or known is None:
        return nothing
    scored = metrics.scored_pixels(known)
    if not scored.any():
        return nothing
    holes = None if holes_where is None else reference
    return dataclasses.asdict(
        metrics.disparity_figures(
            disparity_px, reference, scored, holes_of_px=holes, holes_where=holes_where
        )
    )


def _disparity(scene: CapturedScene, depth_m: _Map | None) -> _Map | None:
    return None if depth_m is None else scene.info.disparity_px(depth_m)


def _medians(figures: dict[str, Any]) -> dict[str, dict[str, float | None]]:
    """Return the median of every figure over the scenes that have it."""
    scenes = list(figures.values())
    return {
        group: {name: _median([scene[group][name] for scene in scenes]) for name in row}
        for group, row in scenes[0].items()
    }


def _median(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None and np.isfinite(value)]
    return float(np.median(known)) if known else None


def _write(folder: OutputFolder, scene: CapturedScene, depth_map: depth.DepthMap) -> None:
    """Write our depth in the captures' depth unit; infrared images are not copied."""
    from starling.sim.scene.captured import known_geometry

    unit = scene.info.depth_unit_m
    writer.write_scene(
        folder,
        scene.name,
        room=scene.room,
        truth_m=scene.truth_m(),
        depth_unit_m=unit,
        known=known_geometry.for_folder(scene, folder.path / scene.name),
    )
    writer.write_frame(folder, scene.name, 0, depth=depth_map, depth_unit_m=unit)
