"""Fitting as a whole, and `starling calibrate`: what is refused, and what is written."""

from __future__ import annotations

import dataclasses
import io
import json
import shutil
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
import pytest

from starling import command_line
from starling.calibration import fit_sensor as fitting
from starling.calibration import observation
from starling.calibration.calibrate_captures import calibrate_captures
from starling.calibration.observation import Observation
from starling.patterns.errors import InputError
from starling.sim.captures import capture
from starling.sim.render import direct as render
from starling.sim.render import emission as projector
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene.builtin import scenes as builtin
from starling.sim.scene.scene import Ambient, Scene
from starling.sim.sensor import presets as sensors
from starling.sim.sensor import resolve as asked_sensor
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import infrared
from tests.unit.calibration import small_camera

ROOMS = ("attic", "bath", "cellar", "den")


def _write_scene(folder: Path, room: str, number: int, truth: Sensor) -> None:
    """One simulated scene with reference depth, in a room of its own."""
    scene = (builtin.tabletop(1), builtin.clutter(2), builtin.staircase(0.6), builtin.tabletop(7))
    body = dataclasses.replace(scene[number], interreflection=0.0)
    place = folder / f"scene-{room}"
    _write(place, body, truth, seed=number)
    (place / "room").write_text(room + "\n")


def _write(place: Path, scene: Scene, truth: Sensor, *, seed: int = 0) -> None:
    layers = render.layers(Stage(scene), truth)
    pair = infrared(layers, scene, truth, seed=seed)
    small_camera.write_scene(place, layers.truth.depth_m, (pair.left, pair.right), truth)


@pytest.fixture(scope="module")
def small() -> Sensor:
    return small_camera.small("d435", 424, 240)


