"""The command line: output of each verb, its stream, and error messages."""

from __future__ import annotations

import errno
import json
import math
import subprocess
import sys
import time
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from starling import command_line
from starling.sim import simulate
from starling.sim.commands import simulate_captures
from starling.sim.console import progress
from starling.sim.render import backend
from starling.sim.render.layers import Layers, Truth, ViewLayers
from starling.sim.scene.builtin import scenes as builtin
from starling.sim.sensor import presets
from starling.sim.stereo import measurement
from starling.sim.stereo.depth import DepthMap
from tests.unit.command_line import Capsys
from tests.unit.command_line import refused as _refused
from tests.unit.command_line import run as _run

ROOT = Path(__file__).parents[2]
VERBS = (
    *("doctor", "sensors", "effects", "simulate", "match", "compare", "show", "atlas", "bench"),
    *("generate", "verify", "export", "fuse"),
)


def _shot(shape: tuple[int, int]) -> Any:
    zeros = np.zeros(shape, np.float32)
    ones = np.ones(shape, bool)
    layers = ("projector_direct", "projector_indirect", "ambient", "other", "depth_m")
    view = ViewLayers(**dict.fromkeys(layers, zeros), body=zeros.astype(np.uint32))
    codes = np.zeros(shape, np.uint32)
    truth = Truth(
        depth_m=zeros + 1, normal=np.zeros((*shape, 3), np.float32), material=codes,
        right_sees=ones, lit=ones,
    )  # fmt: skip
    image = np.full(shape, 40, np.uint8)
    return types.SimpleNamespace(
        layers=Layers(left=view, right=view, truth=truth),
        ir_left=image,
        ir_right=image.copy(),
        depth=DepthMap(disparity_px=zeros + 45, depth_m=zeros + 1, valid=ones, reason=codes),
        registered_m=None,
        exposure_s=8e-3,
        gain=1.0,
    )


