"""Arrays of a batch: kinds, devices, and all refusals."""

from __future__ import annotations

import builtins
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from starling.patterns.errors import InputError
from starling.sim.batch import handoff
from starling.sim.corrupt import Corruptor
from tests.unit.sim.batch import steps

wp: Any = pytest.importorskip("warp", reason="warp-lang is not installed")

DEPTH = np.repeat(steps.depth_image()[None], 2, axis=0)


def corruptor(*changes: str, effects: dict[str, Any] | None = None) -> Corruptor:
    return Corruptor(steps.sensor(*changes), steps.MATRIX, effects=effects or {})


def test_tensors_return_tensors() -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed")
    depth = torch.tensor(DEPTH, requires_grad=True)
    seen = corruptor().batch(depth, reflectance=torch.full(DEPTH.shape, 0.5), seed=1)
    expected = corruptor().batch(wp.array(DEPTH), reflectance=0.5, seed=1)
    types = dict.fromkeys(("depth_m", "exposure_s", "gain"), torch.float32)
    for name in ("depth_m", "reason", "ir_left", "ir_right", "exposure_s", "gain"):
        image = getattr(seen, name)
        assert image.dtype == types.get(name, torch.uint8)
        assert image.device == depth.device
        image_warp = getattr(expected, name).numpy()
        assert np.array_equal(image.numpy(), image_warp, equal_nan=image_warp.dtype.kind == "f")


@pytest.mark.parametrize(
    "name", ["reflectance", "ambient_lux", "up", "right_depth_m", "projector_depth_m"]
)
def test_arrays_on_another_device_are_refused(name: str) -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed")
    elsewhere = torch.empty(DEPTH.shape, device="meta")
    with pytest.raises(InputError, match=f"{name} must be on cpu, as the depth; got meta. Copy"):
        corruptor().batch(torch.tensor(DEPTH), **{name: elsewhere})


def test_tensors_with_a_lazy_sign_are_read_as_they_are() -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed")
    behind = torch._neg_view(torch.tensor(DEPTH))
    assert np.array_equal(handoff.as_warp("depth", behind).numpy(), -DEPTH, equal_nan=True)


def test_tensors_without_a_warp_array_are_refused() -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed")
    depth = torch.tensor(DEPTH)
    tensors = {
        "a single number": depth[0, 0, 0],
        "torch.sparse_coo": depth.to_sparse(),
        "torch.complex64": depth.to(torch.complex64),
        "on meta": depth.to("meta"),
    }
    for got, tensor in tensors.items():
        with pytest.raises(InputError, match=f"depth must be a dense tensor .*; got .*{got}"):
            handoff.as_warp("depth", tensor)
    with pytest.raises(InputError, match="depth must be a torch tensor or a Warp array; got Size"):
        handoff.as_warp("depth", depth.shape)


def test_arrays_of_another_type_are_to_be_converted() -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed")
    depth = torch.tensor(DEPTH)
    message = r"must be .*; got \(2, 120, 160\) float(64|16). Convert it to float32"
    for wrong in (depth.double(), depth.half()):
        with pytest.raises(InputError, match=f"^depth {message}"):
            corruptor().batch(wrong)
        for name in ("reflectance", "right_depth_m"):
            with pytest.raises(InputError, match=f"^{name} {message}"):
                corruptor().batch(depth, **{name: wrong})


