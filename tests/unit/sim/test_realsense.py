"""Device controls: parsing, mapping onto a sensor, and the report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.patterns.errors import InputError
from starling.sim.sensor import edits, realsense
from starling.sim.sensor import presets as sensors
from starling.sim.sensor.matcher import CensusSemiGlobal
from starling.sim.sensor.realsense import controls
from starling.sim.sensor.sensor import Sensor

D415 = sensors.load("d415")
DEFAULT = controls.named_preset("default")
CAMERA = {  # Further controls that the viewer exports, with a D415's defaults.
    "controls-autoexposure-auto": "True",
    "controls-autoexposure-manual": "32000",
    "controls-depth-gain": "16",
    "controls-laserpower": "150",
    "controls-laserstate": "on",
    "param-autoexposure-setpoint": "400",
    "param-depthunits": "1000",
    "param-zunits": "1000",
    "param-depthclampmin": "0",
    "param-depthclampmax": "65536",
    "param-disparityshift": "0",
}


def _write(path: Path, table: Any) -> str:
    path.write_text(json.dumps(table))
    return str(path)


def _engine(sensor: Sensor) -> CensusSemiGlobal:
    assert isinstance(sensor.matcher.engine, CensusSemiGlobal)
    return sensor.matcher.engine


def _with(**settings: Any) -> tuple[Sensor, realsense.Report]:
    """A D415 with some controls set; `__` replaces the hyphen."""
    named = {name.replace("__", "-"): value for name, value in settings.items()}
    return realsense.apply(D415, controls.canonical(named.items()))


@pytest.mark.parametrize("name", ["d415", "d435", "d455"])
def test_the_default_preset_is_the_sensor_itself(name):
    """Bit for bit. The mapping is relative to the default, so its scale is not tested."""
    sensor = sensors.load(name)
    moved, report = realsense.with_preset(sensor, "default")
    assert moved == sensor
    assert all(item.after == item.before for item in report.mapped)
    assert not any(item.departs for item in report.unmapped)


def test_high_accuracy_by_hand():
    moved, report = realsense.with_preset(D415, "high_accuracy")
    engine = _engine(moved)
    assert moved.matcher.checks.left_right_px == 10 / 32
    assert engine.difference_weight == pytest.approx(0.125 * (6 / 751) / (26 / 800))
    assert engine.small_penalty == pytest.approx(12 * 155 / 60)
    assert engine.large_penalty == pytest.approx(12 * 155 / 60 + 44 * 190 / 342)
    assert engine.second_peak == pytest.approx(10 + (647 - 325) * 56 / (60 + 342))
    assert moved.matcher.checks.support_share == pytest.approx(
        0.54 + 0.46 * (136 - 63) / (168 - 63), abs=1e-6
    )
    assert moved.matcher.checks.support_step_px == 1.65625
    assert engine.neighbour_peak == pytest.approx((108 - 7) * 56 / (60 + 342))
    assert engine.census_px == 9
    assert moved.matcher.checks.texture_dn == D415.matcher.checks.texture_dn  # Its count is 0.
    assert (moved.projector, moved.left, moved.post) == (D415.projector, D415.left, D415.post)
    message = "\n".join(report.lines())
    assert "param-leftrightthreshold: matcher.checks.left_right_px 0.75 -> 0.3125" in message
    assert "no counterpart: param-medianthreshold" in message
    assert "texturedifferencethresh (the texture count is 0" in message


def test_the_region_support_map_needs_a_sensor_with_that_check():
    moved, _ = _with(**{"param__usersm": "0"})
    assert moved.matcher.checks.support_share == 0 < D415.matcher.checks.support_share
    plain = sensors.load("d435")
    strict, report = realsense.with_preset(plain, "high_accuracy")
    assert strict.matcher.checks.support_share == plain.matcher.checks.support_share == 0
    assert any("param-rsmremovethreshold" in line and "no such" in line for line in report.lines())


def test_a_non_default_factor_is_reported():
    _, report = _with(**{"param__amplitude__factor": "0.08"})
    assert any("no counterpart: param-amplitude-factor" in line for line in report.lines())
    _, report = _with(**{"param__amplitude__factor": "0"})
    assert not any("amplitude" in line for line in report.lines())


def test_presets_are_ordered_by_their_names():
    matchers = {
        name: realsense.with_preset(D415, name)[0].matcher for name in controls.preset_names()
    }
    for field in ("second_peak", "neighbour_peak"):
        rank = [
            getattr(matchers[name].engine, field)
            for name in ("high_density", "medium_density", "high_accuracy")
        ]
        assert rank == sorted(rank)
    assert matchers["hand"].engine == _engine(realsense.with_preset(D415, "hand")[0])
    assert _engine(realsense.with_preset(D415, "hand")[0]).census_px == 5  # 9 x 3 pixels.


def test_both_forms_of_the_file_are_equivalent(tmp_path):
    text = {name: f"{value:g}" for name, value in DEFAULT.items()} | CAMERA  # type: ignore[str-format]
    flat = _write(tmp_path / "flat.json", text | {"stream-width": "1280"})
    nested = _write(
        tmp_path / "nested.json",
        {
            "schema version": 1,
            "device": {"fw version": "05.15.01.00", "name": "any", "product line": "D400"},
            "parameters": text,
            "viewer": {"stream-width": 1280, "stream-depth-format": "Z16"},
        },
    )
    flat_controls, nested_controls = controls.read_file(flat), controls.read_file(nested)
    assert nested_controls == flat_controls | {"stream-depth-format": "Z16"}
    moved, report = realsense.with_preset(D415, nested)
    level = edits.with_values(D415, [("imager.auto_exposure_level", 400 / 4096)])
    assert moved == level  # 0.098 in the preset.
    assert report.missing == ()
    reasons = {item.control: item.reason for item in report.unmapped}
    assert reasons["controls-autoexposure-manual"] == "auto exposure is on"
    assert "stream" in reasons["stream-width"]


def test_missing_controls_stay_and_are_named(tmp_path):
    only = _write(tmp_path / "one.json", {"param-leftrightthreshold": 16})
    moved, report = realsense.with_preset(D415, only)
    assert moved == edits.with_values(D415, [("matcher.checks.left_right_px", 0.5)])
    assert "param-secondpeakdelta" in report.missing
    assert "param-leftrightthreshold" not in report.missing
    assert report.lines()[-1].startswith("not given, left as the sensor has it: param-secondpeak")


def test_every_control_is_mapped_or_named():
    for name in controls.KNOWN:
        words = controls.WORDS.get(name)
        value = words[0] if words else {**DEFAULT, **CAMERA}.get(name, 1)
        _, report = realsense.apply(D415, controls.canonical([(name, value)]))
        mapped = {control for item in report.mapped for control in item.controls}
        assert name in mapped | {item.control for item in report.unmapped}, name


@given(
    st.fixed_dictionaries(
        {name: st.floats(*bounds) for name, bounds in controls.RANGES.items()},
        optional={name: st.sampled_from(words) for name, words in controls.WORDS.items()},
    )
)
def test_any_values_in_range_give_a_sensor_or_one_line(values):
    try:
        moved, _ = realsense.apply(D415, controls.canonical(values.items()))
    except InputError as refusal:
        assert "\n" not in str(refusal)
    else:
        assert moved.matcher.search_px == D415.matcher.search_px


def test_depth_table_has_units():
    moved, _ = _with(param__disparityshift=32, param__depthunits=100, param__depthclampmin=5000)
    assert moved.matcher.min_disparity_px == 32
    assert moved.post.depth_unit_m == pytest.approx(1e-4)
    assert moved.post.near_m == pytest.approx(0.5)
    reach = D415.focal_baseline_px_m / D415.post.near_m
    nearer, _ = _with(param__disparityshift=32)
    assert nearer.post.near_m == pytest.approx(D415.focal_baseline_px_m / (reach + 32))
    assert _with(param__depthclampmax=4000)[0].post.far_m == pytest.approx(4.0)
    unlimited = edits.with_values(D415, [("post.near_m", 0.0)])
    shifted, _ = realsense.apply(unlimited, {"param-disparityshift": 32.0})
    assert shifted.post.near_m == 0.0


def test_exposure_is_by_hand_or_automatic():
    by_hand = {"controls-autoexposure-manual": 8500, "controls-depth-gain": 64}
    moved, report = realsense.apply(
        D415, controls.canonical({"controls-autoexposure-auto": "False", **by_hand}.items())
    )
    for imager in (moved.left, moved.right):
        assert imager.auto_exposure_level == 0
        assert imager.exposure_s == pytest.approx(8.5e-3)
        assert imager.gain == 4.0
    device, report = realsense.apply(D415, controls.canonical(by_hand.items()))
    assert device == D415
    assert {item.control for item in report.unmapped} == set(by_hand)
    manual = edits.with_values(D415, [("imager.auto_exposure_level", 0.0)])
    with pytest.raises(InputError, match=r"autoexposure-setpoint must be given to switch auto"):
        realsense.apply(manual, {"controls-autoexposure-auto": "true"})
    level, _ = realsense.apply(
        manual, {"controls-autoexposure-auto": "true", "param-autoexposure-setpoint": 1024.0}
    )
    assert level.left.auto_exposure_level == 0.25


def test_laser_power_and_switch():
    assert _with(controls__laserpower="360")[0].projector.power_w == pytest.approx(0.36)
    assert _with(controls__laserpower=360, controls__laserstate="off")[0].projector.power_w == 0
    dark = realsense.with_emitter(D415, "off")
    assert dark.projector.power_w == 0
    assert realsense.with_emitter(D415, "on") == D415
    assert realsense.with_emitter(dark, "on").projector.power_w == 0.15
    lit, _ = realsense.apply(dark, {"controls-laserstate": "on"})
    assert lit.projector.power_w == 0.15
    with pytest.raises(InputError, match="emitter must be a known name; got 'dim'"):
        realsense.with_emitter(D415, "dim")  # type: ignore[arg-type]


def test_texture_counts_only_with_a_count():
    idle, _ = _with(param__texturedifferencethresh=2000)
    assert idle == D415
    busy, _ = _with(param__texturedifferencethresh=160.0, param__texturecountthresh=24.5)
    assert busy.matcher.checks.texture_dn == pytest.approx(160 * 255 / 4096 / 2)
    floor, _ = _with(param__texturedifferencethresh=0, param__texturecountthresh=5)
    assert floor.matcher.checks.texture_dn == D415.matcher.checks.texture_dn


def test_costs_follow_the_lambdas():
    assert _engine(_with(ignoreSAD=1)[0]).difference_weight == 0
    more = _engine(_with(param__lambdaad=400)[0]).difference_weight
    assert more == 2 * _engine(D415).difference_weight
    steep = _engine(_with(param__scanlinep1=1000)[0])
    assert (steep.small_penalty, steep.large_penalty) == (100, 100)
    sides = {(9, 9): 9, (9, 3): 5, (6, 7): 7, (3, 3): 3, (11, 11): 11}
    for (u, v), side in sides.items():
        assert _engine(_with(param__censususize=u, param__censusvsize=v)[0]).census_px == side


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("param-secondpeekdelta", 1, "control must be a known name; got 'param-secondpeekdelta'. "
         "Known: param-secondpeakdelta,"),
        ("param-lambdaad", "many", "param-lambdaad must be a number; got 'many'."),
        ("param-lambdaad", None, "param-lambdaad must be a number; got None."),
        ("param-lambdaad", True, "param-lambdaad must be a number; got True."),
        ("param-lambdaad", [1], "param-lambdaad must be a number; got [1]."),
        ("param-lambdaad", "nan", "param-lambdaad must be a number; got 'nan'."),
        ("param-lambdaad", 0, "param-lambdaad must be in [1, 4095]; got 0."),
        ("controls-laserpower", "150000", "controls-laserpower must be in [0, 360]; got 150000.0."),
        ("param-medianthreshold", 1e9, "param-medianthreshold must be in [-1e+06, 1e+06]"),
        ("controls-laserstate", "dim", "controls-laserstate must be one of off, on, auto"),
        ("controls-autoexposure-auto", 1, "must be one of false, true; got 1."),
    ],
)  # fmt: skip
def test_invalid_controls_are_refused(tmp_path, name, value, message):
    path = _write(tmp_path / "bad.json", {name: value})
    with pytest.raises(InputError) as refusal:
        realsense.with_preset(D415, path)
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_impossible_values_are_refused_in_one_line():
    with pytest.raises(InputError, match=r"device controls: difference_weight must be in \[0, 8\]"):
        _with(param__lambdaad=1)


def test_aliases_of_a_control_must_agree():
    with pytest.raises(InputError, match="param-depthunits and param-zunits must agree"):
        _with(param__depthunits=1000, param__zunits=100)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "device preset must be a JSON file"),
        ("[1]", "device preset must hold a table; got list in "),
        ('{"parameters": 3}', "parameters must be a table; got 3."),
        ('{"parameters": {}, "viewr": {}}', "section must be a known name; got 'viewr'. Known: vi"),
        ('{"parameters": {}, "device": {"product line": "L500"}}', "must be D400; got 'L500'."),
    ],
)
def test_files_that_are_not_an_export_are_refused(tmp_path, text, message):
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(InputError) as refusal:
        realsense.with_preset(D415, str(path))
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_unknown_presets_files_and_sensors_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"device preset must be a known name; got 'high_accurac'"):
        realsense.with_preset(D415, "high_accurac")
    with pytest.raises(InputError, match="device preset must be a readable file"):
        realsense.with_preset(D415, str(tmp_path / "none.json"))
    with pytest.raises(InputError, match="sensor must be a stereo pair to take RealSense controls"):
        realsense.with_preset(sensors.load("kinect-v1"), "default")
    fast = edits.apply(D415, ["matcher.setting=fast"])
    with pytest.raises(InputError, match=r"must be CensusSemiGlobal .*; got SemiGlobalBlock"):
        realsense.with_preset(fast, "default")


def test_very_long_numbers_are_refused(tmp_path: Path) -> None:
    (tmp_path / "p.json").write_text('{"controls-laserpower": 1' + "0" * 400 + "}")
    with pytest.raises(InputError, match=r"controls-laserpower must be in \[0, 360\]; got 1000"):
        controls.read_file(tmp_path / "p.json")
