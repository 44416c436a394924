"""The command line: effect table, atlas, device controls, and their error messages."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from starling import command_line
from starling.sim import effects
from starling.sim.commands import atlas, simulate_captures
from starling.sim.sensor.sensor import Sensor

Capsys = pytest.CaptureFixture[str]


def _printed(*arguments: object, capsys: Capsys) -> str:
    """Run a command that must succeed without standard error; return its standard output."""
    code = command_line.main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    assert (code, err) == (0, "")
    return out


def _refused(*arguments: object, capsys: Capsys) -> str:
    """Run a command that must fail; return its one-line error."""
    code = command_line.main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    assert (code, out) == (1, "")
    assert err.startswith("starling: ") and err.count("\n") == 1, err
    return err.removeprefix("starling: ")


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Replace the work of `simulate`; the dict receives its arguments."""
    arguments: dict[str, Any] = {}

    def simulated(scene: str, sensor: Sensor, out: Path, **more: Any) -> dict[str, Any]:
        arguments.update(more, sensor=sensor)
        return {"out": str(out)}

    monkeypatch.setattr(simulate_captures, "simulate_captures", simulated)
    return arguments


def test_effects_list_and_show(capsys: Capsys) -> None:
    rows = json.loads(_printed("effects", "--json", capsys=capsys))
    assert [row["name"] for row in rows] == [row.name for row in effects.table()]
    listed = _printed("effects", capsys=capsys)
    assert all(f"\n{row.name} " in listed for row in effects.table())
    page = _printed("effects", "show", "lens_blur", "--sensor", "kinect-v1", capsys=capsys)
    assert page.startswith("lens_blur  (optics") and "source: " in page
    (row,) = json.loads(_printed("effects", "show", "exposure", "--json", capsys=capsys))
    assert row["parameters"][0]["neutral"] > 0


def test_effects_refuses(capsys: Capsys) -> None:
    assert "name must be given; got nothing" in _refused("effects", "show", capsys=capsys)
    message = _refused("effects", "show", "lens_blurr", capsys=capsys)
    assert message.startswith("effect must be a known name; got 'lens_blurr'. Known: lens_blur, ")
    assert "got 'd436'" in _refused("effects", "--sensor", "d436", capsys=capsys)


def test_simulate_takes_effects_preset_and_emitter(
    capsys: Capsys, call: dict[str, Any], tmp_path: Path
) -> None:
    code = command_line.main(
        ["simulate", "wall", "--sensor", "d435", "--out", str(tmp_path / "out"), "--json",
         "--effect", "lens_blur=0.8", "--effect", "hole_filling=left",
         "--device-preset", "high_accuracy", "--emitter", "off"]
    )  # fmt: skip
    out, err = capsys.readouterr()
    assert (code, json.loads(out)) == (0, {"out": str(tmp_path / "out")})
    assert "param-" in err  # Notes list the controls that the preset sets and those it cannot set.
    assert call["effects"] == {"lens_blur": 0.8, "hole_filling": "left"}
    assert call["sensor"].projector.power_w == 0
    assert call["sensor"].matcher.engine.second_peak > 0
    assert call["options"]["device_preset"] == "high_accuracy"
    assert call["options"]["emitter"] == "off"


