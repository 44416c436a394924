"""Sensors: presets, files, edits, and refusals."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest

from starling.patterns.errors import InputError
from starling.sim.captures import info as capture_info
from starling.sim.captures.writer import info_of
from starling.sim.sensor import edits as sensor_edits
from starling.sim.sensor import presets, resolve
from starling.sim.sensor.matcher import Block, CensusSemiGlobal, named
from starling.sim.sensor.projector import Emitter
from starling.sim.sensor.sensor import Imager, Lens, Post, Projector, Sensor

GEOMETRY = {
    "name": "mine",
    "width": 640,
    "height": 480,
    "fx_px": 500.0,
    "fy_px": 500.0,
    "cx_px": 319.5,
    "cy_px": 239.5,
    "baseline_m": 0.05,
}


def _sensor() -> Sensor:
    return Sensor(**GEOMETRY)


@pytest.mark.parametrize("name", presets.names())
def test_presets_survive_the_round_trip(name: str, tmp_path: Path) -> None:
    preset = presets.load(name)
    path = tmp_path / "copy.toml"
    path.write_text(presets.dumps(preset))
    assert presets.load(str(path)) == preset
    assert preset.name == name


@pytest.mark.parametrize("name", presets.names())
def test_every_number_of_a_preset_has_its_source(name: str) -> None:
    """A number without a comment shares that of the line above (width and height)."""
    lines = presets.text(name).splitlines()
    numbers = [at for at, line in enumerate(lines) if re.match(r"[\w.]+ = [\d.\[-]", line)]
    assert len(numbers) > 20 or presets.load_file(name).base
    assert [lines[at] for at in numbers if "#" not in lines[at] + lines[at - 1]] == []


def test_defaults_are_neutral_and_survive(tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_text(presets.dumps(_sensor()))
    assert presets.load(str(tmp_path / "x.toml")) == _sensor()


def test_unknown_preset_lists_the_known_nearest_first() -> None:
    with pytest.raises(InputError, match=r"sensor must be a known name; got 'd434'. Known: d435,"):
        presets.load("d434")
    with pytest.raises(InputError, match=r"sensor must be a known name; got 'd4'"):
        presets.text("d4")


def test_right_imager_equals_the_left_by_default() -> None:
    table = {**GEOMETRY, "left": {"gain": 2.0}}
    assert presets.from_table(table).right == Imager(gain=2.0)
    assert presets.from_table({**table, "right": {}}).right == Imager()


@pytest.mark.parametrize(
    "changes", [{"refinement": {"locking_px": -0.04}}, {"refinement.locking_px": -0.04}]
)
def test_a_table_edits_the_stock_setting(changes: dict) -> None:
    """Other fields keep the setting's values; a table with a kind replaces the part."""
    stock, edited = (
        presets.from_table({**GEOMETRY, "matcher": {"setting": "d4xx", **more}}).matcher
        for more in ({}, changes)
    )
    assert stock.refinement.smooth_px > 0
    refinement = dataclasses.replace(stock.refinement, locking_px=-0.04)
    assert edited == dataclasses.replace(stock, refinement=refinement)
    engine = {"engine": {"kind": "Block"}}
    matcher = presets.from_table({**GEOMETRY, "matcher": {"setting": "d4xx", **engine}}).matcher
    assert matcher == dataclasses.replace(stock, engine=Block())


@pytest.mark.parametrize("penalties", [(60.0, 100.0), (6.0, 8.0)])
def test_only_the_complete_edited_setting_must_be_valid(
    penalties: tuple[float, float],
) -> None:
    """In both orders: one penalty alone may be inconsistent with the stock setting."""
    changes = dict(zip(("small_penalty", "large_penalty"), penalties, strict=True))
    for engine in (changes, dict(reversed(changes.items()))):
        edited = presets.from_table({**GEOMETRY, "matcher": {"setting": "d4xx", "engine": engine}})
        edited_engine = edited.matcher.engine
        assert isinstance(edited_engine, CensusSemiGlobal)
        assert (edited_engine.small_penalty, edited_engine.large_penalty) == penalties


@pytest.mark.parametrize("changes", [{"refinement": 3}, {"search_px": {"most": 3}}])
def test_a_part_that_is_edited_stays_a_part(changes: dict) -> None:
    with pytest.raises(InputError, match=r"matcher\.(refinement|search_px) must be"):
        presets.from_table({**GEOMETRY, "matcher": {"setting": "d4xx", **changes}})


