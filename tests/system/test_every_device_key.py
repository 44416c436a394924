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
import trimesh

from starling.patterns.errors import InputError
from starling.sim.captures import writer
from starling.sim.datasets import plan as plans
from starling.sim.imaging import colour_picture
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Motion
from starling.sim.sensor import edits, matcher, presets, realsense, structure
from starling.sim.sensor.imager import EXPOSURE
from starling.sim.sensor.realsense import controls
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import expose, refuse_impossible, render_layers
from tests.system.test_every_key import CAPTURE, digest, said, write_captures

pytestmark = pytest.mark.slow

# --- sensor.toml ------------------------------------------------------------------------------

EMITTER = {"offset_m": [0.002, 0.0, 0.0], "rotation_deg": [0.2, 0.2, 0.2], "pattern": "uniform"}
EMITTERS = [EMITTER, {"power_share": 0.5}]
PROJECTOR = {
    **{"pattern_scale": 1.02, "dropped_dots": 0.05, "shifted_dots_mrad": 2.0, "haze": 0.1},
    **{"dot_blur_mrad": 1.0, "defocus_mrad_m": 2.0, "falloff": 1.0, "flicker": 0.05},
    **{"fov_x_deg": 45.0, "fov_y_deg": 35.0, "rotation_deg": [0.1, 0.1, 0.1], "dot_density": 0.2},
}
IMAGER = {
    **{"lens.corner_blur_px": 0.4, "lens.filter_width_nm": 40.0, "lens.veil": 0.02},
    **{"alignment.offset_x_px": 0.1, "alignment.offset_y_px": 0.1, "alignment.roll_deg": 0.2},
    **{"alignment.pitch_deg": 0.2, "alignment.yaw_deg": 0.2, "alignment.magnification": 1.01},
    **{"alignment.distortion_px": 0.3, "alignment.warp_px": [[0.1, 0.2], [0.2, 0.3]]},
    "alignment.waves_px": 0.2,
    "pattern_contrast": 0.05,
    "noise_correlation": 0.3,
    "lens.spot_shape": 0.5,
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
    **{"kind": "structured_light", "width": 97, "projector.pattern": "uniform"},
    **{"projector.pattern_scale": 0.98, "projector.emitters": EMITTERS},
    **{"matcher.engine.census_px": 7, "matcher.engine.support_px": 5, "matcher.search_px": 16},
    **{"matcher.engine.difference_weight": 0.5, "matcher.engine.second_peak": 200.0},
    **{"matcher.engine.neighbour_peak": 100.0, "matcher.engine.kind": "Block"},
    "matcher.engine.subpixel_fit": "equal_slopes",
    **{
        "matcher.checks.uniqueness": 40.0,
        "matcher.checks.speckle_count": 5000,
        "matcher.checks.speckle_step_px": 0.05,
        "matcher.checks.texture_dn": 20.0,
        "matcher.checks.dark_noise": 10.0,
    },
    **{"matcher.checks.left_right_mean_px": 0, "matcher.checks.left_right_rows_px": 1},
    "matcher.checks.jump_px": 0.2,
    **{"matcher.checks.support_share": 0.9, "matcher.checks.support_step_px": 0.05},
    "matcher.checks.border_px": 8.0,
    **{"matcher.refinement.median_px": 0, "matcher.refinement.smooth_px": 5},
    "matcher.refinement.mean_quantum_px": 0.25,
    **{"matcher.refinement.smooth_rows_px": 3, "post.near_m": 1.0, "post.hole_filling": "nearest"},
    **{f"{side}.alignment.warp_px": [[0.2, 0.1], [0.3, 0.2]] for side in ("left", "right")},
    **{"left.mosaic": "rggb", "right.mosaic": "rggb"},
    **{"left.auto_exposure_max_gain": 4.0, "left.auto_exposure_roi": 0.5},
    **{"left.bit_depth": 10, "right.bit_depth": 10, "left.auto_exposure_level": 0.5},
    **{"post.temporal_persistence": 8, "matcher.refinement.smooth_step_px": 0.1},
}
LARGER = {
    **{"width": 192, "height": 128, "fx_px": 120.0},
    **{"fy_px": 120.0, "cx_px": 95.5, "cy_px": 63.5},
}
# Further edits that make a key act.
WITH: dict[str, dict[str, Any]] = {
    **{f"{side}.blooming": {"imager.exposure_s": 0.1} for side in ("left", "right")},
    "matcher.search_px": {"baseline_m": 0.2},
    "matcher.extended": {**LARGER, "baseline_m": 0.15, "matcher.search_px": 16},
    "matcher.checks.dark_noise": {"imager.read_noise_e": 50.0},
    "matcher.checks.support_step_px": {"matcher.checks.support_share": 0.5},
    "matcher.checks.near_end": {**LARGER, "baseline_m": 0.08, "matcher.search_px": 16},
    "left.auto_exposure_max_s": {"left.auto_exposure_level": 0.5},
    "left.auto_exposure_roi": {"left.auto_exposure_level": 0.5},
    "left.auto_exposure_max_gain": {
        "left.auto_exposure_level": 0.5,
        "left.auto_exposure_max_s": 1e-3,
    },
}
RENDERED = re.compile(
    "rolling|search|extended|near_end"
)  # Keys that act with other rendered layers only.
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


