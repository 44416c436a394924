"""The input files nominal.json and light.npz, and the light of the surfaces."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from starling.diagnosis.validation.camera import light as light_file
from starling.diagnosis.validation.camera import nominal
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.errors import WithheldError
from starling.diagnosis.validation.camera.light import ReceivedLight, SceneLight
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
        ("left_up", np.full(3, 1e200), "left_up must be three numbers with a length"),
        ("left_up", np.full(3, np.longdouble("1e4000")), "left_up must be three numbers"),
        ("left_depth_m", np.zeros((64, 96)), "left_depth_m must be > 0, or NaN"),
        ("right_depth_m", np.full((64, 96), np.inf), "right_depth_m must be > 0, or NaN"),
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


def _leave(
    light: SceneLight, camera: Nominal, side: str = "left", **values: float
) -> ReceivedLight:
    strengths = Strengths(nominal=camera, values=values)
    return light_file.leave(light.view(side), strengths)


def test_ambient_light_is_per_watt(light: SceneLight, camera: Nominal) -> None:
    received = _leave(light, camera, ambient=2.0)
    np.testing.assert_allclose(received.rest_e, 2.0 * light.left.ambient_e)
    assert not _leave(light, camera, ambient=0.0).rest_e.any()


def test_normals_of_a_leaning_wall(light: SceneLight, camera: Nominal) -> None:
    """Rationale: 1 / z = 1 + 0.4 y / z is the plane z + 0.4 y = 1 with normal (0, -0.4, -1)."""
    up = light_file.facing_up(light.left, camera)
    wall, box = light.left.body == 1, light.left.body == 2
    np.testing.assert_allclose(up[wall], 0.4 / np.hypot(0.4, 1.0), rtol=1e-6)
    np.testing.assert_allclose(up[box], 0.0, atol=1e-9)
    assert not up[light.left.body == 0].any()


def test_no_surface_has_no_normal(light: SceneLight, camera: Nominal) -> None:
    sky = dataclasses.replace(light.left, body=np.zeros(camera.shape, np.uint32))
    assert not light_file.facing_up(sky, camera).any()


@pytest.mark.parametrize("gradient", [0.0, 0.6, 1.0])
@pytest.mark.parametrize("rendered", [0.0, 0.5])
def test_gradient_follows_the_normal(
    gradient: float, rendered: float, light: SceneLight, camera: Nominal
) -> None:
    """Law: the light scales by 1 + 2/3 g n . up over the same term of the rendered gradient."""
    nominal_camera = dataclasses.replace(camera, ambient_gradient=rendered)
    wall, box = light.left.body == 1, light.left.body == 2

    def law(up: float) -> float:
        return (1.0 + 2.0 / 3.0 * gradient * up) / (1.0 + 2.0 / 3.0 * rendered * up)

    as_is = _leave(light, nominal_camera).rest_e
    tilted = _leave(light, nominal_camera, ambient_gradient=gradient).rest_e
    np.testing.assert_allclose(tilted[wall], as_is[wall] * law(0.4 / np.hypot(0.4, 1.0)), rtol=1e-6)
    np.testing.assert_allclose(tilted[box], as_is[box], rtol=1e-9)
    leaning = dataclasses.replace(light.left, up=np.array([0.0, 0.0, -1.0]))
    towards = dataclasses.replace(light, left=leaning)
    tilted = _leave(towards, nominal_camera, ambient_gradient=gradient).rest_e
    np.testing.assert_allclose(tilted[box], as_is[box] * law(1.0), rtol=1e-6)


def test_the_rendered_gradient_is_the_identity(light: SceneLight, camera: Nominal) -> None:
    for g0 in (0.0, 0.3, 0.5):
        nominal_camera = dataclasses.replace(camera, ambient_gradient=g0)
        for side in ("left", "right"):
            same = _leave(light, nominal_camera, side, ambient_gradient=g0).rest_e
            np.testing.assert_array_equal(same, camera.ambient_w_m2 * light.view(side).ambient_e)


def test_second_projector_and_exposure_scale_the_light(light: SceneLight, camera: Nominal) -> None:
    plain = _leave(light, camera)
    more = _leave(light, camera, second_projector=0.2)
    np.testing.assert_allclose(more.rest_e - plain.rest_e, 0.2 * light.left.other_e, atol=1e-9)
    longer = _leave(light, camera, exposure=0.03)
    np.testing.assert_allclose(longer.laser_e, 3.0 * plain.laser_e)
    np.testing.assert_allclose(longer.rest_e, 3.0 * plain.rest_e)


@pytest.mark.parametrize("depth_m", [0.5, 1.0])
def test_subsurface_scattering_has_a_metric_width(
    depth_m: float, light: SceneLight, camera: Nominal
) -> None:
    """Law: the variance in pixels is (fx sigma / z)^2, so near bodies blur more."""
    laser = np.zeros(camera.shape)
    laser[31, 47] = 100.0
    view = dataclasses.replace(
        light.left,
        laser_e=laser,
        even_e=np.ones(camera.shape),
        depth_m=np.full(camera.shape, depth_m),
        body=np.ones(camera.shape, np.uint32),
        px=np.zeros(camera.shape),
    )
    values = {"subsurface": 0.01}
    out = light_file.leave(view, Strengths(nominal=camera, values=values)).laser_e
    offset = np.arange(camera.width) - 47
    variance = (out.sum(0) * offset**2).sum() / out.sum()
    assert variance == pytest.approx((120 * 0.01 / depth_m) ** 2, rel=0.03)


def test_subsurface_scattering_stays_within_the_body(light: SceneLight, camera: Nominal) -> None:
    box = light.left.body == 2
    only_box = dataclasses.replace(light.left, laser_e=np.where(box, light.left.laser_e, 0.0))
    both = SceneLight(left=only_box, right=light.right)
    out = _leave(both, camera, subsurface=0.005).laser_e
    assert not out[~box].any()
    assert out[box].std() < only_box.laser_e[box].std()