def test_presets_of_the_d4_family_have_its_matcher() -> None:
    """Except for what was measured on D415 pairs."""
    stock = named("d4xx")
    assert presets.load("d435").matcher == presets.load("d455").matcher == stock
    of_pairs = sensor_edits.with_values(
        presets.load("d435"),
        [
            ("matcher.refinement.median_px", 0),
            ("matcher.refinement.smooth_px", 15),
            ("matcher.refinement.smooth_rows_px", 8),
            ("matcher.refinement.mean_quantum_px", 1 / 64),
            ("matcher.refinement.smooth_step_px", 4.0),
            ("matcher.engine.second_peak", 10.0),
            ("matcher.engine.subpixel_fit", "equal_slopes"),
            ("matcher.engine.large_penalty", 56.0),
            ("matcher.checks.support_share", 0.54),
            ("matcher.checks.left_right_rows_px", 3),
            ("matcher.checks.jump_px", 1024.0),
            ("matcher.checks.speckle_count", 0),
            ("matcher.checks.border_px", 7.0),
        ],
    )
    assert presets.load("d415").matcher == of_pairs.matcher


def test_a_setting_may_be_edited_in_the_file() -> None:
    stock = presets.from_table({**GEOMETRY, "matcher": {"setting": "fast"}}).matcher
    table = {"setting": "fast", "search_px": 64}
    edited = presets.from_table({**GEOMETRY, "matcher": table}).matcher
    assert edited == dataclasses.replace(stock, search_px=64)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"name = ", r"sensor must be TOML; got .*x.toml"),
        (b"\xff", r"sensor must be TOML; got"),
        (b"deep = " + b"[" * 5000 + b"]" * 5000, r"sensor must be TOML; got"),
        (b"", "name must be given; got nothing"),
        (b"widht = 3", r"key must be a known name; got 'widht'. Known: width,"),
        (b"left = 3", "left must be a table; got 3"),
        (b"matcher = 3", "matcher must be a table; got 3"),
        (b"matcher = {setting = 'fats'}", r"matcher must be a known name; got 'fats'. Known: fast"),
        (b"matcher = {setting = 3}", "matcher must be a known name; got 3"),
        (b"matcher = {setting = [3]}", r"matcher must be a known name; got \[3\]"),
    ],
)
def test_wrong_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "x.toml").write_bytes(content)
    with pytest.raises(InputError, match=message):
        presets.load(str(tmp_path / "x.toml"))


def test_missing_file_is_refused() -> None:
    with pytest.raises(InputError, match=r"sensor must be a readable file; got nowhere.toml"):
        presets.load("nowhere.toml")