@cache
def stage(velocity_m_s: float = 0.0) -> MitsubaScene:
    motion = Motion(velocity_m_s=(velocity_m_s, 0.0, 0.0))
    return MitsubaScene(dataclasses.replace(scenes.staircase(0.4), motion=motion))


def layers_of(device: Sensor, path: str) -> Any:
    """Render; what acts on rendered layers only, shares those of the base."""
    if path.startswith(("left.", "right.", "matcher.", "post.")) and not RENDERED.search(path):
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


@cache
def before(path: str, edited: tuple[tuple[str, Any], ...]) -> Any:
    """Return the outputs of the base, by the first part of the path."""
    return outputs(sensor(dict(edited)), path)


@pytest.mark.parametrize("path", SENSOR)
def test_every_key_of_a_sensor_matters(path: str) -> None:
    if path.startswith("right.") and path.removeprefix("right.") in EXPOSURE:
        with pytest.warns(UserWarning, match=f"{path} not used: both imagers take the left one's"):
            edits.apply(sensor(), [f"{path}=0.05"])
        return
    start = WITH.get(path, {})
    part = path if RENDERED.search(path) else f"{path.partition('.')[0]}." if "." in path else ""
    value = dict(leaves(structure.to_table(sensor(start))))[path]
    after = said(lambda: outputs(sensor({**start, path: moved(path, value)}), path))
    assert after != repr(before(part, tuple(start.items())))
    assert path.endswith(PAIRED) or path == "kind" or "refused: " not in after, after


@pytest.mark.parametrize("engine", ["SemiGlobalBlock", "Block"])
def test_every_key_of_the_other_engines_matters(engine: str) -> None:
    cls = {"SemiGlobalBlock": matcher.SemiGlobalBlock, "Block": matcher.Block}[engine]
    values = {"mode": "hh", "block_px": 9, "small_penalty": 20, "prefilter_cap": 63}
    values |= {"large_penalty": 2000}
    checks = matcher.Checks()

    def observed(part: Any) -> Any:
        engaged = matcher.Matcher(engine=part, checks=checks, search_px=64)
        return outputs(dataclasses.replace(sensor(), matcher=engaged), "matcher.")

    plain = observed(cls())
    for item in dataclasses.fields(cls):
        assert observed(cls(**{item.name: values[item.name]})) != plain, item.name


# --- device presets ---------------------------------------------------------------------------


def applied(path: Path, table: Mapping[str, Any]) -> Any:
    path.write_text(json.dumps(table))
    changed, report = realsense.with_preset(presets.load("d435"), str(path))
    return changed, report


