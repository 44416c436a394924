"""Diffusion as a completion method."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

pytest.importorskip("diffusers", reason="the extra completion is not installed")

from starling.learning.completion.diffusion import VARIANTS, model, span, weights
from starling.learning.completion.diffusion.method import Diffusion, load
from starling.learning.completion.diffusion.sampling import sample
from starling.learning.completion.diffusion.span import Span, network_input
from starling.learning.completion.method import complete
from starling.patterns.errors import InputError
from tests.unit.learning.completion import tiny_diffusion

FRAME = tiny_diffusion.frame()


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_diffusion.write(tmp_path_factory.mktemp("weights"))


@pytest.fixture(scope="module")
def untrained(published: Path) -> model.DiffusionModel:
    return model.untrained_model(weights.load(published), "rgbd", seed=0)


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_frame_of_any_size_is_completed_in_metres(published: Path, variant: Any) -> None:
    built = model.untrained_model(weights.load(published), variant, seed=0)
    method = Diffusion(model=built, steps=2)
    assert method.name == f"diffusion-{variant}"
    result = complete(method, FRAME.rgb, FRAME.depth_m, FRAME.valid)
    assert result.depth_m.shape == result.sigma_m.shape == (13, 18)
    assert np.isfinite(result.depth_m).all() and np.isnan(result.sigma_m).all()


def test_the_seed_determines_the_sample(untrained: model.DiffusionModel) -> None:
    first, again = (Diffusion(model=untrained, steps=3, seed=5).fill(FRAME) for _ in range(2))
    np.testing.assert_array_equal(first.depth_m, again.depth_m)
    second = Diffusion(model=untrained, steps=3, seed=6).fill(FRAME)
    assert not np.allclose(second.depth_m, first.depth_m)


def test_several_samples_give_mean_and_standard_deviation(untrained: model.DiffusionModel) -> None:
    seen = network_input([FRAME], multiple=untrained.multiple, device=torch.device("cpu"))
    drawn = np.stack(
        [
            Span.from_frame(FRAME).decode(depth[0, :13, :18].numpy())
            for depth in sample(untrained, seen, steps=2, seed=0, count=3)
        ]
    )
    result = Diffusion(model=untrained, steps=2, count=3).fill(FRAME)
    np.testing.assert_allclose(result.depth_m, drawn.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(result.sigma_m, drawn.std(axis=0, ddof=1), rtol=1e-4)
    assert (result.sigma_m > 0).all()


def test_inference_mode_is_off_between_samples(untrained: model.DiffusionModel) -> None:
    seen = network_input([FRAME], multiple=untrained.multiple, device=torch.device("cpu"))
    for depth in sample(untrained, seen, steps=1, seed=0, count=2):
        assert depth.is_inference() and not torch.is_inference_mode_enabled()


class _IdealNetwork:
    """An ideal network that knows the latents of the depth and predicts the exact noise."""

    variant = "rgbd"
    networks = torch.nn.ModuleDict({"unet": tiny_diffusion.unet()})

    def __init__(self, clean: torch.Tensor, remaining: torch.Tensor) -> None:
        self.clean, self.kept = clean, remaining

    def condition(self, seen: Any, vae: Any) -> torch.Tensor:
        return self.clean

    def noise(self, noisy: Any, step: Any, condition: Any, text: Any) -> torch.Tensor:
        remaining = self.kept[step[0]]
        return (noisy - remaining.sqrt() * self.clean) / (1 - remaining).sqrt()


@pytest.mark.parametrize("steps", [1, 7])
def test_an_ideal_network_recovers_the_depth(untrained: model.DiffusionModel, steps: int) -> None:
    """Steps, scales and decoding are consistent for any initial noise."""
    clean = torch.randn(1, 4, 8, 10, generator=torch.Generator().manual_seed(2))
    knows: Any = _IdealNetwork(clean, untrained.scheduler.alphas_cumprod)
    ideal = dataclasses.replace(untrained, conditioning=knows)
    seen = network_input([FRAME], multiple=4, device=torch.device("cpu"))
    (depth,) = sample(ideal, seen, steps=steps, seed=0, count=1)
    with torch.no_grad():
        expected = span.decode_depth(untrained.vae, clean)
    torch.testing.assert_close(depth, expected, rtol=1e-3, atol=1e-3)


def test_sampling_starts_at_almost_pure_noise(untrained: model.DiffusionModel) -> None:
    requests: list[int] = []
    unet: Any = untrained.conditioning.networks["unet"]
    handle = unet.register_forward_pre_hook(lambda _, inputs: requests.append(int(inputs[1])))
    Diffusion(model=untrained, steps=4).fill(FRAME)
    handle.remove()
    assert requests == [999, 749, 499, 249]


def test_weights_not_trained_for_completion_are_refused(published: Path) -> None:
    with pytest.raises(InputError, match=r"^weights must be trained for completion, with 12 or 13"):
        load(published)


def test_errors_of_trained_weights_name_the_training_command(
    tmp_path: Path, published: Path
) -> None:
    advice = r"Run starling train completion CAPTURES --start WEIGHTS --out OUT; give OUT/weights"
    with pytest.raises(InputError, match=rf"must be a folder that exists; got typo\. {advice}\.$"):
        load("typo")
    with pytest.raises(InputError, match=rf"weights must hold unet/; got .*\. {advice} whole\.$"):
        load(tmp_path)


def test_settings_refused(untrained: model.DiffusionModel) -> None:
    with pytest.raises(InputError, match=r"^steps must be in \[1, 1000\]; got 0\. "):
        Diffusion(model=untrained, steps=0)
    with pytest.raises(InputError, match=r"^count must be in \[1, 1000\]; got 0\. "):
        Diffusion(model=untrained, count=0)
