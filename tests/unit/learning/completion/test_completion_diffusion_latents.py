"""Depth and images on their way into the autoencoder and back."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("diffusers", reason="the extra completion is not installed")

from starling.learning.completion.diffusion import latents
from starling.learning.completion.diffusion.seen import look, padded
from starling.learning.completion.diffusion.span import HOLE, Span
from starling.learning.completion.diffusion.spread import joined
from starling.learning.completion.frame import checked
from tests.unit.learning.completion import tiny_diffusion as tiny

CPU = torch.device("cpu")


@given(near=st.floats(0.1, 20), wide=st.floats(0.5, 50), seed=st.integers(0, 99))
def test_depth_of_the_frame_and_a_little_beyond_comes_back(
    near: float, wide: float, seed: int
) -> None:
    depth = near + wide * np.random.default_rng(seed).random((20, 30))
    span = Span.of(checked(np.zeros((20, 30)), depth, depth > 0))
    low, high = np.percentile(depth, (2, 98))
    kept = np.linspace(low - 0.12 * (high - low), high + 0.12 * (high - low), 50)
    kept = kept[kept > 0].astype(np.float32)
    np.testing.assert_allclose(span.metres(span.encoded(kept)), kept, rtol=0, atol=1e-5 * high)
    np.testing.assert_allclose(span.encoded(np.array([low, high])), [-0.8, 0.8], atol=1e-4)


def test_encoding_stays_within_what_the_autoencoder_takes_and_holes_are_nearest() -> None:
    span = Span.of(tiny.frame())
    np.testing.assert_array_equal(span.encoded(np.array([np.nan, 1e-3, 65.0])), [HOLE, -1, 1])
    assert np.isnan(span.metres(np.array([-10.0]))).all()


def test_a_wall_seen_head_on_has_a_span() -> None:
    depth = np.full((4, 5), 2.0)
    span = Span.of(checked(np.zeros((4, 5)), depth, depth > 0))
    np.testing.assert_allclose(span.metres(span.encoded(depth)), depth, rtol=1e-6)


def test_edges_go_on_to_the_next_multiple() -> None:
    image = np.arange(6.0).reshape(1, 2, 3)
    np.testing.assert_array_equal(
        padded(image, 4)[0], [[0, 1, 2, 2], [3, 4, 5, 5], [3, 4, 5, 5], [3, 4, 5, 5]]
    )
    np.testing.assert_array_equal(padded(image[:, :2, :2], 2), image[:, :2, :2])


def test_what_is_seen_of_a_frame() -> None:
    frame = tiny.frame((13, 18))
    seen = look([frame, frame], multiple=8, where=CPU)
    assert seen.image.shape == (2, 3, 16, 24) and seen.sensor.shape == (2, 1, 16, 24)
    inside = np.s_[1, :, :13, :18]
    np.testing.assert_allclose((seen.image[inside].permute(1, 2, 0) + 1) / 2, frame.rgb, atol=1e-6)
    np.testing.assert_array_equal(seen.hole[inside][0], ~frame.valid)
    assert (seen.sensor[seen.hole > 0] == HOLE).all()


def test_depth_is_coded_as_the_mode_of_a_grey_image_and_decoded_as_the_mean() -> None:
    vae = tiny.autoencoder()
    vae.register_to_config(scaling_factor=0.25)
    depth = torch.rand(2, 1, 16, 8) * 2 - 1
    with torch.no_grad():
        code = latents.encode_depth(vae, depth)
        moments = vae.quant_conv(vae.encoder(depth.repeat(1, 3, 1, 1)))  # Mean, log variance.
        torch.testing.assert_close(code, 0.25 * moments[:, :4])
        decoded = latents.decode_depth(vae, code)
        colours = vae.decoder(vae.post_quant_conv(moments[:, :4]))
        torch.testing.assert_close(decoded, colours.mean(dim=1))
    assert code.shape == (2, 4, 8, 4) and decoded.shape == (2, 16, 8)


def test_a_cell_is_missing_as_soon_as_one_pixel_is() -> None:
    mask = torch.zeros(1, 1, 8, 8)
    mask[0, 0, 3, 4] = 1
    found = latents.cells(mask, 4)
    np.testing.assert_array_equal(found[0, 0], [[0, 1], [0, 0]])


def test_mean_and_spread_of_what_is_drawn() -> None:
    drawn = np.random.default_rng(0).normal(2, 0.1, (400, 3, 4)).astype(np.float32)
    mean, sigma = joined(drawn)
    np.testing.assert_allclose(mean, 2, atol=0.03)
    np.testing.assert_allclose(sigma, 0.1, atol=0.02)
    alone, unknown = joined(drawn[:1])
    np.testing.assert_array_equal(alone, drawn[0])
    assert np.isnan(unknown).all()
