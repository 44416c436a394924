"""Conditioning of pretrained networks."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
import torch

pytest.importorskip("diffusers", reason="the extra completion is not installed")

from diffusers import UNet2DConditionModel

from starling.learning.completion.diffusion import VARIANTS, Variant, weights
from starling.learning.completion.diffusion.conditioning import (
    adapt_generator,
    trainable_parameters,
    trained_conditioning,
    widen,
)
from starling.learning.completion.diffusion.model import DiffusionModel, untrained_model
from starling.learning.completion.diffusion.span import network_input
from starling.patterns.errors import InputError
from tests.unit.learning.completion import tiny_diffusion

STEP = torch.tensor([500, 20])
TEXT = torch.rand(1, 2, 12, generator=torch.Generator().manual_seed(1)).expand(2, -1, -1)


def _random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def _predict(network: Any, noisy: torch.Tensor) -> torch.Tensor:
    with torch.no_grad():
        return network(noisy, STEP, encoder_hidden_states=TEXT, return_dict=False)[0]


@pytest.mark.parametrize("further", [0, 1])
def test_the_first_layer_repeats_a_third_of_the_pretrained_weights(further: int) -> None:
    network, old = tiny_diffusion.unet(), tiny_diffusion.unet().conv_in
    widen(network, copies=3, further=further)
    new = network.conv_in
    for number in range(3):
        block = new.weight[:, 4 * number : 4 * number + 4]
        assert torch.equal(block, old.weight / 3)
    assert torch.equal(new.weight[:, 12:], torch.zeros(8, further, 3, 3))
    assert torch.equal(new.bias, old.bias)
    assert network.config["in_channels"] == 12 + further


def test_equal_latents_give_the_pretrained_prediction() -> None:
    """The mask channel has no effect before training."""
    noisy = _random(2, 4, 8, 8)
    before = _predict(tiny_diffusion.unet(), noisy)
    network = tiny_diffusion.unet()
    widen(network, copies=3, further=1)
    after = _predict(network, torch.cat([noisy, noisy, noisy, _random(2, 1, 8, 8)], dim=1))
    torch.testing.assert_close(after, before, rtol=1e-4, atol=1e-5)
    assert before.std() > 0.01


def test_a_widened_network_can_be_saved_and_loaded(tmp_path: Path) -> None:
    network = tiny_diffusion.unet()
    widen(network, copies=3, further=1)
    network.save_pretrained(tmp_path)
    read: Any = UNet2DConditionModel.from_pretrained(tmp_path, low_cpu_mem_usage=False)
    noisy = _random(2, 13, 8, 8)
    assert torch.equal(_predict(read.eval(), noisy), _predict(network, noisy))


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_diffusion.write(tmp_path_factory.mktemp("weights"))


def _begun(published: Path, variant: Variant) -> DiffusionModel:
    return untrained_model(weights.load(published), variant, seed=0)


def _noise(model: DiffusionModel, frames: Any, noisy: torch.Tensor) -> torch.Tensor:
    seen = network_input(frames, multiple=model.multiple, device=torch.device("cpu"))
    with torch.no_grad():
        condition = model.conditioning.condition(seen, model.vae)
        return model.conditioning.noise(noisy, STEP, condition, TEXT)


def _frames() -> list[Any]:
    return [tiny_diffusion.frame((16, 16), seed) for seed in range(2)]


@pytest.mark.parametrize("variant", VARIANTS)
def test_all_variants_predict_noise(published: Path, variant: Variant) -> None:
    model = _begun(published, variant)
    assert model.multiple == 4 and model.conditioning.variant == variant
    assert _noise(model, _frames(), _random(2, 4, 8, 8)).shape == (2, 4, 8, 8)


def test_latents_are_in_the_order_of_the_paper(published: Path) -> None:
    """Image, sensor depth, noise, then the mask."""
    model = _begun(published, "rgbd-mask")
    seen = network_input(_frames(), multiple=4, device=torch.device("cpu"))
    report: list[torch.Tensor] = []
    unet: Any = model.conditioning.networks["unet"]
    unet.register_forward_pre_hook(lambda _, inputs: report.append(inputs[0]))
    noisy = _random(2, 4, 8, 8)
    _noise(model, _frames(), noisy)
    with torch.no_grad():
        image = model.vae.encode(seen.image).latent_dist.mode() * model.vae.config["scaling_factor"]
    assert torch.equal(report[0][:, :4], image)
    assert torch.equal(report[0][:, 8:12], noisy)
    assert report[0][:, 12].unique().tolist() == [0, 1]


def test_the_mask_has_no_effect_before_training(published: Path) -> None:
    noisy = _random(2, 4, 8, 8)
    plain, masked = (
        _noise(_begun(published, variant), _frames(), noisy) for variant in ("rgbd", "rgbd-mask")
    )
    torch.testing.assert_close(masked, plain, rtol=1e-5, atol=1e-6)


def test_controlnet_has_no_effect_before_training(published: Path) -> None:
    """Its outputs pass convolutions of zeros."""
    noisy = _random(2, 4, 8, 8)
    controlled = _noise(_begun(published, "controlnet"), _frames(), noisy)
    torch.testing.assert_close(
        controlled, _predict(tiny_diffusion.unet(), noisy), rtol=1e-5, atol=1e-6
    )


def test_the_condition_has_an_effect(published: Path) -> None:
    for variant in VARIANTS:
        model = _begun(published, variant)
        with torch.no_grad():
            for value in trainable_parameters(model.conditioning):
                value += 0.1 * _random(*value.shape)  # No longer zero.
        noisy, frames = _random(2, 4, 8, 8), _frames()
        before = _noise(model, frames, noisy)
        frames[0].rgb[:] = 1 - frames[0].rgb
        painted = _noise(model, frames, noisy)
        frames[0].depth_m[:, :4] += 0.5
        moved = _noise(model, frames, noisy)
        for second in (painted, moved):
            assert not torch.allclose(second[0], before[0], atol=1e-4), variant
            before = second


def test_controlnet_trains_the_decoder_only(published: Path) -> None:
    conditioning = _begun(published, "controlnet").conditioning
    learns = {
        name for name, value in conditioning.networks.named_parameters() if value.requires_grad
    }
    parts = {".".join(name.split(".")[:2]) for name in learns}
    assert {part for part in parts if part.startswith("unet")} == {
        "unet.up_blocks",
        "unet.conv_norm_out",
        "unet.conv_out",
    }
    controlnet = conditioning.networks["controlnet"]
    inside = {name for name, _ in controlnet.named_parameters("controlnet")}
    assert inside <= learns


def test_concatenation_trains_everything_but_the_autoencoder(published: Path) -> None:
    model = _begun(published, "rgbd")
    assert len(trainable_parameters(model.conditioning)) == len(
        list(tiny_diffusion.unet().parameters())
    )
    assert not any(value.requires_grad for value in model.vae.parameters())


def test_the_seed_determines_the_initial_controlnet(published: Path) -> None:
    first, second = (_begun(published, "controlnet").conditioning.networks for _ in range(2))
    values = copy.deepcopy(second.state_dict())
    for name, value in first.state_dict().items():
        assert torch.equal(values[name], value), name


def test_refused(published: Path, tmp_path: Path) -> None:
    wrong: Any = "rgb"
    with pytest.raises(InputError, match=r"^variant must be a known name; got 'rgb'\. "):
        adapt_generator(weights.load(published), wrong, seed=0)
    wide = weights.load(tiny_diffusion.write(tmp_path, network=tiny_diffusion.unet(in_channels=12)))
    with pytest.raises(InputError, match=r"^weights must be of a text-to-image model with 4 "):
        adapt_generator(wide, "rgbd", seed=0)
    with pytest.raises(InputError, match=r"^weights must be trained for completion, with 12 or 13"):
        trained_conditioning(weights.load(published))