def _other(name: str) -> Any:
    canonical = controls.ALIASES.get(name, name)
    if canonical in controls.WORDS:
        usual = str(controls.named_preset().get(canonical, ""))
        return next(word for word in controls.WORDS[canonical] if word != usual)
    low, high = controls.RANGES.get(canonical, (0, 1000))
    usual = controls.named_preset().get(canonical)
    values = [low, high, (low + high) // 2]
    return next(value for value in values if value != usual)


@pytest.mark.parametrize("name", sorted({*controls.KNOWN, *controls.ALIASES}))
def test_every_control_of_a_device_preset_matters(name: str, tmp_path: Path) -> None:
    """Each is mapped, or named in the report as without counterpart or effect."""
    path = tmp_path / "preset.json"
    auto = {} if "autoexposure" in name else {"controls-autoexposure-auto": "false"}
    first = said(lambda: applied(path, auto))
    assert said(lambda: applied(path, {**auto, name: _other(name)})) != first


def test_every_section_of_a_device_preset_matters(tmp_path: Path) -> None:
    """Of the device, its name and product line are compared; its other entries are notes."""
    path = tmp_path / "preset.json"
    parameters = {"param-leftrightthreshold": 10}
    device = {"name": "Intel RealSense D435", "product line": "D400"}
    table = {"schema version": 1, "device": device, "parameters": parameters, "viewer": {}}
    assert set(table) == set(controls._SECTIONS)
    first = said(lambda: applied(path, table))
    for change, message in (
        ({"schema version": 2}, "schema version 2 is read as 1"),
        ({"device": {**device, "name": "Intel RealSense D405"}}, "exported from a D405"),
        ({"device": {**device, "product line": "L500"}}, "device.product line must be D400"),
        ({"parameters": {"param-leftrightthreshold": 24}}, ""),
        ({"viewer": {"controls-laserpower": 90}}, "projector.power_w"),
        ({"hdr-preset": {}}, "refused: device preset must hold controls; got an hdr-preset"),
    ):
        after = said(lambda change=change: applied(path, {**table, **change}))
        assert after != first and message in after


# --- plan.toml --------------------------------------------------------------------------------

SMALL = {"width": 64, "height": 48, "fx_px": 40, "fy_px": 40, "cx_px": 31.5, "cy_px": 23.5}
WALL = {"kind": "builtin", "scene": "wall", "number": 1.0, "weight": 1.0}
PLAN: dict[str, Any] = {
    **{"seed": 7, "scenes": 2, "views": 1, "frames": 1, "samples": 0, "layers": ["truth"]},
    **{"missing": "stop", "source": [WALL, {**WALL, "scene": "staircase"}]},
    "sensor": [{"preset": "d435", "weight": 1.0, "set": SMALL, "effects": {}}, {"preset": "d415"}],
    "pose": {"shift_m": [0.0, 0.0, 0.0], "turn_deg": [0.0, 0.0, 0.0]},
}
PLANS: dict[str, Any] = {
    **{"seed": 8, "scenes": 3, "views": 2, "frames": 2, "samples": 4, "layers": ["infrared"]},
    **{"missing": "skip", "pose.shift_m": [0.1, 0, 0], "pose.turn_deg": [0, 1, 0]},
    "source": [{**WALL, "scene": "room", "number": 3}],
    "sensor": [{"preset": "d455"}],
}
SOURCES = {  # Changed values of a source's keys, by kind.
    "builtin": {"scene": "staircase", "number": 2.0, "weight": 1e6, "kind": "files"},
    "files": {"paths": ["b.ply"], "weight": 1e6, "kind": "builtin"},
    "captures": {"folder": "other", "weight": 1e6, "kind": "builtin"},
    "dropped": {"folder": "more", "count": 2, "reflectance": 0.9, "weight": 1e6, "kind": "files"},
}
SENSORS = {
    "preset": "d455",
    "mode": "640x480",
    "weight": 1e6,
    "set": {**SMALL, "width": 96},
    "effects": {"lens_blur": 1.0},
}


def known_keys(place: str, table: Mapping[str, Any]) -> set[str]:
    """Return the keys that the refusal of an unknown key lists."""
    with pytest.raises(InputError, match=f"key in {place} must be a known name") as refused:
        plans.from_table({**PLAN, **table}, Path("."))
    listed = re.search(r"Known: (.*)\.", str(refused.value))
    assert listed is not None
    return set(listed[1].split(", "))


def drawn(table: Mapping[str, Any], folder: Path) -> Any:
    """Return what determines the frames: the plan's numbers, and the drawn views."""
    plan = plans.from_table({**PLAN, **table}, folder)
    views = [plans.view(plan, number) for number in range(12)]
    return repr((views, plan.count, plan.samples, plan.layers, plan.missing))


def test_every_key_of_a_plan_matters(tmp_path: Path) -> None:
    assert {name.partition(".")[0] for name in PLANS} == known_keys("plan", {"zzz": 1})
    poses = {name.partition(".")[2] for name in PLANS if "." in name}
    assert poses == known_keys("pose", {"pose": {"zzz": 1}})
    first = drawn({}, tmp_path)
    for path, value in PLANS.items():
        name, _, inner = path.partition(".")
        changed = {name: {**PLAN[name], inner: value} if inner else value}
        assert drawn(changed, tmp_path) != first, path


def test_every_key_of_a_plan_s_sensor_matters(tmp_path: Path) -> None:
    assert set(SENSORS) == known_keys("sensor 1", {"sensor": [{"preset": "d435", "zzz": 1}]})
    first = drawn({}, tmp_path)
    for name, value in SENSORS.items():
        changed = [{**PLAN["sensor"][0], name: value}, PLAN["sensor"][1]]
        assert drawn({"sensor": changed}, tmp_path) != first, name


@pytest.mark.parametrize("kind", SOURCES)
def test_every_key_of_a_plan_s_source_matters(kind: str, tmp_path: Path) -> None:
    for place in ("a.ply", "b.ply", "meshes/a.ply", "more/b.ply"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / place)
    for place in ("captures", "other"):
        write_captures(tmp_path / place, CAPTURE)
    tables = {
        "builtin": WALL,
        "files": {"kind": "files", "paths": ["a.ply"]},
        "captures": {"kind": "captures", "folder": "captures"},
        "dropped": {"kind": "dropped", "folder": "meshes", "count": 1, "reflectance": 0.5},
    }
    unknown = {"source": [{"kind": kind, "zzz": 1}]}
    assert set(SOURCES[kind]) == known_keys("source 1", unknown)
    table = {"weight": 1.0, **tables[kind]}
    first = said(lambda: drawn({"source": [table, {**WALL, "number": 9.0}]}, tmp_path))
    assert "refused: " not in first
    for name, value in SOURCES[kind].items():
        changed = {"source": [{**table, name: value}, {**WALL, "number": 9.0}]}
        assert said(lambda changed=changed: drawn(changed, tmp_path)) != first, name
