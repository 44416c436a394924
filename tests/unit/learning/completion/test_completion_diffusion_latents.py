"""Encoding and decoding of depth and images."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("diffusers", reason="the extra completion is not installed")

from starling.learning.completion.diffusion.method import mean_and_std
from starling.learning.completion.diffusion.span import (
    HOLE,
    Span,
    cells,
    decode_depth,
    encode_depth,
    network_input,
    pad_edges,
)
from starling.learning.completion.method import make_frame
from tests.unit.learning.completion import tiny_diffusion

CPU = torch.device("cpu")


@given(near=st.floats(0.1, 20), wide=st.floats(0.5, 50), seed=st.integers(0, 99))
def test_depth_up_to_beyond_the_span_is_recovered(near: float, wide: float, seed: int) -> None:
    depth = near + wide * np.random.default_rng(seed).random((20, 30))
    span = Span.from_frame(make_frame(np.zeros((20, 30)), depth, depth > 0))
    low, high = np.percentile(depth, (2, 98))
    remaining = np.linspace(low - 0.12 * (high - low), high + 0.12 * (high - low), 50)
    remaining = remaining[remaining > 0].astype(np.float32)
    np.testing.assert_allclose(
        span.decode(span.encode(remaining)), remaining, rtol=0, atol=1e-5 * high
    )
    np.testing.assert_allclose(span.encode(np.array([low, high])), [-0.8, 0.8], atol=1e-4)


def test_encoding_is_clipped_and_holes_have_the_lowest_value() -> None:
    span = Span.from_frame(tiny_diffusion.frame())
    np.testing.assert_array_equal(span.encode(np.array([np.nan, 1e-3, 65.0])), [HOLE, -1, 1])
    assert np.isnan(span.decode(np.array([-10.0]))).all()


def test_a_wall_seen_head_on_has_a_span() -> None:
    depth = np.full((4, 5), 2.0)
    span = Span.from_frame(make_frame(np.zeros((4, 5)), depth, depth > 0))
    np.testing.assert_allclose(span.decode(span.encode(depth)), depth, rtol=1e-6)


def test_edges_are_padded_to_the_next_multiple() -> None:
    image = np.arange(6.0).reshape(1, 2, 3)
    np.testing.assert_array_equal(
        pad_edges(image, 4)[0], [[0, 1, 2, 2], [3, 4, 5, 5], [3, 4, 5, 5], [3, 4, 5, 5]]
    )
    np.testing.assert_array_equal(pad_edges(image[:, :2, :2], 2), image[:, :2, :2])


def test_network_input_of_a_frame() -> None:
    frame = tiny_diffusion.frame((13, 18))
    seen = network_input([frame, frame], multiple=8, device=CPU)
    assert seen.image.shape == (2, 3, 16, 24) and seen.sensor.shape == (2, 1, 16, 24)
    inside = np.s_[1, :, :13, :18]
    np.testing.assert_allclose((seen.image[inside].permute(1, 2, 0) + 1) / 2, frame.rgb, atol=1e-6)
    np.testing.assert_array_equal(seen.hole[inside][0], ~frame.valid)
    assert (seen.sensor[seen.hole > 0] == HOLE).all()


def test_depth_is_encoded_as_the_mode_of_a_grey_image_and_decoded_as_the_mean() -> None:
    vae = tiny_diffusion.autoencoder()
    vae.register_to_config(scaling_factor=0.25)
    depth = torch.rand(2, 1, 16, 8) * 2 - 1
    with torch.no_grad():
        code = encode_depth(vae, depth)
        moments = vae.quant_conv(vae.encoder(depth.repeat(1, 3, 1, 1)))  # Mean, log variance.
        torch.testing.assert_close(code, 0.25 * moments[:, :4])
        decoded = decode_depth(vae, code)
        colours = vae.decoder(vae.post_quant_conv(moments[:, :4]))
        torch.testing.assert_close(decoded, colours.mean(dim=1))
    assert code.shape == (2, 4, 8, 4) and decoded.shape == (2, 16, 8)


def test_a_cell_with_one_missing_pixel_is_missing() -> None:
    mask = torch.zeros(1, 1, 8, 8)
    mask[0, 0, 3, 4] = 1
    result = cells(mask, 4)
    np.testing.assert_array_equal(result[0, 0], [[0, 1], [0, 0]])


def test_mean_and_standard_deviation_of_samples() -> None:
    drawn = np.random.default_rng(0).normal(2, 0.1, (400, 3, 4)).astype(np.float32)
    mean, sigma = mean_and_std(drawn)
    np.testing.assert_allclose(mean, 2, atol=0.03)
    np.testing.assert_allclose(sigma, 0.1, atol=0.02)
    alone, unknown = mean_and_std(drawn[:1])
    np.testing.assert_array_equal(alone, drawn[0])
    assert np.isnan(unknown).all()
