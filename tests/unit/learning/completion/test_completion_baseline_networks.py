"""Published networks as completion methods, with tiny random weights."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

pytest.importorskip("diffusers", reason="the extra completion is not installed")

from transformers import DepthAnythingConfig, DepthAnythingForDepthEstimation, Dinov2Config

from starling.learning.completion.baselines import depth_anything, marigold, marigold_dc
from starling.learning.completion.method import complete, make_frame
from starling.patterns.errors import InputError
from tests.unit.learning.completion import tiny_diffusion

FRAME = tiny_diffusion.frame()


@pytest.fixture(scope="module")
def two_latents(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("marigold")
    return tiny_diffusion.write(
        folder, network=tiny_diffusion.unet(in_channels=8), prediction_type="v_prediction"
    )


def _depth_anything(folder: Path, kind: str = "relative") -> Path:
    encoder = Dinov2Config(
        image_size=28,
        patch_size=14,
        hidden_size=8,
        num_hidden_layers=4,
        num_attention_heads=2,
        mlp_ratio=2,
        out_indices=[1, 2, 3, 4],
        apply_layernorm=True,
        reshape_hidden_states=False,
    )
    config = DepthAnythingConfig(
        backbone_config=encoder,
        reassemble_hidden_size=8,
        neck_hidden_sizes=[4, 4, 8, 8],
        fusion_hidden_size=8,
        head_in_index=-1,
        head_hidden_size=4,
        depth_estimation_type=kind,
        max_depth=20,
    )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(3)
        network = DepthAnythingForDepthEstimation(config)
        # Default initial weights are so small that the output is 0.
        for values in network.parameters():
            torch.nn.init.normal_(values, std=0.3)
    network.save_pretrained(folder)
    return folder


def _marigold(folder: Path, *, count: int) -> marigold.Marigold:
    read = dataclasses.replace(marigold.load(folder), steps=1, count=count)
    return dataclasses.replace(read, longest_px=24)


def test_marigold_is_aligned_to_the_sensor(two_latents: Path) -> None:
    method = _marigold(two_latents, count=1)
    assert method.name == "marigold"
    result = complete(method, FRAME.rgb, FRAME.depth_m, FRAME.valid)
    residual = (result.depth_m - FRAME.depth_m)[FRAME.valid]
    assert abs(residual.mean()) < 1e-3  # A property of least squares with a shift.
    assert residual.std() <= FRAME.depth_m[FRAME.valid].std()
    assert np.isfinite(result.depth_m).all() and np.isnan(result.sigma_m).all()


def test_marigold_spread_is_in_metres(two_latents: Path) -> None:
    """A scene three times as far has three times the spread."""
    method = _marigold(two_latents, count=3)
    result = method.fill(FRAME)
    far = method.fill(dataclasses.replace(FRAME, depth_m=3 * FRAME.depth_m))
    assert (result.sigma_m >= 0).all() and result.sigma_m.max() > 0
    np.testing.assert_allclose(far.depth_m, 3 * result.depth_m, rtol=1e-4)
    np.testing.assert_allclose(far.sigma_m, 3 * result.sigma_m, rtol=1e-4)


def test_depth_anything_is_aligned_in_inverse_depth(tmp_path: Path) -> None:
    method = depth_anything.load(_depth_anything(tmp_path))
    assert method.name == "depth-anything"
    method = dataclasses.replace(method, shortest_px=28)
    result = complete(method, FRAME.rgb, FRAME.depth_m, FRAME.valid)
    residual = (1 / result.depth_m - 1 / FRAME.depth_m)[FRAME.valid]
    assert abs(residual.mean()) < 1e-3 and residual.std() <= (1 / FRAME.depth_m[FRAME.valid]).std()
    assert result.depth_m.shape == (13, 18) and np.isnan(result.sigma_m).all()


class _RedChannel:
    """A network that returns the red channel of its input."""

    class config:
        patch_size = 14

    device = torch.device("cpu")

    def __init__(self) -> None:
        self.sizes: list[tuple[int, ...]] = []

    def __call__(self, pixel_values: torch.Tensor) -> Any:
        self.sizes.append(tuple(pixel_values.shape))
        self.predicted_depth = pixel_values[:, 0]
        return self


@pytest.mark.parametrize("nearest_m", [0.5, 20.0])
def test_depth_anything_is_exact_where_the_network_is(nearest_m: float) -> None:
    """Inverse depth in the red channel is recovered, with the published input size.

    Street depth, beyond a limit for rooms, is recovered as well.
    """
    depth = nearest_m * np.linspace(1, 8, 64, dtype=np.float32)[None].repeat(48, 0)
    red = (nearest_m / depth) / 2 + 0.2
    valid = np.ones_like(depth, bool)
    valid[10:30, 20:40] = False
    frame = make_frame(np.repeat(red[..., None], 3, 2), depth, valid)
    network = _RedChannel()
    result = depth_anything.DepthAnything(network=network).fill(frame)
    assert network.sizes == [(1, 3, 518, 686)]
    middle = float(network.predicted_depth[0, 250, 343])
    # The training normalisation.
    assert abs(middle * 0.229 + 0.485 - float(red[24, 31:33].mean())) < 1e-3
    np.testing.assert_allclose(result.depth_m[:, 2:-2], depth[:, 2:-2], rtol=0.01)


def _guided(folder: Path, steps: int) -> marigold_dc.MarigoldDC:
    return dataclasses.replace(marigold_dc.load(folder), steps=steps, longest_px=24)


def test_guidance_reduces_the_error(two_latents: Path) -> None:
    """An untrained network alone is far off; more guidance steps reduce the error."""
    errors = []
    for steps in (2, 40):
        method = _guided(two_latents, steps)
        assert method.name == "marigold-dc"
        result = complete(method, FRAME.rgb, FRAME.depth_m, FRAME.valid)
        errors.append(np.abs(result.depth_m - FRAME.depth_m)[FRAME.valid].mean())
    assert errors[1] < 0.8 * errors[0], errors


def test_guidance_uses_valid_pixels_only(two_latents: Path) -> None:
    """Values in holes have no effect, and a changed valid pixel has one."""
    method = _guided(two_latents, 3)
    first = complete(method, FRAME.rgb, FRAME.depth_m, FRAME.valid).depth_m
    filled = np.where(FRAME.valid, FRAME.depth_m, 55)
    np.testing.assert_array_equal(complete(method, FRAME.rgb, filled, FRAME.valid).depth_m, first)
    moved = FRAME.depth_m.copy()
    moved[0, 0] += 0.3
    assert not np.array_equal(complete(method, FRAME.rgb, moved, FRAME.valid).depth_m, first)


def test_guided_depth_starts_in_the_range_of_the_sensor(two_latents: Path) -> None:
    """Equation 2 with s = t = 1, before Adam has changed them by more than one step of 0.005.

    The decoder returns only the nearest and the farthest depth.
    """
    method = _guided(two_latents, 1)
    with torch.no_grad():
        method.vae.decoder.get_parameter("conv_out.weight").mul_(1e6)
    result = method.fill(FRAME).depth_m
    known = FRAME.depth_m[FRAME.valid]
    np.testing.assert_allclose([result.min(), result.max()], [known.min(), known.max()], rtol=0.02)


def test_every_gradient_is_rescaled(two_latents: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    remaining: list[float] = []

    def lengthen(latent: Any, clean: Any, share: torch.Tensor) -> None:
        remaining.append(float(share))

    monkeypatch.setattr(marigold_dc, "_lengthen", lengthen)
    _guided(two_latents, 4).fill(FRAME)
    assert len(remaining) == 4 and remaining == sorted(remaining)  # The noise decreases.


def test_the_gradient_is_as_long_as_the_noise_in_the_latent() -> None:
    latent = torch.nn.Parameter(torch.randn(1, 4, 8, 8))
    clean, remaining = torch.randn(1, 4, 8, 8), torch.tensor(0.3)
    noise = torch.randn(1, 4, 8, 8)
    latent.data = remaining.sqrt() * clean + (1 - remaining).sqrt() * noise
    latent.grad = torch.randn(1, 4, 8, 8)
    direction = latent.grad / latent.grad.norm()
    marigold_dc._lengthen(latent, clean, remaining)
    torch.testing.assert_close(latent.grad, direction * noise.norm())


def test_weights_refused(two_latents: Path, tmp_path: Path) -> None:
    none = tmp_path / "none"
    for load, published in (
        (marigold.load, marigold.PUBLISHED),
        (marigold_dc.load, marigold.PUBLISHED),
        (depth_anything.load, depth_anything.PUBLISHED),
    ):
        with pytest.raises(InputError) as error:
            load(none)
        assert str(error.value).startswith("weights must be a folder that exists; got ")
        assert f"hf download {published} --local-dir DIR" in str(error.value)
    plain = tiny_diffusion.write(tmp_path / "plain")
    with pytest.raises(
        InputError, match=r"^weights must be Marigold's, with 8 input channels; got 4"
    ):
        marigold_dc.load(plain)
    with pytest.raises(InputError, match=r"^weights must be readable as DepthAnything"):
        depth_anything.load(two_latents)
    metric = _depth_anything(tmp_path / "metric", kind="metric")
    with pytest.raises(InputError, match=r"^weights must predict relative depth; got metric in "):
        depth_anything.load(metric)


def test_settings_refused() -> None:
    nothing: Any = None
    for make, named in (
        (marigold.Marigold, {"pipeline": nothing}),
        (marigold_dc.MarigoldDC, dict.fromkeys(("unet", "vae", "scheduler", "text"), nothing)),
    ):
        for name in ("steps", "longest_px"):
            with pytest.raises(InputError, match=rf"^{name} must be in \["):
                make(**named, **{name: 0})
    with pytest.raises(InputError, match=r"^count must be in \["):
        marigold.Marigold(pipeline=nothing, count=0)
    with pytest.raises(InputError, match=r"^shortest_px must be in \["):
        depth_anything.DepthAnything(network=nothing, shortest_px=0)