@pytest.mark.parametrize(
    ("cls", "values", "message"),
    [
        (Imager, {"gain": 0.0}, r"imager.gain must be > 0; got 0.0"),
        (Imager, {"full_well_e": float("nan")}, r"imager.full_well_e must be > 0; got nan"),
        (Lens, {"transmission": 1.1}, r"lens.transmission must be in"),
        (Imager, {"bit_depth": 9}, r"imager.bit_depth must be 8, 10, 12 or 16; got 9"),
        (Imager, {"black_level_dn": 200.0, "bit_depth": 8}, r"imager.black_level_dn must be in"),
        (Projector, {"power_w": -1.0}, r"projector.power_w must be in"),
        (Projector, {"position_m": (0.0, 999.0, 0.0)}, r"projector.position_m.y must be in"),
        (Projector, {"pattern": ""}, r"projector.pattern must name a pattern; got ''"),
        (Projector, {"pattern_scale": 0.0}, r"projector.pattern_scale must be in \[0.9, 1.1\]"),
        (Projector, {"emitters": (Emitter(),) * 17}, r"number of projector.emitters .*; got 17"),
        (Emitter, {"power_share": 0.0}, r"projector.emitters.power_share must be > 0; got 0.0"),
        (Emitter, {"offset_m": (0.0, 26.0, 0.0)}, r"emitters.offset_m.y must be in .*; got 26"),
        (Emitter, {"rotation_deg": (0, 0, 361)}, r"emitters.rotation_deg.z must be in"),
        (Post, {"depth_unit_m": 0.0}, r"post.depth_unit_m must be > 0"),
        (Post, {"near_m": 3.0, "far_m": 2.0}, r"post.far_m must be > post.near_m; got 2.0"),
        (Sensor, {**GEOMETRY, "baseline_m": -0.05}, r"baseline_m must be > 0; got -0.05. The left"),
        (Sensor, {**GEOMETRY, "width": 0}, r"width must be in \[32, 8192\]; got 0"),
        (Sensor, {**GEOMETRY, "kind": "lidar"}, r"kind must be a known name; got 'lidar'"),
    ],
)
def test_wrong_values_are_refused(cls: type, values: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        cls(**values)


def test_derived_values() -> None:
    imager = Imager(bit_depth=8, full_well_e=510.0, gain=2.0)
    assert (imager.ceiling_dn, imager.dn_per_electron) == (255, 1.0)
    assert _sensor().focal_baseline_px_m == pytest.approx(25.0)


def test_edits_are_applied_in_order() -> None:
    edited = sensor_edits.apply(
        _sensor(),
        [
            "projector.power_w=0.2",
            "imager.gain = 2",
            "right.gain=3.0",
            "projector.pattern=d415",
            "projector.position_m=[0.03, 0, 0]",
            'name="x y"',
        ],
    )
    assert edited.projector == Projector(power_w=0.2, pattern="d415", position_m=(0.03, 0.0, 0.0))
    assert (edited.left.gain, edited.right.gain, edited.name) == (2.0, 3.0, "x y")
    assert _sensor().projector.power_w == Projector().power_w


def test_only_the_result_of_edits_must_be_valid() -> None:
    """A near limit above the old far limit is valid if the far limit changes too."""
    edited = sensor_edits.apply(_sensor(), ["post.near_m=90.0", "post.far_m=100"])
    assert (edited.post.near_m, edited.post.far_m) == (90.0, 100.0)


def test_matcher_setting_is_edited_by_its_name() -> None:
    fast = sensor_edits.apply(_sensor(), ["matcher.setting=fast"])
    assert fast.matcher == presets.from_table({**GEOMETRY, "matcher": {"setting": "fast"}}).matcher
    with pytest.raises(InputError, match=r"matcher.setting must be a known name"):
        sensor_edits.apply(_sensor(), ["matcher.setting=[1]"])


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ("projector.power_w", "--set must be PATH=VALUE; got 'projector.power_w'"),
        ("=3", "--set must be PATH=VALUE"),
        ("name=", "--set must be PATH=VALUE"),
        ("name=[3", r"--set name must be a TOML value; got '\[3'. Quote text."),
        ("name=1\nwidth=7", "--set name must be a TOML value"),
        ("name=" + "[" * 5000, "--set name must be a TOML value"),
        ("projector.power=3", r"key in projector must be a known name; .*Known: power_w"),
        ("projector.power_w.x=3", r"projector.power_w has no fields; got .x"),
        ("projector.power_w=loud", r"projector.power_w must be of type float; got 'loud'"),
        ("projector.power_w=true", r"projector.power_w must be of type float; got True"),
        ("projector.position_m=[1,2]", r"projector.position_m must be a list of 3; got \[1, 2\]"),
        ("imager.gian=3", "key in imager must be a known name; got 'gian'. Known: gain"),
        ("imager.gain=loud", "^imager.gain must be of type float; got 'loud'"),
        ("imager.=3", "--set must be PATH=VALUE; got 'imager.=3'"),
        ("left..gain=3", "--set must be PATH=VALUE; got 'left..gain=3'"),
        ("left={}", "left must be set field by field; got {}. Its fields: left.lens, "),
        ("imager={}", "imager must be set field by field; got {}. Its fields: imager.lens"),
        ("imager=3", "imager must be set field by field; got 3"),
        ("matcher.engine={kind='Block'}", "matcher.engine must be set field by field"),
        ("matcher.setting=3", "^matcher.setting must be a known name; got 3. Known: "),
        ("width=1" + "0" * 400, "width must fit in 64 bits; got a whole number of 1330 bits"),
    ],
)
def test_wrong_edits_are_refused(edit: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as refusal:
        sensor_edits.apply(_sensor(), [edit])
    assert len(str(refusal.value)) < 6000 and "\n" not in str(refusal.value)


def test_another_kind_starts_from_its_defaults() -> None:
    edits = ["matcher.engine.kind=Block", "matcher.engine.block_px=21"]
    assert sensor_edits.apply(_sensor(), edits).matcher.engine == Block(block_px=21)
    same = ["matcher.engine.kind=CensusSemiGlobal"]
    assert sensor_edits.apply(presets.load("d435"), same) == presets.load("d435")


def test_pattern_paths_work_from_other_directories(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, resolved in {"dots.png": str(tmp_path / "dots.png"), "d415": "d415"}.items():
        sensor = resolve.load("d435", captures="wall", edits=[f"projector.pattern={name}"])
        assert sensor.projector.pattern == resolved


def test_a_file_of_the_captures_camera_keeps_its_geometry(tmp_path: Path) -> None:
    """Presets and files of other cameras take the geometry of the captures."""
    preset = presets.load("d415")
    info = info_of(preset, source="test", licence="none", notes="")
    (tmp_path / "capture.toml").write_text(capture_info.dumps(info))
    (tmp_path / "room" / "0").mkdir(parents=True)
    moved = {"calibrated": ("baseline_m", 0.0552), "other": ("cx_px", preset.cx_px + 20)}
    for name, (field, value) in moved.items():
        one = dataclasses.replace(preset, **{field: value})
        (tmp_path / f"{name}.toml").write_text(presets.dumps(one))
        loaded = resolve.load(str(tmp_path / f"{name}.toml"), captures=str(tmp_path))
        expected = value if name == "calibrated" else getattr(preset, field)
        assert getattr(loaded, field) == expected
    small = dataclasses.replace(preset, width=640, height=360)
    assert not info.are_of(small)
    longer = dataclasses.replace(info, fx_px=info.fx_px * 1.03)
    (tmp_path / "capture.toml").write_text(capture_info.dumps(longer))
    assert resolve.load("d415", captures=str(tmp_path)).fx_px == longer.fx_px


def test_a_pattern_without_effect_is_refused() -> None:
    sensor = presets.load("d415")
    with pytest.raises(InputError, match=r"projector.pattern must not be set .*; got 'd435'\. Set"):
        sensor_edits.apply(sensor, ["projector.pattern=d435"])
    edits = ["projector.pattern=d435", "projector.emitters=[]"]
    assert sensor_edits.apply(sensor, edits).projector.pattern == "d435"
    shown = sensor_edits.apply(sensor, ['projector.emitters=[{pattern="d435"}, {}]'])
    assert sensor_edits.apply(shown, ["projector.pattern=d415"]).projector.pattern == "d415"


def test_emitters_survive_the_round_trip(tmp_path: Path) -> None:
    emitters = (Emitter(offset_m=(-1e-3, 0, 0), power_share=2.0), Emitter(pattern="d415"))
    light = Projector(emitters=emitters, pattern_scale=1.002)
    sensor = dataclasses.replace(_sensor(), projector=light)
    (tmp_path / "x.toml").write_text(presets.dumps(sensor))
    assert presets.load(str(tmp_path / "x.toml")) == sensor
    text = '[{offset_m = [-0.001, 0, 0], power_share = 2}, {pattern = "d415"}]'
    edits = [f"projector.emitters={text}", "projector.pattern_scale=1.002"]
    assert sensor_edits.apply(_sensor(), edits) == sensor
    moved = sensor_edits.apply(sensor, ["projector.emitters.0.offset_m.x=0.002"])
    assert [one.offset_m[0] for one in moved.projector.emitters] == [2e-3, 0.0]
    with pytest.raises(InputError, match=r"number in projector\.emitters must be .*; got .2."):
        sensor_edits.apply(sensor, ["projector.emitters.2.pattern=x.png"])


def test_a_sensor_files_pattern_paths_start_at_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Paths in a file start at its folder; paths in an edit at the working directory."""
    emitters = (Emitter(pattern="a/0.png"), Emitter(pattern="d415"), Emitter())
    light = Projector(pattern="all.png", emitters=emitters)
    text = presets.dumps(dataclasses.replace(_sensor(), projector=light))
    for folder in ("here", "moved"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mine.toml").write_text(text)
        monkeypatch.chdir(tmp_path)
        for name in (f"{folder}/mine.toml", str(tmp_path / folder / "mine.toml")):
            part = presets.load(name).projector
            assert part.pattern == str(tmp_path / folder / "all.png")
            patterns = [emitter.pattern for emitter in part.emitters]
            assert patterns == [str(tmp_path / folder / "a" / "0.png"), "d415", ""]
        edited = resolve.load(name, edits=["projector.pattern=b/typed.png"]).projector
        assert edited.pattern == str(tmp_path / "b" / "typed.png")
        assert edited.emitters == part.emitters


def test_a_sensor_cannot_be_changed_in_place() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        _sensor().width = 3  # type: ignore[misc]