@pytest.fixture
def no_renderer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace rendering and matching, which take seconds, by simple substitutes.

    What still takes long on a busy machine does not say how far it is.
    """
    from starling.sim import randomness, simulate
    from starling.sim.imaging import colour_picture
    from starling.sim.scene import sources

    def simulated(scene: Any, sensor: Any, *, seed: int, frame: int = 0, **_: Any) -> Any:
        shot = _shot((sensor.height, sensor.width))
        noise = randomness.generator(seed, frame, "imager", "noise left").integers(0, 9, (48, 64))
        shot.ir_left[:48, :64] += noise.astype(np.uint8)
        return shot

    def measured(left: np.ndarray, right: np.ndarray, sensor: Any, *, causes: Any) -> DepthMap:
        return _shot(left.shape).depth

    monkeypatch.setattr(sources, "load", lambda *_: builtin.wall())
    monkeypatch.setattr(colour_picture, "picture", lambda *_: np.zeros((2, 3, 3), np.uint8))
    monkeypatch.setattr(simulate, "simulate", simulated)
    monkeypatch.setattr(
        simulate,
        "sequence",
        lambda scene, sensor, *, frames, seed, **_: (
            simulated(scene, sensor, seed=seed, frame=frame) for frame in range(frames)
        ),
    )
    mitsuba = types.SimpleNamespace(variant=lambda: "scalar_rgb")
    monkeypatch.setattr(backend, "mitsuba", lambda: mitsuba)
    monkeypatch.setattr(measurement, "measure", measured)
    monkeypatch.setattr(progress, "_QUIET_S", math.inf)


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_with_an_example(verb: str, capsys: Capsys) -> None:
    code, out, _ = _run(verb, "--help", capsys=capsys)
    assert code == 0
    assert f"Example: starling {verb}" in out
    assert "--json" in out and "--debug" in out


def test_help_is_quick_and_lists_the_verbs() -> None:
    started = time.perf_counter()
    run = subprocess.run(
        [sys.executable, "-m", "starling", "--help"], capture_output=True, text=True, check=True
    )
    assert time.perf_counter() - started < 3  # Under 1 s on a machine that does nothing else.
    assert all(verb in run.stdout for verb in VERBS)


@pytest.mark.parametrize(
    "arguments", [[], ["simluate"], ["simulate", "wall"], ["sensors", "shwo"], ["bench", "--fast"]]
)
def test_bad_flags_exit_2(arguments: list[str], capsys: Capsys) -> None:
    assert _run(*arguments, capsys=capsys)[:2] == (2, "")


def test_doctor_and_bench_print_their_results(
    capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand_in = types.ModuleType("starling.sim.commands.bench")
    stand_in.bench = lambda *, track: {"ratio": 1.5, "n": len([*track([1, 2], "bench")])}  # type: ignore[attr-defined]
    monkeypatch.setattr(progress, "_QUIET_S", -1.0)
    monkeypatch.setitem(sys.modules, "starling.sim.commands.bench", stand_in)
    monkeypatch.setattr("starling.sim.commands.bench", stand_in, raising=False)
    monkeypatch.setattr(backend, "report", lambda: {"variant": "x"})
    assert json.loads(_run("doctor", "--json", capsys=capsys)[1]) == {"variant": "x"}
    code, out, err = _run("bench", "--json", capsys=capsys)
    assert (code, json.loads(out)) == (0, {"ratio": 1.5, "n": 2})
    assert err == "bench 1/2\nbench 2/2\n"


@pytest.mark.usefixtures("no_renderer")
def test_simulate_writes_a_whole_set(capsys: Capsys, tmp_path: Path, small_set: Path) -> None:
    out = tmp_path / "out"
    code, message, err = _run(
        "simulate", small_set, "--sensor", "d435", "--out", out, "--frames", 2, "--seed", 7,
        "--set", "projector.power_w=0.2", "--set", "imager.gain=2", "--json", capsys=capsys,
    )  # fmt: skip
    assert (code, err) == (0, "")
    result = json.loads(message)
    assert set(result) == {"out", "files", "seconds", "scenes"}
    assert result["files"] == 3 + 2 * (2 + 2 * 6)
    record = json.loads((out / "starling.json").read_text())
    assert record["verb"] == "simulate" and record["arguments"]["seed"] == 7
    assert record["arguments"]["sensor"] == "d435"
    assert record["arguments"]["set"] == ["projector.power_w=0.2", "imager.gain=2"]
    assert record["renderer"] == {"variant": "scalar_rgb", "llvm": None}
    assert "numba" in record["versions"]
    assert record["versions"]["numpy"] == np.__version__ and set(record["figures"]) == {"a", "b"}
    sensor = presets.load(str(out / "sensor.toml"))
    assert (sensor.width, sensor.fx_px, sensor.baseline_m) == (160, 90.0, 0.05)
    assert (sensor.projector.power_w, sensor.right.gain) == (0.2, 2.0)
    frame = json.loads((out / "a" / "1" / "frame.json").read_text())
    assert (frame["frame"], frame["laser_power"]) == (1, 0.2)
    assert frame["seed"] == simulate_captures.scene_seed(7, "a")
    assert frame["reasons"] == {"valid": 48 * 160}
    assert (out / "a" / "room").read_text() == "kitchen\n"
    code, message, _ = _run("compare", small_set, out, "--json", capsys=capsys)
    assert code == 0
    assert json.loads(message)["metrics"]["ndp_rate"]["sim"] == 0
    assert "nmad_px" in _run("compare", small_set / "a", out / "a", capsys=capsys)[1]
    assert "--force" in _refused(
        "simulate", small_set, "--sensor", "d435", "--out", out, capsys=capsys
    )


@pytest.mark.usefixtures("no_renderer")
def test_simulate_a_builtin_scene(capsys: Capsys, tmp_path: Path) -> None:
    out = tmp_path / "out"
    small = ("--set", "width=64", "--set", "height=48", "--set", "cx_px=31.5", "--set", "cy_px=24")
    assert _run("simulate", "wall", "--sensor", "d435", "--out", out, *small, capsys=capsys)[0] == 0
    assert (out / "wall" / "0" / "frame.exr").is_file()
    bounced = ("--effect", "interreflection=0.5")
    for indirect, samples in (
        ((), 0),
        (bounced, 16),
        (("--samples", 4), 4),
        ((*bounced, "--samples", 8), 8),
    ):
        requested = (
            "simulate",
            "wall",
            "--sensor",
            "d435",
            "--out",
            out,
            *small,
            *indirect,
            "--force",
        )
        assert _run(*requested, capsys=capsys)[0] == 0
        frame = json.loads((out / "wall" / "0" / "frame.json").read_text())
        assert frame["samples"] == samples
    assert "frames must be an integer in" in _refused(
        "simulate", "wall", "--sensor", "d435", "--out", out, "--frames", "0", capsys=capsys
    )


@pytest.mark.usefixtures("no_renderer")
def test_scenes_of_one_set_have_independent_noise(
    capsys: Capsys, tmp_path: Path, small_set: Path
) -> None:
    def noise(out: Path, scene: str, frame: int) -> np.ndarray:
        image = cv2.imread(str(out / scene / str(frame) / "ir_left.png"), cv2.IMREAD_UNCHANGED)
        assert image is not None
        return image[:48, :64].ravel().astype(float)

    whole, single = tmp_path / "whole", tmp_path / "single"
    seeded = ("--sensor", "d415", "--seed", 7, "--frames", 2)
    assert _run("simulate", small_set, *seeded, "--out", whole, capsys=capsys)[0] == 0
    assert _run("simulate", small_set / "b", *seeded, "--out", single, capsys=capsys)[0] == 0
    for second in (noise(whole, "b", 0), noise(whole, "b", 1), noise(whole, "a", 1)):
        assert abs(np.corrcoef(noise(whole, "a", 0), second)[0, 1]) < 0.1
    assert np.array_equal(noise(whole, "b", 1), noise(single, "b", 1))
    record = json.loads((whole / "starling.json").read_text())
    expected = json.loads((whole / "b" / "0" / "frame.json").read_text())["seed"]
    assert record["arguments"]["seed"] == 7 and 0 <= expected < 2**53
    again = simulate.simulate(
        builtin.wall(), presets.load(str(whole / "sensor.toml")), seed=expected, frame=0
    )
    assert np.array_equal(again.ir_left[:48, :64].ravel(), noise(whole, "b", 0))


@pytest.mark.usefixtures("no_renderer")
def test_progress_counts_frames(
    capsys: Capsys, tmp_path: Path, small_set: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "_QUIET_S", -1.0)
    _, _, err = _run(
        "simulate", small_set, "--sensor", "d415", "--out", tmp_path / "out", "--frames", 2,
        capsys=capsys,
    )  # fmt: skip
    assert err.splitlines() == [f"simulate {number}/4" for number in range(1, 5)]


@pytest.mark.usefixtures("no_renderer")
@pytest.mark.parametrize("verb", ["match", "simulate", "show"])
def test_output_never_overwrites_the_input(
    verb: str, capsys: Capsys, small_set: Path, tmp_path: Path
) -> None:
    (small_set / "starling.json").write_text("{}")  # As if starling had written it.
    (tmp_path / "link").symlink_to(small_set.name)
    before = sorted(small_set.rglob("*"))
    sensor = () if verb == "show" else ("--sensor", "d415")
    for out in (small_set, small_set / "a", small_set.parent, small_set / "new", tmp_path / "link"):
        message = _refused(verb, small_set / "a", "--out", out, "--force", *sensor, capsys=capsys)
        assert "out must lie outside its input; got " in message
    assert sorted(small_set.rglob("*")) == before


def test_simulate_spares_a_scene_file(capsys: Capsys, tmp_path: Path) -> None:
    mesh = tmp_path / "x.ply"
    mesh.write_text("ply")
    (tmp_path / "starling.json").write_text("{}")
    message = _refused(
        "simulate", mesh, "--sensor", "d415", "--out", tmp_path, "--force", capsys=capsys
    )
    assert "out must lie outside" in message and mesh.exists()


@pytest.mark.usefixtures("no_renderer")
def test_match_prints_and_writes(capsys: Capsys, tmp_path: Path, small_set: Path) -> None:
    (small_set / "b" / "truth.png").unlink()
    out = tmp_path / "out"
    code, printed, err = _run(
        "match", small_set, "--sensor", "d415", "--setting", "fast", "--out", out, "--json",
        capsys=capsys,
    )  # fmt: skip
    assert (code, err) == (0, "")
    result = json.loads(printed)
    keys = {"bias_px", "nmad_px", "bad1_pct", "fill", "ndp_iou"}
    pair = {"fill", "left_right_agreement"}
    for row in (*result["scenes"].values(), result["median"]):
        groups = {**dict.fromkeys(("ours", "device", "agreement"), keys), "pair": pair}
        assert {name: set(figures) for name, figures in row.items()} == groups
    assert result["scenes"]["b"]["ours"]["fill"] is None
    assert result["scenes"]["b"]["agreement"]["fill"] == 1
    assert (out / "a" / "0" / "depth.png").is_file()
    assert not (out / "a" / "0" / "ir_left.png").exists()
    requested = json.loads((out / "starling.json").read_text())["arguments"]
    typed = {"captures": str(small_set), "sensor": "d415", "setting": "fast", "set": []}
    assert requested == {**typed, "mode": "", "device_preset": None}
    message = _refused("match", out, "--sensor", "d415", capsys=capsys)
    assert "must hold ir_left.png and ir_right.png" in message
    message = _refused("match", small_set, "--sensor", "d415", "--setting", "fats", capsys=capsys)
    assert "Known: fast" in message


@pytest.mark.usefixtures("no_renderer")
def test_match_without_device_or_known_truth(capsys: Capsys, small_set: Path) -> None:
    for scene in ("a", "b"):
        (small_set / scene / "0" / "depth.png").unlink()
    (small_set / "a" / "truth.png").unlink()
    cv2.imwrite(str(small_set / "b" / "truth.png"), np.zeros((48, 160), np.uint16))
    message = _run("match", small_set, "--sensor", "d415", "--json", capsys=capsys)[1]
    assert json.loads(message)["median"]["ours"] == dict.fromkeys(
        ("bias_px", "nmad_px", "bad1_pct", "fill", "ndp_iou")
    )


def test_show_writes_a_picture(capsys: Capsys, tmp_path: Path, small_set: Path) -> None:
    out = tmp_path / "a.png"
    code, message, _ = _run("show", small_set / "a", "--out", out, "--json", capsys=capsys)
    assert code == 0 and json.loads(message) == {"out": str(out), "files": 1}
    assert cv2.imread(str(out)) is not None
    assert "out must not exist" in _refused("show", small_set / "a", "--out", out, capsys=capsys)
    assert "There are: 0" in _refused(
        "show", small_set / "a", "--out", out, "--frame", 9, "--force", capsys=capsys
    )


@pytest.mark.parametrize("name", ["pic.jpg", "pic.PDF", "pic.webp"])
def test_show_refuses_other_pictures(
    name: str, capsys: Capsys, tmp_path: Path, small_set: Path
) -> None:
    message = _refused("show", small_set / "a", "--out", tmp_path / name, capsys=capsys)
    assert "out must be NAME.png or a folder; got " in message
    assert not (tmp_path / name).exists()


@pytest.mark.usefixtures("no_renderer")
def test_full_disk_is_one_line_and_leaves_nothing(
    capsys: Capsys, tmp_path: Path, small_set: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = Path.write_bytes

    def fail(self: Path, data: bytes) -> int:
        if self.name == "frame.json":
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(self, data)

    monkeypatch.setattr(Path, "write_bytes", fail)
    out = tmp_path / "new" / "out"
    message = _refused("simulate", small_set, "--sensor", "d415", "--out", out, capsys=capsys)
    assert "disk full. Free some space." in message
    assert not out.parent.exists()


def test_a_deleted_working_directory_is_refused(
    capsys: Capsys, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert "working directory must exist" in _refused("sensors", capsys=capsys)


def test_other_errors_are_one_line_too(capsys: Capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    def raising(error: BaseException) -> Callable[[], None]:
        def report() -> None:
            raise error

        return report

    monkeypatch.setattr(backend, "report", raising(backend.BackendError("no\nvariant")))
    assert _refused("doctor", capsys=capsys) == "starling: no variant\n"
    monkeypatch.setattr(backend, "report", raising(KeyError("x")))
    message = _refused("doctor", capsys=capsys)
    assert "an error of starling itself, KeyError" in message and "--debug" in message
    with pytest.raises(KeyError):
        command_line.main(["doctor", "--debug"])
    monkeypatch.setattr(backend, "report", raising(MemoryError()))
    assert "memory must suffice; got too little" in _refused("doctor", capsys=capsys)
    monkeypatch.setattr(backend, "report", raising(KeyboardInterrupt()))
    assert _run("doctor", capsys=capsys)[0] == 130
    monkeypatch.setattr(backend, "report", raising(SystemExit("stop")))
    assert _run("doctor", capsys=capsys)[0] == 1


@pytest.mark.parametrize(
    ("flags", "flag"),
    [
        (("sweep", "--out", "o", "--baseline-m", "--distance-m", "1"), "--baseline-m"),
        (("sweep", "--out", "o", "--distance-m"), "--distance-m"),
        (("simulate", "wall", "--sensor", "d435", "--out", "o", "--set"), "--set"),
        (("train", "trees", "set", "--rooms", "--out", "o"), "--rooms"),
    ],
)
def test_a_flag_of_a_list_without_a_value_is_refused(
    flags: tuple[str, ...], flag: str, capsys: Capsys
) -> None:
    message = _refused(*flags, capsys=capsys)
    assert message.startswith(f"starling: {flag} must have a value; got none. Give one")
