"""The U-Net: its size, what it gives before it has learnt, and how far it sees."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.learning.networks.training.channels import names
from starling.learning.networks.unet import UNet, parameter_count


def _awake(inputs: int = 1) -> UNet:
    """A network whose layers that start at zero no longer are: every path is open."""
    torch.manual_seed(0)
    network = UNet(inputs)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(torch.randn_like(parameter) * 0.05)
    return network.eval()


@pytest.mark.parametrize("with_physics", [False, True])
@pytest.mark.parametrize("with_reflectance", [False, True])
def test_has_about_a_hundred_thousand_parameters(with_physics: bool, with_reflectance: bool):
    seen = names(with_reflectance=with_reflectance, with_physics=with_physics)
    assert 80_000 < parameter_count(UNet(len(seen))) < 120_000


@settings(max_examples=15)
@given(st.integers(1, 70), st.integers(1, 70), st.integers(1, 3))
def test_takes_any_size(height: int, width: int, batch: int) -> None:
    with torch.no_grad():
        given_back = _awake(2)(torch.randn(batch, 2, height, width))
    assert given_back.shape == (batch, 1, height, width)
    assert torch.isfinite(given_back).all()


def test_is_exactly_zero_before_it_has_learnt() -> None:
    assert not UNet(3)(torch.randn(2, 3, 40, 56)).any()


def test_starts_at_a_value() -> None:
    network = UNet(3)
    network.start_at(-2.5)
    assert (network(torch.randn(2, 3, 40, 56)) == -2.5).all()


@pytest.mark.parametrize("step", [(0, 100), (0, -100), (100, 0), (-100, 0)])
def test_sees_a_hundred_pixels_far(step: tuple[int, int]) -> None:
    """What lies 100 pixels off moves the answer: it says nothing on whether that is made use of."""
    image = torch.zeros(1, 1, 320, 320, requires_grad=True)
    middle = 150
    _awake()(image)[0, 0, middle, middle].backward()
    assert image.grad is not None
    assert image.grad[0, 0, middle + step[0], middle + step[1]] != 0


def test_each_pixel_has_its_own_answer() -> None:
    """Working at half resolution must not make blocks of 2x2."""
    answer = _awake()(torch.zeros(1, 1, 64, 64))[0, 0, 20:40, 20:40]
    assert (answer[::2] != answer[1::2]).all()
    assert (answer[:, ::2] != answer[:, 1::2]).all()


def test_a_crop_far_from_its_cuts_answers_as_the_whole() -> None:
    """Nothing is normalised over the image, so a crop sees the same where its cuts are far."""
    torch.manual_seed(1)
    image = torch.randn(1, 1, 640, 640)
    network = _awake()
    with torch.no_grad():
        whole, crop = network(image)[..., 300:340, 300:340], network(image[..., 64:576, 64:576])
    torch.testing.assert_close(crop[..., 236:276, 236:276], whole, rtol=0, atol=1e-5)
