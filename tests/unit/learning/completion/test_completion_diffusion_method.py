"""Depth drawn from noise, as a method of completion."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

pytest.importorskip("diffusers", reason="the extra completion is not installed")

from starling.learning.completion.diffusion import latents, model, weights
from starling.learning.completion.diffusion.method import Diffusion, load
from starling.learning.completion.diffusion.sampling import sample
from starling.learning.completion.diffusion.seen import look
from starling.learning.completion.diffusion.span import Span
from starling.learning.completion.diffusion.variants import VARIANTS
from starling.learning.completion.method import complete
from starling.patterns.errors import InputError
from tests.unit.learning.completion import tiny_diffusion as tiny

FRAME = tiny.frame()


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.write(tmp_path_factory.mktemp("weights"))


@pytest.fixture(scope="module")
def made(published: Path) -> model.Model:
    return model.untrained(weights.load(published), "rgbd", seed=0)


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_frame_of_any_size_is_completed_in_metres(published: Path, variant: Any) -> None:
    made = model.untrained(weights.load(published), variant, seed=0)
    method = Diffusion(model=made, steps=2)
    assert method.name == f"diffusion-{variant}"
    found = complete(method, FRAME.rgb, FRAME.depth_m, FRAME.valid)
    assert found.depth_m.shape == found.sigma_m.shape == (13, 18)
    assert np.isfinite(found.depth_m).all() and np.isnan(found.sigma_m).all()


def test_the_same_seed_draws_the_same_and_another_does_not(made: model.Model) -> None:
    first, again = (Diffusion(model=made, steps=3, seed=5).fill(FRAME) for _ in range(2))
    np.testing.assert_array_equal(first.depth_m, again.depth_m)
    other = Diffusion(model=made, steps=3, seed=6).fill(FRAME)
    assert not np.allclose(other.depth_m, first.depth_m)


def test_several_draws_give_their_mean_and_spread(made: model.Model) -> None:
    seen = look([FRAME], multiple=made.multiple, where=torch.device("cpu"))
    drawn = np.stack(
        [
            Span.of(FRAME).metres(depth[0, :13, :18].numpy())
            for depth in sample(made, seen, steps=2, seed=0, count=3)
        ]
    )
    found = Diffusion(model=made, steps=2, count=3).fill(FRAME)
    np.testing.assert_allclose(found.depth_m, drawn.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(found.sigma_m, drawn.std(axis=0, ddof=1), rtol=1e-4)
    assert (found.sigma_m > 0).all()


def test_the_mode_without_gradients_does_not_stay_on_between_draws(made: model.Model) -> None:
    seen = look([FRAME], multiple=made.multiple, where=torch.device("cpu"))
    for depth in sample(made, seen, steps=1, seed=0, count=2):
        assert depth.is_inference() and not torch.is_inference_mode_enabled()


class _Knows:
    """Tells the noise as it is, knowing the depth's latents: an ideal network."""

    variant = "rgbd"
    networks = torch.nn.ModuleDict({"unet": tiny.unet()})

    def __init__(self, clean: torch.Tensor, kept: torch.Tensor) -> None:
        self.clean, self.kept = clean, kept

    def condition(self, seen: Any, vae: Any) -> torch.Tensor:
        return self.clean

    def noise(self, noisy: Any, step: Any, condition: Any, text: Any) -> torch.Tensor:
        kept = self.kept[step[0]]
        return (noisy - kept.sqrt() * self.clean) / (1 - kept).sqrt()


@pytest.mark.parametrize("steps", [1, 7])
def test_of_an_ideal_network_the_depth_comes_out(made: model.Model, steps: int) -> None:
    """Whatever noise it began with: steps, scales and decoding fit together."""
    clean = torch.randn(1, 4, 8, 10, generator=torch.Generator().manual_seed(2))
    knows: Any = _Knows(clean, made.scheduler.alphas_cumprod)
    ideal = dataclasses.replace(made, conditioning=knows)
    seen = look([FRAME], multiple=4, where=torch.device("cpu"))
    (depth,) = sample(ideal, seen, steps=steps, seed=0, count=1)
    with torch.no_grad():
        expected = latents.decode_depth(made.vae, clean)
    torch.testing.assert_close(depth, expected, rtol=1e-3, atol=1e-3)


def test_steps_begin_at_almost_pure_noise(made: model.Model) -> None:
    asked: list[int] = []
    unet: Any = made.conditioning.networks["unet"]
    handle = unet.register_forward_pre_hook(lambda _, given: asked.append(int(given[1])))
    Diffusion(model=made, steps=4).fill(FRAME)
    handle.remove()
    assert asked == [999, 749, 499, 249]


def test_weights_that_cannot_complete_are_refused(published: Path) -> None:
    with pytest.raises(InputError, match=r"^weights must be trained for completion, with 12 or 13"):
        load(published)


def test_weights_made_here_are_not_said_to_be_published(tmp_path: Path, published: Path) -> None:
    advice = r"Run starling train completion CAPTURES --start WEIGHTS --out OUT; give OUT/weights"
    with pytest.raises(InputError, match=rf"must be a folder that exists; got typo\. {advice}\.$"):
        load("typo")
    with pytest.raises(InputError, match=rf"weights must hold unet/; got .*\. {advice} whole\.$"):
        load(tmp_path)


def test_settings_refused(made: model.Model) -> None:
    with pytest.raises(InputError, match=r"^steps must be in \[1, 1000\]; got 0\. "):
        Diffusion(model=made, steps=0)
    with pytest.raises(InputError, match=r"^count must be in \[1, 1000\]; got 0\. "):
        Diffusion(model=made, count=0)
