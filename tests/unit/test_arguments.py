"""Arguments of wrong types are refused at the public interface; numpy scalars are numbers."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import starling
from starling.patterns import errors
from starling.sim.sensor import presets

api: Any = starling  # Without types: the tests give wrong ones.
K = np.array([[40.0, 0, 15.5], [0, 40.0, 15.5], [0, 0, 1]])
IMAGE = np.zeros((32, 32), np.uint8)
SENSOR = starling.load_sensor("d435")
SCENE = starling.load_scene("wall", SENSOR)
SIZE = ("width=32", "height=32", "fx_px=40", "fy_px=40", "cx_px=15.5", "cy_px=15.5")
SMALL = starling.load_sensor("d435", edits=[*SIZE, "matcher.search_px=16"])
WRONG_EFFECTS = (["lens_blur"], "lens_blur", {1: 2}, {"lens_blur": [1]}, {"lens_blur": True}, 0)


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("captures") / "set"
    starling.simulate_captures("wall:1", SMALL, folder)
    return folder


def _refuses(name: str, call: Callable[[], object]) -> None:
    with pytest.raises(starling.InputError, match=f"^{re.escape(name)}"):
        call()


@pytest.mark.parametrize("sensor", ["d435", None, 1])
def test_functions_of_a_sensor_refuse_other_values(
    sensor: Any, captures: Path, tmp_path: Path
) -> None:
    for call in (
        lambda: api.match(IMAGE, IMAGE, sensor),
        lambda: api.simulate_captures("wall", sensor, tmp_path / "out"),
        lambda: api.calibrate(captures, sensor, free=["baseline"], folder=tmp_path),
        lambda: api.diagnose(captures, sensor),
        lambda: api.load_scene("wall", sensor),
        lambda: api.apply_effects(sensor, SCENE, {}),
    ):
        _refuses("sensor must be of type Sensor", call)


@pytest.mark.parametrize("value", [None, 1, b"wall"])
def test_names_of_wrong_types_are_refused(value: Any) -> None:
    _refuses("model must be of type str or Path", lambda: api.load_residual(value))
    _refuses("name must be of type str or Path", lambda: api.load_sensor(value))
    _refuses("specifier must be of type str or Path", lambda: api.load_scene(value, SENSOR))
    _refuses("scene must be of type str or Path", lambda: api.simulate(value, SENSOR))
    _refuses("scene must be of type str or Path", lambda: api.simulate_captures(value, SENSOR, "a"))
    _refuses("sensor must be of type Sensor", lambda: api.simulate("wall", value))
    _refuses("sensor must be of type Sensor", lambda: api.corrupt(np.ones((32, 32)), K, value))
    _refuses("scene must be of type Scene", lambda: api.apply_effects(SENSOR, value, {}))
    _refuses("method must be of type str", lambda: api.complete(IMAGE, IMAGE, method=value))


@pytest.mark.parametrize("value", [None, 1, ["out"]])
def test_paths_of_wrong_types_are_refused(value: Any) -> None:
    _refuses("path must be of type str or Path", lambda: api.open_captures(value))
    _refuses("captures must be of type str or Path", lambda: api.draw(value, "a.png"))
    _refuses("out must be of type str or Path", lambda: api.draw("a", value))
    _refuses("plan must be of type str or Path", lambda: api.generate(value, "out"))
    _refuses("out must be of type str or Path", lambda: api.generate("plan.toml", value))
    _refuses("out must be of type str or Path", lambda: api.verify(value))
    _refuses(
        "out must be of type str or Path", lambda: api.simulate_captures("wall", SENSOR, value)
    )
    _refuses("real must be of type str or Path", lambda: api.compare(value, "a"))


@pytest.mark.parametrize("effects", WRONG_EFFECTS)
def test_effects_of_wrong_types_are_refused(effects: Any) -> None:
    pattern = r"^(effects|name of an effect) must be of type |^lens_blur.* must be a number; got "
    for call in (
        lambda: api.apply_effects(SENSOR, SCENE, effects),
        lambda: api.simulate_captures("wall", SENSOR, "out", effects=effects),
        lambda: api.Corruptor(SENSOR, K, effects=effects),
    ):
        with pytest.raises(starling.InputError, match=pattern):
            call()


@pytest.mark.parametrize("value", ["baseline", b"baseline", None, 3, [3]])
def test_lists_of_text_are_not_text(value: Any, captures: Path, tmp_path: Path) -> None:
    _refuses(
        "edits" if value != [3] else "entry of edits", lambda: api.load_sensor("d435", edits=value)
    )
    _refuses(
        "free" if value != [3] else "entry of free",
        lambda: api.calibrate(captures, SMALL, free=value, folder=tmp_path),
    )


def test_counts_are_whole_numbers(captures: Path) -> None:
    _refuses(
        "frames must be an integer", lambda: api.simulate_captures("wall", SENSOR, "a", frames=1.5)
    )
    _refuses("samples must be an integer", lambda: api.simulate("wall", SENSOR, samples=1.5))
    _refuses("workers must be an integer", lambda: api.generate("plan.toml", "a", workers=1.5))
    frame: Any = starling.open_captures(captures).scenes[0].frame
    for number in (0.0, False, "0"):
        _refuses("frame of wall-1 must be an integer", lambda number=number: frame(number))
    assert frame(np.int64(0)).number == 0


def test_residuals_of_wrong_types_are_refused() -> None:
    for value in (1, b"hybrid", []):
        _refuses(
            "residual must be of type str or Path",
            lambda value=value: api.corrupt(np.ones((32, 32)), K, SMALL, residual=value),
        )
    for value in (1, "hybrid"):
        _refuses(
            "residual must be a loaded model",
            lambda value=value: api.Corruptor(SMALL, K, residual=value),
        )
    nothing = api.Corruptor(SMALL, K, residual=lambda *arguments, **options: None)
    _refuses("result of residual must be of type DepthMap", lambda: nothing(np.ones((32, 32))))


@pytest.mark.parametrize("shape", ["ab", 3, (3,), (3, 4, 5), (0, 4), (4.0, 4.0)])
def test_corruptor_refuses_wrong_shapes(shape: Any) -> None:
    corruptor = starling.Corruptor(SMALL, K)
    with pytest.raises(starling.InputError, match=r"^(shape|height|width) must be"):
        corruptor.warm(shape)


def test_numpy_scalars_are_numbers() -> None:
    assert errors.is_number(np.float32(5)) and errors.is_number(np.int64(3))
    assert not errors.is_number(np.bool_(True)) and not errors.is_number(True)
    for strength in (np.float32(0.5), np.float64(0.5), 0.5):
        blurred, _ = api.apply_effects(SENSOR, SCENE, {"lens_blur": strength})
        assert type(blurred.left.lens.blur_px) is float
    wide, _ = api.apply_effects(SENSOR, SCENE, {"lens_blur": np.int64(2)})
    assert wide.left.lens.blur_px == 2


def test_a_sensor_of_numpy_scalars_is_written(tmp_path: Path) -> None:
    made: Any = dataclasses.replace(SENSOR, baseline_m=np.float32(0.05), width=np.int64(848))
    file = tmp_path / "camera.toml"
    file.write_text(presets.dumps(made), encoding="utf-8")
    assert starling.load_sensor(file).baseline_m == pytest.approx(0.05)


def test_scenes_refuse_parts_of_wrong_types() -> None:
    (body, *_) = SCENE.bodies
    changes: list[tuple[Any, dict[str, Any]]] = [
        (SCENE, {"bodies": list(SCENE.bodies)}),
        (SCENE, {"bodies": (body.mesh,)}),
        (SCENE, {"ambient": 0.1}),
        (SCENE, {"world_from_left": None}),
        (body, {"mesh": None}),
        (body, {"material": "wood"}),
        (body.mesh, {"vertices": [[0, 0, 0]]}),
        (body.material, {"rgb": 0.5}),
        (body.material, {"kind": np.zeros(3)}),
    ]
    for part, change in changes:
        with pytest.raises(starling.InputError, match=r"must be (of type|a known name|a tuple)"):
            dataclasses.replace(part, **change)


def test_match_warns_of_images_of_another_size() -> None:
    with pytest.warns(UserWarning, match=r"size \(32, 32\), and d435 of \(480, 848\)"):
        starling.match(IMAGE, IMAGE, SENSOR)


@pytest.mark.parametrize(
    ("option", "value", "rule"),
    [
        ("left", 1, "left must be of type str"),
        ("camera", None, "camera must be of type str"),
        ("depth_unit", 0.001, "depth_unit must be of type str"),
        ("sensor", SENSOR, "sensor must be of type str"),
        ("scene", Path("desk"), "scene must be of type str"),
        ("licence", None, "licence must be of type str"),
        ("calibration", 3, "calibration must be of type tuple or list"),
        ("calibration", [3], "calibration must be of type str or Path"),
        ("baseline", "0.05", "baseline must be > 0"),
        ("baseline", 0, "baseline must be > 0"),
        ("black_level", -1, "black_level must be in [0, 65535]"),
        ("emitter", True, "emitter must be a known name; got True. Known: on, off."),
        ("every", 1.5, "every must be an integer in [1, 1000000]"),
        ("most_frames", "2", "most_frames must be an integer in [0, 1000000]"),
        ("rectify", 1, "rectify must be of type bool"),
        ("moving", "yes", "moving must be of type bool"),
        ("force", None, "force must be of type bool"),
    ],
)
def test_options_of_an_import_are_checked(option: str, value: Any, rule: str, tmp_path: Path):
    _refuses(rule, lambda: api.import_recording(tmp_path, tmp_path / "out", **{option: value}))


def test_imports_refuse_paths_of_wrong_types() -> None:
    _refuses("source must be of type str or Path", lambda: api.import_recording(None, "out"))
    _refuses("out must be of type str or Path", lambda: api.import_recording("desk.bag", None))


def test_text_that_no_file_can_be_named_is_refused(tmp_path: Path) -> None:
    """Half of a character, as in damaged JSON, cannot be encoded."""
    half, rule = "\ud800", " must be Unicode text; got '\\ud800'"
    for name, call in (
        ("camera_matrix", lambda: api.load_sensor("d435", camera_matrix=half)),
        ("name", lambda: api.load_sensor(f"{half}")),
        ("plan", lambda: api.generate(half, "out")),
        ("out", lambda: api.draw(tmp_path, half)),
        ("model", lambda: api.load_residual(half)),
        ("scene", lambda: api.simulate_captures(half, SENSOR, "out")),
    ):
        _refuses(f"{name}{rule}", call)
    _refuses("sensor must be", lambda: api.simulate("wall", f"{half}.toml"))


@pytest.mark.parametrize("value", [np.array(1), np.array("a"), np.ma.masked, 1])
def test_values_that_are_no_list_are_refused(value: Any, captures: Path, tmp_path: Path) -> None:
    _refuses("edits must be ", lambda: api.load_sensor("d435", edits=value))
    _refuses("families must be ", lambda: api.diagnose(captures, SMALL, families=value))
    settings = {"free": ["noise"], "folder": tmp_path / "out", "heldout": value}
    _refuses("heldout must be ", lambda: api.calibrate(captures, SMALL, **settings))


def test_modes_and_switches_of_wrong_types_are_refused(captures: Path, tmp_path: Path) -> None:
    for value in (np.eye(3), ["640x480"], 0):
        _refuses(
            "mode must be of type str", lambda value=value: api.load_sensor("d435", mode=value)
        )
    for value in (np.eye(2), None, 1, "yes"):
        out = {"out": tmp_path / "a", "force": value}
        _refuses(
            "force must be of type bool",
            lambda out=out: api.simulate_captures("wall", SMALL, **out),
        )
        _refuses(
            "residual must be of type bool",
            lambda value=value: api.diagnose(captures, SMALL, residual=value),
        )
    assert api.load_sensor("d435", edits=iter(())) == SENSOR
    _refuses("file must be readable; got .", lambda: api.load_sensor("d435", camera_matrix=""))
