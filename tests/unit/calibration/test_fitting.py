"""The complete fit and `starling calibrate`: refused inputs and written files."""

from __future__ import annotations

import dataclasses
import io
import json
import shutil
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling import command_line
from starling.calibration import fit_sensor as fitting
from starling.calibration import observation
from starling.calibration.calibrate_captures import calibrate_captures
from starling.calibration.observation import Observation
from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.render import direct as render
from starling.sim.render import emission as projector
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes as builtin
from starling.sim.scene.scene import Ambient, Scene
from starling.sim.sensor import presets, resolve
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import infrared
from tests.unit.calibration import small_camera

pytestmark = pytest.mark.slow

ROOMS = ("attic", "bath", "cellar", "den")


def _write_scene(folder: Path, room: str, number: int, truth: Sensor) -> None:
    """Write a simulated scene with reference depth, in a separate room."""
    scene = (builtin.tabletop(1), builtin.clutter(2), builtin.staircase(0.6), builtin.tabletop(7))
    body = dataclasses.replace(scene[number], interreflection=0.0)
    place = folder / f"scene-{room}"
    _write(place, body, truth, seed=number)
    (place / "room").write_text(room + "\n")


def _write(place: Path, scene: Scene, truth: Sensor, *, seed: int = 0) -> None:
    layers = render.layers(MitsubaScene(scene), truth)
    pair = infrared(layers, scene, truth, seed=seed)
    small_camera.write_scene(place, layers.truth.depth_m, (pair.left, pair.right), truth)


@pytest.fixture(scope="module")
def small() -> Sensor:
    return small_camera.small("d435", 424, 240)


