"""Every example runs as its docstring says and stays short enough to read at a glance."""

from __future__ import annotations

import ast
import importlib
import os
import subprocess
import sys
import types
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from starling.sim.captures import capture

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
# Tests of `calibrate`, `diagnose` and completion call what these examples call.
LONG = ("02_new_camera", "03_calibrate", "04_residual", "05_diagnose", "08_complete_depth")


def _marked(example: Path) -> object:
    marks = [pytest.mark.long] * (example.stem in LONG)
    return pytest.param(example, id=example.stem, marks=marks)


@pytest.mark.parametrize("example", [_marked(example) for example in EXAMPLES])
def test_example_runs(example: Path, tmp_path: Path) -> None:
    run = subprocess.run(
        [sys.executable, example],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip()


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example_has_a_docstring(example: Path) -> None:
    text = example.read_text(encoding="utf-8")
    docstring = ast.get_docstring(ast.parse(text)) or ""
    assert f"python examples/{example.name}" in docstring.split("Usage:")[-1]
    assert len(text.splitlines()) < 60


def test_a_realsense_is_recorded_as_a_capture_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Uses a simulated camera: dots on left images, none with the projector off."""
    monkeypatch.setitem(sys.modules, "pyrealsense2", FakeRealSense())
    monkeypatch.syspath_prepend(ROOT / "examples")
    recorder = importlib.import_module("record_realsense")
    recorder.main(str(tmp_path / "mine"), "desk", "office")
    captures = capture.open_set(tmp_path / "mine")
    (scene,) = captures.scenes
    assert (scene.name, scene.room, len(scene.frames)) == ("desk", "office", recorder.REPEATS)
    info = captures.info
    assert (info.sensor, info.cx_px, info.baseline_m) == ("d415", 640.9, 0.055)
    frame = scene.frame(0)
    images = (frame.ir_left, frame.ir_right, frame.ir_left_off, frame.ir_right_off)
    levels = [int(image[0, 0]) for image in images if image is not None]
    assert levels == [11, 12, 1, 2]
    assert frame.depth_m is not None and frame.depth_m[0, 0] == pytest.approx(1.5)
    assert frame.record == {"exposure_s": 0.0085, "gain": 1.0, "laser_power": 150.0}


class FakeRealSense(types.ModuleType):
    """The part of `pyrealsense2` that the recorder uses."""

    def __init__(self) -> None:
        super().__init__("pyrealsense2")
        names = ("exposure", "gain", "laser_power", "emitter_enabled", "enable_auto_exposure")
        self.option = SimpleNamespace(**{name: name for name in names})
        self.stream = SimpleNamespace(infrared="infrared", depth="depth")
        self.format = SimpleNamespace(y8="y8", z16="z16")
        self.camera_info = SimpleNamespace(name="name")
        self.sensor = self.pipeline_profile = object
        self.options = {"exposure": 8500.0, "gain": 16.0, "laser_power": 150.0}

    def config(self) -> SimpleNamespace:
        return SimpleNamespace(enable_stream=lambda *requested: None)

    def pipeline(self) -> SimpleNamespace:
        device = SimpleNamespace(
            first_depth_sensor=lambda: SimpleNamespace(
                set_option=self.options.__setitem__,
                get_option=self.options.__getitem__,
                get_depth_scale=lambda: 0.001,
            ),
            get_info=lambda name: "Intel RealSense D415",
        )
        pinhole = SimpleNamespace(fx=910.2, fy=910.2, ppx=640.9, ppy=361.1)
        video = SimpleNamespace(get_intrinsics=lambda: pinhole)
        stream = SimpleNamespace(
            as_video_stream_profile=lambda: video,
            get_extrinsics_to=lambda second: SimpleNamespace(translation=(-0.055, 0.0, 0.0)),
        )
        profile = SimpleNamespace(get_device=lambda: device, get_stream=lambda *requested: stream)
        return SimpleNamespace(
            start=lambda config: profile, wait_for_frames=self._frames, stop=lambda: None
        )

    def _frames(self) -> SimpleNamespace:
        level = 10 * self.options["emitter_enabled"]
        return SimpleNamespace(
            get_infrared_frame=lambda side: _image(np.uint8(level + side)),
            get_depth_frame=lambda: _image(np.uint16(1500)),
        )


def _image(value: np.generic) -> SimpleNamespace:
    return SimpleNamespace(get_data=lambda: np.full((720, 1280), value))
