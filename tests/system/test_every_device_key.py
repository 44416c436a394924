"""Every key of sensor files, plans and device presets changes an output or gives a word.

The keys are taken from the code, so that a new one without effect fails.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import tomli_w
import trimesh

from starling.patterns.errors import InputError
from starling.sim.captures import info as capture_info
from starling.sim.captures import writer
from starling.sim.datasets import plan as plans
from starling.sim.datasets.render_view import camera, info_of, render
from starling.sim.imaging import colour_picture
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Motion
from starling.sim.sensor import edits, presets, realsense, structure
from starling.sim.sensor.imager import EXPOSURE
from starling.sim.sensor.realsense import controls
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import expose, refuse_impossible, render_layers
from tests.system.test_every_key import digest, said

# --- sensor.toml ------------------------------------------------------------------------------

EMITTERS = [{"offset_m": [0.002, 0.0, 0.0], "pattern": "d435"}, {"power_share": 0.5}]
PROJECTOR = {
    **{"pattern_scale": 1.02, "dropped_dots": 0.05, "shifted_dots_mrad": 2.0, "haze": 0.1},
    **{"dot_blur_mrad": 1.0, "defocus_mrad_m": 2.0, "falloff": 1.0, "flicker": 0.05},
    **{"rotation_deg": [0.1, 0.1, 0.1], "emitters": EMITTERS, "pattern": "d415"},
}
IMAGER = {
    **{"lens.corner_blur_px": 0.4, "lens.filter_width_nm": 40.0, "lens.veil": 0.02},
    **{"alignment.offset_x_px": 0.1, "alignment.offset_y_px": 0.1, "alignment.roll_deg": 0.2},
    **{"alignment.pitch_deg": 0.2, "alignment.yaw_deg": 0.2, "alignment.magnification": 1.01},
    **{"alignment.distortion_px": 0.3, "alignment.warp_px": [[0.1, 0.2], [0.2, 0.3]]},
    **{"rolling_shutter_s": 0.01, "crosstalk": 0.05, "column_noise_e": 3.0, "row_noise_e": 3.0},
    **{"hot_pixels": 0.002, "blooming": 0.1, "smoothing_px": 0.4, "gamma": 1.2},
    **{"auto_exposure_level": 0.0, "exposure_s": 0.03},
}
BASE: dict[str, Any] = {
    **{"width": 96, "height": 64, "fx_px": 60.0, "fy_px": 60.0, "cx_px": 47.5, "cy_px": 31.5},
    **{"colour.width": 64, "colour.height": 48, "colour.fx_px": 50.0, "colour.fy_px": 50.0},
    **{"colour.cx_px": 31.5, "colour.cy_px": 23.5, "colour.rotation_deg": [0.5, 0.5, 0.5]},
    **{f"projector.{name}": value for name, value in PROJECTOR.items()},
    **{f"{side}.{name}": value for side in ("left", "right") for name, value in IMAGER.items()},
    **{"baseline_error": 0.01, "matcher.search_px": 64, "matcher.checks.speckle_count": 20},
    **{"matcher.refinement.locking_px": 0.1, "matcher.checks.border_px": 2.0},
    **{"post.near_m": 0.2, "post.far_m": 1.6, "post.spatial_alpha": 0.5, "post.registered": True},
    "post.temporal_alpha": 0.5,
}
# Values of keys whose usual change is refused or too small to be seen.
VALUES: dict[str, Any] = {
    **{"kind": "structured_light", "width": 97, "projector.pattern": "d415-left"},
    **{"projector.pattern_scale": 0.98, "projector.emitters": []},
    **{"matcher.engine.census_px": 7, "matcher.engine.support_px": 5, "matcher.search_px": 32},
    **{"matcher.engine.difference_weight": 0.5, "matcher.engine.second_peak": 200.0},
    **{"matcher.engine.neighbour_peak": 100.0, "matcher.engine.kind": "Block"},
    **{"matcher.checks.uniqueness": 40.0, "matcher.checks.texture_dn": 20.0},
    **{"matcher.checks.left_right_mean_px": 0, "matcher.checks.jump_px": 0.2},
    **{"matcher.refinement.median_px": 0, "matcher.refinement.smooth_px": 5},
    **{"matcher.refinement.smooth_rows_px": 3, "post.near_m": 0.5, "post.hole_filling": "nearest"},
    **{"post.temporal_persistence": 8, "matcher.refinement.smooth_step_px": 0.1},
}
# Further edits that make a key act.
WITH: dict[str, dict[str, Any]] = {
    **{f"{side}.blooming": {"imager.exposure_s": 1.0} for side in ("left", "right")},
    "left.auto_exposure_max_s": {"left.auto_exposure_level": 0.5},
    "projector.pattern": {"projector.emitters": []},
}
PAIRED = ("bit_depth", "dropped_bits")  # Equal on both sides, or refused.


def leaves(table: Mapping[str, Any], start: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{start}{key}.")
        else:
            yield f"{start}{key}", value


def sensor(values: Mapping[str, Any] = {}) -> Sensor:
    return edits.with_values(presets.load("d435"), {**BASE, **values}.items())


SENSOR = dict(leaves(structure.to_table(sensor())))
ENGINES = {
    "SemiGlobalBlock": {"mode": "hh", "block_px": 9, "small_penalty": 20, "large_penalty": 2000},
    "Block": {"block_px": 9},
}


@cache
def stage(velocity_m_s: float = 0.0) -> MitsubaScene:
    motion = Motion(velocity_m_s=(velocity_m_s, 0.0, 0.0))
    return MitsubaScene(dataclasses.replace(scenes.staircase(0.4), motion=motion))


def layers_of(device: Sensor, path: str) -> Any:
    """Render; what acts on rendered layers only shares those of the base."""
    if path.startswith(("left.", "right.", "matcher.", "post.")) and "rolling" not in path:
        return _base_layers()
    return render_layers(stage(0.5 if "rolling" in path else 0.0), device)


@cache
def _base_layers() -> Any:
    return render_layers(stage(), sensor())


def outputs(device: Sensor, path: str) -> Any:
    """Return the files that `simulate` writes: camera, and images of two frames."""
    refuse_impossible(device, 2)
    rows: list[Any] = [writer.info_of(device, source="", licence="", notes="")]
    if path.startswith("colour."):
        rows += digest(colour_picture.picture(stage().scene, device))
    rendered, past = layers_of(device, path), None
    for frame in range(2):
        shot = expose(rendered, stage().scene, device, frame=frame, past=past)
        past = shot.depth.history
        rows += digest(shot.ir_left, shot.ir_right, shot.depth.depth_m, shot.registered_m)
    return rows


def moved(path: str, value: Any) -> Any:
    if path in VALUES:
        return VALUES[path]
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return f"other-{value}"
    if isinstance(value, list):
        return [moved("", item) for item in value]
    return value + 1 if isinstance(value, int) else 0.8 * value


@pytest.mark.parametrize("path", SENSOR)
def test_every_key_of_a_sensor_matters(path: str, tmp_path: Path) -> None:
    if path.removeprefix("right.") in EXPOSURE:
        with pytest.warns(UserWarning, match=f"{path} not used: both imagers take the left one's"):
            edits.apply(sensor(), [f"{path}=0.02"])
        return
    start = WITH.get(path, {})
    before = outputs(sensor(start), path)
    value = dict(leaves(structure.to_table(sensor(start)))).get(path, SENSOR[path])
    after = said(lambda: outputs(sensor({**start, path: moved(path, value)}), path))
    assert after != repr(before)
    refusable = path.endswith(PAIRED) or path in ("kind", "width", "height")
    assert refusable or "refused: " not in after, after


@pytest.mark.parametrize("name", [item.name for item in dataclasses.fields(plans.PosePlan)])
def test_names_of_poses_are_keys(name: str) -> None:
    assert name in known_keys("pose", {"pose": {"zzz": 1}})


@pytest.mark.parametrize("engine", ENGINES)
def test_every_key_of_the_other_engines_matters(engine: str) -> None:
    stock = {"matcher.engine": {"kind": engine}}
    start = edits.with_values(sensor(), [("matcher.setting", "opencv")])
    del stock
    for name, value in ENGINES[engine].items():
        table = {"kind": engine, name: value}
        plain = dataclasses.replace(start.matcher, engine=_engine({"kind": engine}))
        other = dataclasses.replace(start.matcher, engine=_engine(table))
        first = outputs(dataclasses.replace(start, matcher=plain), "matcher.")
        assert outputs(dataclasses.replace(start, matcher=other), "matcher.") != first, name