@pytest.fixture(scope="module")
def captures(small: Sensor, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set of four rooms by a D435 whose projector stands 1 mm beside its preset's place."""
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


def test_a_room_must_be_left(captures: Path, small: Sensor, tmp_path: Path) -> None:
    message = _refused(captures, small, tmp_path, heldout=list(ROOMS))
    assert message.startswith("heldout must leave a room to fit; got attic, bath, cellar, den.")


def test_unknown_groups_and_none_are_refused(captures: Path, small: Sensor, tmp_path: Path) -> None:
    message = _refused(captures, small, tmp_path, free=["lens"])
    assert message.startswith("free must be a known name; got 'lens'.") and "pattern" in message
    message = _refused(captures, small, tmp_path, free=[])
    assert message.startswith("free must name a group; got none.")


def test_a_warp_of_one_room_is_refused(captures: Path, small: Sensor, tmp_path: Path) -> None:
    message = _refused(captures, small, tmp_path, free=["warp"], heldout=ROOMS[1:])
    assert message.startswith("captures must hold infrared pairs of 2 rooms for the warp; got 1.")


def test_light_that_was_told_with_haze_does_not_tell_haze(tmp_path: Path) -> None:
    """Even ambient light and a haze of 0.3, where none is believed: a map of light by place, told
    by the same dots under that belief, would confirm it.

    To 0.1 and a fifth: reflectance is made under the belief too, so not all of it is forgotten.
    """
    start = small_camera.small("d435", 424, 240)
    truth = with_values(start, [("projector.haze", 0.3)])
    small_camera.write_info(tmp_path / "set", truth)
    light = Ambient(irradiance_w_m2=1.0, gradient=0.0)
    table = dataclasses.replace(builtin.tabletop(3), interreflection=0.0, ambient=light)
    _write(tmp_path / "set" / "table", table, truth)
    scenes = capture.open_set(tmp_path / "set").scenes
    told = observation.load(scenes[0], start).scene
    assert told is not None and told.bodies[0].ambient_share is not None
    fit = fitting.fit(scenes, start, free=["photometry"], folder=tmp_path, heldout=[])
    found = {one.name: one.value for one in fit.solutions["photometry"].estimates}
    assert found["projector.haze"] == pytest.approx(0.3, abs=0.1)
    assert found["scene.ambient.irradiance_w_m2[table]"] == pytest.approx(1.0, rel=0.2)


@pytest.mark.long
def test_a_warp_is_fitted_last(captures: Path, small: Sensor, tmp_path: Path) -> None:
    """The captures have none; that another one is found, `test_warp_fit.py` tests."""
    scenes = capture.open_set(captures).scenes
    found = fitting.fit(
        scenes, small, folder=tmp_path, free=["projector", "warp"], heldout=ROOMS[2:]
    )
    assert list(found.solutions) == ["geometry", "warp"]
    assert found.sensor.right.alignment.warp_px
    (estimate,) = found.solutions["warp"].estimates
    assert estimate.value < 0.1


def test_wrong_captures_are_refused_before_their_surfaces_are_made(
    captures: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def made(*_: object, **__: object) -> Observation:
        raise AssertionError("a surface was made")

    monkeypatch.setattr(observation, "with_surface", made)
    message = _refused(captures, small_camera.small("d415", 424, 240), tmp_path)
    assert message.startswith("sensor d415 must fit the captures")


@pytest.mark.slow
def test_a_group_of_depth_alone_is_refused_with_infrared(
    captures: Path, small: Sensor, tmp_path: Path
) -> None:
    message = _refused(captures, small, tmp_path, free=["thresholds"])
    assert message.startswith("free must be a known name; got 'thresholds'.")


@pytest.mark.parametrize(
    ("rooms", "asked", "expected"),
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
    asked: list[str] | None,
    expected: tuple[str, ...],
    captures: Path,
) -> None:
    """Every fourth, the last of three, none of fewer; or those that are asked for."""
    by_room = {scene.room: scene for scene in capture.open_set(captures).scenes}
    scenes = [by_room[room] for room in rooms]
    assert fitting._held_out(scenes, asked) == expected


def _calibrate(captures: Path, sensor: Sensor, out: Path) -> str:
    with pytest.raises(InputError) as caught:
        calibrate_captures(str(captures), sensor, out, free=["pattern"])
    return str(caught.value)


def test_what_cannot_be_written_is_refused_before_any_work(
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


def test_nothing_is_left_of_a_refused_fit(captures: Path, small: Sensor, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        calibrate_captures(
            str(captures), small, tmp_path / "x.toml", free=["pattern"], heldout=["garage"]
        )
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def written(
    captures: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, object]]:
    """What `starling calibrate` writes, moved to another folder, and what it prints."""
    folder = tmp_path_factory.mktemp("calibrated")
    out = folder / "x.toml"
    words = ["calibrate", str(captures), "--sensor", "d435", "--free", "pattern", "--json"]
    words += ["--set", "projector.power_w=1.0", "--out", str(out)]
    with redirect_stdout(io.StringIO()) as said:
        status = command_line.main(words)
    assert not status
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    shutil.move(out, elsewhere / "x.toml")
    shutil.move(folder / "x", elsewhere / "x")
    return elsewhere, json.loads(said.getvalue())


@pytest.mark.slow
def test_the_sensor_file_and_its_folder_move_together(
    written: tuple[Path, dict[str, object]],
) -> None:
    """Loaded from where they lie now, both sensor files throw the same light."""
    folder, _ = written
    outer, inner = (
        asked_sensor.load(str(path)) for path in (folder / "x.toml", folder / "x" / "sensor.toml")
    )
    one, other = (projector.irradiance_at_unit_distance(each.projector) for each in (outer, inner))
    np.testing.assert_array_equal(one, other)
    for emitter in outer.projector.emitters:
        assert Path(emitter.pattern).parent.name == "x"
    # The true projector stands 1 mm beside the preset's place.
    x = outer.projector.position_m[0] - sensors.load("d435").projector.position_m[0]
    assert x == pytest.approx(1e-3, abs=2e-4)


@pytest.mark.slow
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


@pytest.mark.slow
def test_what_is_printed_keeps_the_contract(written: tuple[Path, dict[str, object]]) -> None:
    """The keys that the design fixes; a held-out room whose dots are found again."""
    folder, printed = written
    parameters, heldout = printed["parameters"], printed["heldout"]
    assert isinstance(parameters, dict) and isinstance(heldout, dict)
    for one in parameters.values():
        assert {"value", "sd", "unit"} <= set(one)
    assert "projector.position_m.x" in parameters
    assert isinstance(printed["undetermined"], list) and printed["undetermined"]
    assert isinstance(printed["seconds"], float)
    assert heldout["ncc"] > 0.85
    assert abs(heldout["mirrored"]) < 0.05
    assert heldout["ncc"] > heldout["ncc_p25"]
    assert 0 < heldout["ceiling_p25"] < heldout["ceiling"] <= 1
    reported = json.loads((folder / "x" / "report.json").read_text())
    assert reported["parameters"] == parameters
