"""The two input files: nominal.json and light.npz."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from starling.diagnosis.validation.camera import light as light_file
from starling.diagnosis.validation.camera import nominal
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.light import SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal


def _edit(folder: Path, **changes: object) -> Path:
    path = folder / "nominal.json"
    table = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps({k: v for k, v in table.items() if v != "gone"}))
    return path


def test_a_written_file_is_read(light_set: Path, camera: Nominal) -> None:
    read = nominal.read(light_set / "nominal.json")
    assert read == camera
    assert read.shape == (64, 96)
    assert read.focal_baseline_px_m == pytest.approx(6.0)
    assert read.radius().max() == pytest.approx(math.hypot(47.5, 31.5) / math.hypot(48, 32), 0.02)


def test_optional_keys_may_be_missing(light_set: Path) -> None:
    names = ("quantum_efficiency", "pixel_pitch_m", "f_number", "wavelength_nm")
    gone = dict.fromkeys(names, "gone")
    assert nominal.read(_edit(light_set, **gone)).f_number is None


def test_a_projector_left_of_the_left_imager_is_read(light_set: Path) -> None:
    assert nominal.read(_edit(light_set, projector_x_m=-0.03)).projector_x_m == -0.03


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"width": "gone"}, "nominal.json must have the key width; got"),
        ({"gain": 0}, "gain must be > 0; got 0"),
        ({"read_noise_e": -1.0}, "read_noise_e must be >= 0; got -1.0"),
        ({"projector_x_m": math.inf}, "projector_x_m must be finite; got inf"),
        ({"gain": True}, "gain must be a number; got True"),
        ({"power_w": "a lot"}, "power_w must be a number; got 'a lot'"),
    ],
)
def test_refused_tables(changes: dict[str, object], words: str, light_set: Path) -> None:
    with pytest.raises(WithheldError, match="^" + words.replace("(", r"\(")) as caught:
        nominal.read(_edit(light_set, **changes))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["{", "[1, 2]"])
def test_refused_files(text: str, tmp_path: Path) -> None:
    path = tmp_path / "nominal.json"
    path.write_text(text)
    with pytest.raises(WithheldError, match=r"nominal\.json must be"):
        nominal.read(path)
    with pytest.raises(WithheldError, match="readable"):
        nominal.read(tmp_path / "none.json")


def test_light_is_read_as_written(light_set: Path, light: SceneLight, camera: Nominal) -> None:
    back = light_file.read(light_set / "a" / "light.npz", camera.shape)
    np.testing.assert_allclose(back.left.laser_e, light.left.laser_e, rtol=1e-6)
    np.testing.assert_array_equal(back.right.body, light.right.body)
    assert back.view("right") is back.right


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("left_px", None, "light.npz must hold left_px"),
        ("right_body", np.zeros((3, 3), np.uint32), "right_body must be of shape"),
        ("left_even_e", np.full((64, 96), np.nan, np.float32), "left_even_e must be finite"),
        ("left_laser_e", np.full((64, 96), -1.0, np.float32), "left_laser_e must be finite"),
        ("right_up", None, "light.npz must hold right_up"),
        ("left_up", np.zeros(3), "left_up must be three numbers with a length"),
    ],
)
def test_refused_light(
    name: str, value: np.ndarray | None, words: str, light_set: Path, camera: Nominal
) -> None:
    path = light_set / "a" / "light.npz"
    with np.load(path) as arrays:
        stored = {key: arrays[key] for key in arrays.files if key != name}
    if value is not None:
        stored[name] = value
    np.savez(path, **stored)
    with pytest.raises(WithheldError, match=words):
        light_file.read(path, camera.shape)


def test_damaged_light(tmp_path: Path) -> None:
    path = tmp_path / "light.npz"
    path.write_bytes(b"PK\x03\x04 damaged")
    for damaged in (path, tmp_path / "none.npz"):
        with pytest.raises(WithheldError, match="readable archive"):
            light_file.read(damaged, (4, 4))