@pytest.fixture(scope="module")
def captures(small: Sensor, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write captures of four rooms by a D435 whose projector is 1 mm off its nominal position."""
    folder = tmp_path_factory.mktemp("captures") / "set"
    small_camera.write_info(folder, small)
    x = small.projector.position_m[0] + 1e-3
    truth = with_values(small, [("projector.position_m.x", x)])
    for number, room in enumerate(ROOMS):
        _write_scene(folder, room, number, truth)
    return folder


def _refused(
    captures: Path,
    sensor: Sensor,
    folder: Path,
    *,
    free: Sequence[str] = ("pattern",),
    heldout: Sequence[str] | None = None,
) -> str:
    scenes = capture.open_set(captures).scenes
    with pytest.raises(InputError) as caught:
        fitting.fit(scenes, sensor, folder=folder, free=free, heldout=heldout)
    return str(caught.value)


def test_an_unknown_room_is_refused(captures: Path, small: Sensor, tmp_path: Path) -> None:
    message = _refused(captures, small, tmp_path, heldout=["garage"])
    assert message.startswith("heldout must be a known name; got 'garage'.") and "attic" in message


def test_holding_out_all_rooms_is_refused(captures: Path, small: Sensor, tmp_path: Path) -> None:
    message = _refused(captures, small, tmp_path, heldout=list(ROOMS))
    assert message.startswith("heldout must leave a room to fit; got attic, bath, cellar, den.")


def test_unknown_groups_and_none_are_refused(captures: Path, small: Sensor, tmp_path: Path) -> None:
    message = _refused(captures, small, tmp_path, free=["lens"])
    assert message.startswith("free must be a known name; got 'lens'.") and "pattern" in message
    message = _refused(captures, small, tmp_path, free=[])
    assert message.startswith("free must name a group; got none.")


@pytest.mark.long
def test_few_of_many_scenes_are_fitted(captures: Path, small: Sensor, tmp_path: Path) -> None:
    scenes = capture.open_set(str(captures)).scenes
    fit = fitting.fit(scenes, small, free=["projector"], folder=tmp_path, most_scenes=2)
    assert len(fit.fitted_rooms) == 2
    assert fit.warnings[-1].startswith("2 of 3 scenes were fitted")
    with pytest.raises(InputError, match="most_scenes must be an integer in"):
        fitting.fit(scenes, small, free=["projector"], folder=tmp_path, most_scenes=0)


@given(count=st.integers(0, 200), most=st.integers(1, 50))
def test_scenes_are_spread_over_the_set(count: int, most: int) -> None:
    scenes: Any = list(range(count))
    selected: Any = fitting._spread(scenes, most)
    assert len(selected) == min(count, most)
    assert sorted(set(selected)) == selected
    gaps = np.diff([*selected, count])
    assert not count or (selected[0] == 0 and gaps.max() - gaps.min() <= 1)


def test_a_warp_of_one_room_is_refused(captures: Path, small: Sensor, tmp_path: Path) -> None:
    message = _refused(captures, small, tmp_path, free=["warp"], heldout=ROOMS[1:])
    assert message.startswith("captures must hold infrared pairs of 2 rooms for the warp; got 1.")


def test_structured_light_is_refused_for_pairs(captures: Path, tmp_path: Path) -> None:
    sensor = resolve.load("kinect-v1", captures=str(captures))
    message = _refused(captures, sensor, tmp_path, free=["noise"])
    assert message.startswith("sensor must be a stereo camera's; got structured_light.")


def test_haze_is_not_biased_by_the_initial_ambient_map(tmp_path: Path) -> None:
    """A haze of 0.3 is recovered from an initial haze of 0, because the light map is dropped.

    The map is estimated with the initial haze and would bias the fit towards it. Reflectance is
    also estimated with the initial haze, so the tolerances are 0.1 and 20 %.
    """
    start = small_camera.small("d435", 424, 240)
    truth = with_values(start, [("projector.haze", 0.3)])
    small_camera.write_info(tmp_path / "set", truth)
    light = Ambient(irradiance_w_m2=1.0, gradient=0.0)
    table = dataclasses.replace(builtin.tabletop(3), interreflection=0.0, ambient=light)
    _write(tmp_path / "set" / "table", table, truth)
    scenes = capture.open_set(tmp_path / "set").scenes
    initial_scene = observation.load(scenes[0], start).scene
    assert initial_scene is not None and initial_scene.bodies[0].ambient_share is not None
    fit = fitting.fit(scenes, start, free=["photometry"], folder=tmp_path, heldout=[])
    estimates = {
        estimate.name: estimate.value for estimate in fit.solutions["photometry"].estimates
    }
    assert estimates["projector.haze"] == pytest.approx(0.3, abs=0.1)
    assert estimates["scene.ambient.irradiance_w_m2[table]"] == pytest.approx(1.0, rel=0.2)


def test_waves_of_a_random_unit_are_dropped(small: Sensor) -> None:
    waving = with_values(small, [("imager.alignment.waves_px", 0.2)])
    assert waving != small and fitting.without_waves(waving) == small


@pytest.mark.long
def test_a_warp_is_fitted_last(captures: Path, small: Sensor, tmp_path: Path) -> None:
    """The captures have no warp; `test_warp_fit.py` covers a nonzero warp."""
    scenes = capture.open_set(captures).scenes
    result = fitting.fit(
        scenes, small, folder=tmp_path, free=["projector", "warp"], heldout=ROOMS[2:]
    )
    assert list(result.solutions) == ["geometry", "warp"]
    assert result.sensor.right.alignment.warp_px
    (estimate,) = result.solutions["warp"].estimates
    assert estimate.value < 0.1


def test_invalid_captures_are_refused_before_surfaces_are_loaded(
    captures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> Observation:
        raise AssertionError("a surface was made")

    monkeypatch.setattr(observation, "with_surface", fail)
    message = _refused(captures, small_camera.small("d415", 424, 240), tmp_path)
    assert message.startswith("sensor d415 must fit the captures")


def test_a_group_of_depth_alone_is_refused_with_infrared(
    captures: Path, small: Sensor, tmp_path: Path
) -> None:
    message = _refused(captures, small, tmp_path, free=["thresholds"])
    assert message == (
        "free must be fitted with infrared images; got thresholds. "
        "Captures of depth alone can be fitted by thresholds. Leave it out."
    )


@pytest.mark.parametrize(
    ("rooms", "requested", "expected"),
    [
        (ROOMS, None, ("den",)),
        (ROOMS[:3], None, ("cellar",)),
        (ROOMS[:2], None, ()),
        (ROOMS * 2, None, ("den",)),
        (ROOMS, ["bath", "attic"], ("bath", "attic")),
        (ROOMS, [], ()),
    ],
)
def test_rooms_held_out(
    rooms: tuple[str, ...],
    requested: list[str] | None,
    expected: tuple[str, ...],
    captures: Path,
) -> None:
    """The default is every fourth room, the last of three, and none of fewer."""
    by_room = {scene.room: scene for scene in capture.open_set(captures).scenes}
    scenes = [by_room[room] for room in rooms]
    assert fitting._held_out(scenes, requested) == expected


def _calibrate(captures: Path, sensor: Sensor, out: Path) -> str:
    with pytest.raises(InputError) as caught:
        calibrate_captures(str(captures), sensor, out, free=["pattern"])
    return str(caught.value)


def test_invalid_output_is_refused_before_the_fit(
    captures: Path, small: Sensor, tmp_path: Path
) -> None:
    message = _calibrate(captures, small, tmp_path / "mine.json")
    assert message.startswith("out must be a sensor file, NAME.toml")
    taken = tmp_path / "taken.toml"
    taken.write_text("mine")
    assert "taken.toml" in _calibrate(captures, small, taken)
    assert taken.read_text() == "mine"
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "mine.txt").write_text("mine")
    _calibrate(captures, small, tmp_path / "folder.toml")
    assert (tmp_path / "folder" / "mine.txt").read_text() == "mine"
    assert not (tmp_path / "folder.toml").exists()


def test_a_refused_fit_leaves_no_files(captures: Path, small: Sensor, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        calibrate_captures(
            str(captures), small, tmp_path / "x.toml", free=["pattern"], heldout=["garage"]
        )
    assert not list(tmp_path.iterdir())


def test_calibration_writes_the_sensor_and_the_report(
    captures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one_room = tmp_path / "set"
    shutil.copytree(captures / "scene-attic", one_room / "scene-attic")
    shutil.copy(captures / "capture.toml", one_room)
    out = tmp_path / "x.toml"
    words = ["calibrate", str(one_room), "--sensor", "d435", "--free", "baseline", "--json"]
    assert command_line.main([*words, "--set", "projector.power_w=1.0", "--out", str(out)]) == 0
    reported = json.loads((tmp_path / "x" / "report.json").read_text())
    assert reported["parameters"] == json.loads(capsys.readouterr().out)["parameters"]
    names = {path.name for path in (tmp_path / "x").iterdir()}
    assert {"report.html", "sensor.toml", "starling.json"} <= names
    # The right image's dots are 1 mm off, and the baseline alone can follow them.
    followed_m = presets.load("d435").baseline_m - 1e-3
    assert resolve.load(str(out)).baseline_m == pytest.approx(followed_m, abs=5e-5)


@pytest.fixture(scope="module")
def written(
    captures: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, object]]:
    """Run `starling calibrate`; return its moved output folder and its printed figures."""
    folder = tmp_path_factory.mktemp("calibrated")
    out = folder / "x.toml"
    words = ["calibrate", str(captures), "--sensor", "d435", "--free", "pattern", "--json"]
    words += ["--set", "projector.power_w=1.0", "--out", str(out)]
    with redirect_stdout(io.StringIO()) as output:
        status = command_line.main(words)
    assert not status
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    shutil.move(out, elsewhere / "x.toml")
    shutil.move(folder / "x", elsewhere / "x")
    return elsewhere, json.loads(output.getvalue())


@pytest.mark.long
def test_the_sensor_file_and_its_folder_move_together(
    written: tuple[Path, dict[str, object]],
) -> None:
    """After the move, both sensor files give the same projector light."""
    folder, _ = written
    outer, inner = (
        resolve.load(str(path)) for path in (folder / "x.toml", folder / "x" / "sensor.toml")
    )
    outer_light, inner_light = (
        projector.irradiance_at_unit_distance(each.projector) for each in (outer, inner)
    )
    np.testing.assert_array_equal(outer_light, inner_light)
    for emitter in outer.projector.emitters:
        assert Path(emitter.pattern).parent.name == "x"
    # The true projector is 1 mm off the preset's position.
    x = outer.projector.position_m[0] - presets.load("d435").projector.position_m[0]
    assert x == pytest.approx(1e-3, abs=2e-4)


@pytest.mark.long
def test_the_folder_holds_the_report(written: tuple[Path, dict[str, object]]) -> None:
    folder, _ = written
    names = {path.name for path in (folder / "x").iterdir()}
    assert {
        "dots.csv",
        "report.json",
        "report.html",
        "sensor.toml",
        "emitter-0.png",
        "starling.json",
    } <= names
    assert not [name for name in names if name.startswith("mirrored")]
    assert len((folder / "x" / "dots.csv").read_text().splitlines()) > 100


@pytest.mark.long
def test_printed_figures_have_the_specified_keys(written: tuple[Path, dict[str, object]]) -> None:
    """The printed keys and the held-out score meet the specification."""
    folder, printed = written
    parameters, heldout = printed["parameters"], printed["heldout"]
    assert isinstance(parameters, dict) and isinstance(heldout, dict)
    for parameter in parameters.values():
        assert {"value", "sd", "unit"} <= set(parameter)
    assert "projector.position_m.x" in parameters
    assert isinstance(printed["undetermined"], list) and printed["undetermined"]
    assert isinstance(printed["seconds"], float)
    assert heldout["ncc"] > 0.85
    assert abs(heldout["mirrored"]) < 0.05
    assert heldout["ncc"] > heldout["ncc_p25"]
    assert 0 < heldout["ceiling_p25"] < heldout["ceiling"] <= 1
    reported = json.loads((folder / "x" / "report.json").read_text())
    assert reported["parameters"] == parameters
