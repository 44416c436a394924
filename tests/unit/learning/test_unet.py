"""The U-Net: size, output before training, and receptive field."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.learning.networks.channels import names
from starling.learning.networks.unet import UNet, parameter_count


def _randomised(inputs: int = 1) -> UNet:
    """A network whose zero-initialised layers are random, so that every path is active."""
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
        given_back = _randomised(2)(torch.randn(batch, 2, height, width))
    assert given_back.shape == (batch, 1, height, width)
    assert torch.isfinite(given_back).all()


def test_is_exactly_zero_before_training() -> None:
    assert not UNet(3)(torch.randn(2, 3, 40, 56)).any()


def test_starts_at_a_value() -> None:
    network = UNet(3)
    network.start_at(-2.5)
    assert (network(torch.randn(2, 3, 40, 56)) == -2.5).all()


@pytest.mark.parametrize("step", [(0, 100), (0, -100), (100, 0), (-100, 0)])
def test_the_receptive_field_is_a_hundred_pixels(step: tuple[int, int]) -> None:
    """Pixels at a distance of 100 have an effect; whether training uses it is not tested."""
    image = torch.zeros(1, 1, 320, 320, requires_grad=True)
    middle = 150
    _randomised()(image)[0, 0, middle, middle].backward()
    assert image.grad is not None
    assert image.grad[0, 0, middle + step[0], middle + step[1]] != 0


def test_each_pixel_has_its_own_output() -> None:
    """Working at half resolution must not give blocks of 2x2."""
    answer = _randomised()(torch.zeros(1, 1, 64, 64))[0, 0, 20:40, 20:40]
    assert (answer[::2] != answer[1::2]).all()
    assert (answer[:, ::2] != answer[:, 1::2]).all()


def test_a_crop_equals_the_whole_far_from_its_cuts() -> None:
    """Nothing is normalised over the image, so crops are equal far from their cuts."""
    torch.manual_seed(1)
    image = torch.randn(1, 1, 640, 640)
    network = _randomised()
    with torch.no_grad():
        whole, crop = network(image)[..., 300:340, 300:340], network(image[..., 64:576, 64:576])
    torch.testing.assert_close(crop[..., 236:276, 236:276], whole, rtol=0, atol=1e-5)