def test_bad_emitter_is_a_bad_flag(capsys: Capsys, tmp_path: Path) -> None:
    arguments = ["simulate", "wall", "--sensor", "d435", "--out", str(tmp_path / "out")]
    assert command_line.main([*arguments, "--emitter", "dim"]) == 2
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--effect", "lens_blurr=1"],
            "effect must be a known name; got 'lens_blurr'. Known: lens",
        ),
        (["--effect", "lens_blur"], "--effect must be NAME[.PARAM]=VALUE; got 'lens_blur'."),
        (["--effect", ""], "--effect must be NAME[.PARAM]=VALUE; got ''."),
        (["--effect", "lens_blur.=1"], "parameter of lens_blur must be a known name; got ''."),
        (["--effect", "lens_blur=nan"], "lens_blur.sigma_px must be a number; got nan. Its unit"),
        (["--effect", "speckle_filter=inf"], "speckle_filter.count must be a number; got inf."),
        (["--effect", "lens_blur=800"], "effect lens_blur: lens.blur_px must be in [0, 20]; got 8"),
        (["--effect", "wavelength=8.5e-7"], "effect wavelength: projector.wavelength_nm must be"),
        (["--effect", "subsurface=2"], "effect subsurface: finish.subsurface_m must be in [0, 0."),
        (
            ["--effect", "prnu=5", "--effect", "lens_blur=0.5"],
            "effect prnu: imager.prnu must be in [0, 0.5]; got 5.0.",
        ),
        (
            ["--effect", "metal.roughness=0.1", "--effect", "specular.roughness=0.2"],
            "effects metal.roughness and specular.roughness must not set scene.finish.roughness",
        ),
        (
            ["--effect", "census_window=7", "--set", "matcher.setting=fast"],
            "effect census_window needs a sensor with matcher.engine.census_px; got d435 with "
            "SemiGlobalBlock. Set matcher.setting to d4xx",
        ),
        (["--effect", "temporal_filter=0.4"], "post.temporal_alpha must be 1 for a single frame"),
        (
            ["--effect", "registration=1", "--sensor", "kinect-v1"],
            "post.registered needs a colour camera; got none in kinect-v1. Add a [colour]",
        ),
        (
            ["--effect", "interreflection=0", "--samples", "4"],
            "samples must be 0 where effect interreflection is 0; got 4. Drop one of them.",
        ),
        (["--device-preset", "hihg_density"], "device preset must be a known name; got 'hihg_d"),
        (
            ["--device-preset", "default", "--sensor", "kinect-v1"],
            "sensor must be a stereo pair to take RealSense controls; got kinect-v1",
        ),
    ],
)
def test_simulate_refuses(
    arguments: list[str], message: str, capsys: Capsys, tmp_path: Path
) -> None:
    out = tmp_path / "new" / "out"
    sensor = () if "--sensor" in arguments else ("--sensor", "d435")
    printed = _refused("simulate", "wall", *sensor, "--out", out, *arguments, capsys=capsys)
    assert printed.startswith(message), printed
    assert not out.parent.exists()


def test_atlas_refuses_before_it_draws(
    capsys: Capsys, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def seen(*_: Any) -> None:
        raise AssertionError("rendered")

    monkeypatch.setattr(atlas, "_measure", seen)
    out = tmp_path / "new" / "out"
    message = _refused("atlas", "prnu", "lens_blurr", "--out", out, capsys=capsys)
    assert message.startswith("effect must be a known name; got 'lens_blurr'")
    message = _refused("atlas", "registration", "--out", out, "--sensor", "xtion", capsys=capsys)
    assert message.startswith("post.registered needs a colour camera")
    assert not out.parent.exists()
    (tmp_path / "mine.txt").write_text("x")
    message = _refused("atlas", "prnu", "--out", tmp_path, capsys=capsys)
    assert message.startswith("out must be an empty or new folder")
    message = _refused("atlas", "prnu", "--out", tmp_path, "--force", capsys=capsys)
    assert "without starling.json" in message
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_atlas_writes_a_page_and_a_picture_each(
    capsys: Capsys, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures, zeros = {"no depth [%]": 1.0}, np.zeros((2, 2), np.float32)
    seen: Any = atlas._Measured(shot=None, truth_m=zeros, error_px=zeros, figures=figures)  # type: ignore[arg-type]
    monkeypatch.setattr(atlas, "_measure", lambda *_, **__: seen)
    monkeypatch.setattr(atlas, "_picture", lambda *_: b"picture")
    out = tmp_path / "out"
    arguments = ("atlas", "prnu", "lens_blur", "prnu", "--out", out, "--json")
    message = json.loads(_printed(*arguments, capsys=capsys))
    written = sorted(path.name for path in out.iterdir())
    assert written == ["index.md", "lens_blur.jpg", "lens_blur.md", "prnu.jpg", "prnu.md",
                       "starling.json"]  # fmt: skip
    assert (message["out"], message["files"]) == (str(out), len(written))
    assert set(message) == {"out", "files", "seconds", "effects"}
    assert set(message["effects"]["prnu"]) == {"value", "without", "with"}
    record = json.loads((out / "starling.json").read_text())
    assert record["arguments"]["effects"] == ["prnu", "lens_blur"]