def test_arrays_need_no_torch() -> None:
    code = (
        "import sys, numpy as np; from starling import Corruptor, load_sensor\n"
        "matrix = np.array([[40, 0, 19.5], [0, 40, 15.5], [0, 0, 1]])\n"
        "sensor = load_sensor('d435', camera_matrix=matrix, size=(40, 32))\n"
        "from starling.sim.batch import reading, handoff\n"
        "depth = handoff.import_warp().array(np.ones((1, 32, 40), np.float32))\n"
        "reading.admit(depth, sensor, matrix)\n"
        "print('torch' in sys.modules)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"depth": DEPTH}, "depth must be a torch tensor or a Warp array; got ndarray"),
        ({"depth": wp.array(DEPTH[0])}, r"depth must be \(environments, height, width\) float32"),
        ({"depth": wp.array(DEPTH, dtype=wp.float64)}, "depth must be .* float32.*got .*float64"),
        ({"depth": wp.array(DEPTH[:0])}, "depth must be .* at least one; got"),
        ({"depth": wp.array(DEPTH[:, :50])}, "shape and camera_matrix must be those of the sen"),
        ({"reflectance": wp.array(DEPTH[:1])}, r"reflectance must be \(2, 120, 160\) float32, or"),
        ({"reflectance": 1.5}, r"reflectance must be in \[0, 1\]"),
        ({"reflectance": DEPTH}, "reflectance must be a torch tensor or a Warp array"),
        ({"ambient_lux": -1.0}, r"ambient_lux must be in \[0, 150000\]"),
        ({"ambient_lux": wp.zeros(3)}, r"ambient_lux must be \(2,\) float32; got \(3,\) float32"),
        ({"up": (0, 0, 0)}, r"up must be a direction \(3,\)"),
        ({"up": wp.zeros((2, 2))}, r"up must be \(2, 3\) float32; got \(2, 2\) float32"),
        ({"right_depth_m": DEPTH}, "right_depth_m must be a torch tensor or a Warp array"),
        ({"right_depth_m": wp.array(DEPTH[:1])}, r"right_depth_m must be \(2, 120, 160\) float32"),
        (
            {"projector_depth_m": wp.array(DEPTH, dtype=wp.float64)},
            r"projector_depth_m must be .*64",
        ),
        ({"seed": -1}, "seed must be an integer"),
        ({"frame": 0.5}, "frame must be an integer"),
    ],
)
def test_refused_images(change: dict[str, Any], message: str) -> None:
    values: dict[str, Any] = {"depth": wp.array(DEPTH), **change}
    with pytest.raises(InputError, match=message):
        corruptor().batch(values.pop("depth"), **values)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("matcher.setting=fast", "matcher.engine must be CensusSemiGlobal in a batch; got Semi"),
        ("matcher.extended=true", "matcher.extended must be False in a batch; got True"),
        ("projector.flicker=0.1", "projector.flicker must be 0.0 in a batch; got 0.1"),
        ("post.decimation=2", "post.decimation must be 1 in a batch"),
        ("post.spatial_alpha=0.5", "post.spatial_alpha must be 1.0 in a batch"),
        ("post.temporal_alpha=0.5", "post.temporal_alpha must be 1.0 in a batch"),
        ("post.hole_filling=left", "post.hole_filling must be 'off' in a batch"),
        ("post.registered=true", "post.registered must be False in a batch"),
        ("left.blooming=0.5", "left.blooming must be 0.0 in a batch"),
        ("left.lens.spot_shape=-1", "left.lens.spot_shape must be 0.0 in a batch; got -1"),
        ("left.mosaic=rggb", "left.mosaic must be 'none' in a batch; got 'rggb'"),
        ("right.alignment.yaw_deg=0.1", "right.alignment must be Alignment.* in a batch"),
    ],
)
def test_refused_settings(change: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        corruptor(change).batch(wp.array(DEPTH))


def test_structured_light_is_refused() -> None:
    sensor = steps.sensor(name="kinect-v1")
    with pytest.raises(InputError, match="kind must be 'stereo' in a batch; got 'structured"):
        Corruptor(sensor, steps.MATRIX).batch(wp.array(DEPTH))


def test_a_residual_is_refused() -> None:
    residual: Any = lambda *arguments, **options: None  # noqa: E731
    with pytest.raises(InputError, match="residual must be None in a batch; got function"):
        Corruptor(steps.sensor(), steps.MATRIX, residual=residual).batch(wp.array(DEPTH))


def test_volumes_beyond_32_bits_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    from starling.sim.batch import refusals

    monkeypatch.setattr(refusals, "_LARGEST_VOLUME", 1000)
    with pytest.raises(InputError, match=r"matcher\.search_px must be <= 1000"):
        corruptor().batch(wp.array(DEPTH))


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def fail(name: str, *arguments: Any, **options: Any) -> Any:
        if name == "warp":
            raise ImportError(name)
        return real(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", fail)
    with pytest.raises(InputError, match=r"Corruptor.batch needs warp-lang; .*\[batch\]"):
        corruptor().batch(DEPTH)
