"""The compact network: proposals, inputs, training, crops and output."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from starling.learning.completion.data.training_frame import with_random_holes
from starling.learning.completion.method import CompletionFrame, complete, make_frame
from starling.learning.completion.small import method
from starling.learning.completion.small.crops import (
    FrameCrops,
    FrameSample,
    SmallSettings,
    with_false_islands,
)
from starling.learning.completion.small.network import (
    CHANNELS,
    PROPOSALS,
    SmallNetwork,
    SmallOutput,
    final_log_depth,
    proposals,
    small_input,
)
from starling.learning.networks.unet import parameter_count
from starling.patterns.errors import InputError

SHORT = SmallSettings(steps=12, batch=2, crop_px=(32, 48), save_every=4, rate=3e-3)
NEAR, FAR = 1.0, 3.0


def scene(number: int = 0) -> FrameSample:
    """A near post before a far wall, with a half-occluded band left of the post."""
    rng = np.random.default_rng(number)
    truth = np.full((48, 64), FAR, np.float32)
    position, wide = int(rng.integers(24, 40)), int(rng.integers(6, 14))
    truth[:, position : position + wide] = NEAR
    depth = truth * rng.normal(1, 0.003, truth.shape).astype(np.float32)
    depth[:, position - 10 : position] = np.nan
    image = np.where(truth == NEAR, 200, 90).astype(np.uint8)
    return FrameSample(image=image, depth_m=depth, truth_m=truth)


def frame(sample: FrameSample) -> CompletionFrame:
    return make_frame(sample.image, sample.depth_m, np.isfinite(sample.depth_m))


def test_proposals_extend_each_side():
    sample = scene()
    depth = np.where(np.isnan(sample.depth_m), np.nan, sample.truth_m)
    whole = make_frame(sample.image, depth, np.isfinite(depth))
    named = dict(zip(PROPOSALS, proposals(whole), strict=True))
    hole = np.isnan(depth)
    np.testing.assert_array_equal(named["left"][hole], FAR)
    np.testing.assert_array_equal(named["right"][hole], NEAR)
    assert set(np.unique(named["nearest"][hole])) == {np.float32(NEAR), np.float32(FAR)}
    for item in named.values():
        np.testing.assert_array_equal(item[~hole], depth[~hole])


@given(st.integers(0, 2**31))
def test_proposals_are_finite_and_between_known_depths(seed: int):
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.5, 4, (12, 17)).astype(np.float32)
    valid = rng.random(depth.shape) < rng.uniform(0.02, 0.9)
    valid[0, 0] = True
    result = proposals(make_frame(np.zeros(depth.shape, np.uint8), depth, valid))
    low, high = depth[valid].min(), depth[valid].max()
    assert np.isfinite(result).all()
    assert (result >= low * (1 - 1e-5)).all() and (result <= high * (1 + 1e-5)).all()


def test_inputs_do_not_depend_on_scale():
    sample = scene()
    item = small_input(frame(sample))
    twice = small_input(make_frame(sample.image, 2 * sample.depth_m, np.isfinite(sample.depth_m)))
    np.testing.assert_allclose(item.channels, twice.channels, atol=1e-5)
    assert twice.median_m == pytest.approx(2 * item.median_m)
    assert item.channels.shape == (len(CHANNELS), 48, 64)


def test_untrained_it_returns_the_mean_of_proposals_and_the_sensor_depth():
    sample = scene()
    view = frame(sample)
    network = method.to_device(SmallNetwork()).eval()
    result = method.Small(network).fill(view)
    np.testing.assert_array_equal(result.depth_m[view.valid], view.depth_m[view.valid])
    expected = np.exp(np.log(proposals(view)).mean(axis=0))
    np.testing.assert_allclose(result.depth_m[~view.valid], expected[~view.valid], rtol=1e-5)
    assert (result.sigma_m > 0).all()
    assert parameter_count(network) <= 2_000_000


def test_probably_false_depth_is_replaced():
    sensor, valid = torch.zeros(1, 1, 1, 3), torch.tensor([[[[1.0, 1.0, 0.0]]]])
    message = torch.full((1, 1, 1, 3), 0.7)
    false = torch.tensor([[[[-1.0, 1.0, -1.0]]]])
    report = SmallOutput(log_depth=message, log_scale=message, false=false)
    assert final_log_depth(report, sensor, valid).flatten().tolist() == pytest.approx([0, 0.7, 0.7])


def test_it_learns_that_half_occluded_pixels_are_far(tmp_path: Path):
    """From a mean of near and far to far, on held-out scenes."""
    settings = SmallSettings(steps=40, batch=2, crop_px=(48, 64), rate=6e-3, averaging=0.8)
    learnt = method.fit([scene(n) for n in range(1, 9)], settings, folder=tmp_path, seed=0)
    sample = scene(99)
    view = frame(sample)
    hole = ~view.valid
    before = method.Small(method.to_device(SmallNetwork()).eval()).fill(view).depth_m
    after = complete(learnt, sample.image, sample.depth_m, view.valid).depth_m
    error = [float(np.abs(item - sample.truth_m)[hole].mean()) for item in (before, after)]
    assert error[1] < 0.3 * error[0]
    again = method.load(tmp_path).fill(view).depth_m
    np.testing.assert_array_equal(again, after)


class _Killed(Exception):
    pass


def _killing(items: Sequence[Any], label: str) -> Iterable[Any]:
    for count, item in enumerate(items):
        if count == 9:
            raise _Killed
        yield item


def test_resumed_training_is_bit_identical(tmp_path: Path):
    scenes = [scene(n) for n in range(3)]
    whole = method.fit(scenes, SHORT, folder=tmp_path / "whole", seed=3)
    with pytest.raises(_Killed):
        method.fit(scenes, SHORT, folder=tmp_path / "killed", seed=3, track=_killing)
    resumed = method.fit(scenes, SHORT, folder=tmp_path / "killed", seed=3)
    for name, value in whole.network.state_dict().items():
        torch.testing.assert_close(resumed.network.state_dict()[name], value, rtol=0, atol=0)
    with pytest.raises(InputError, match="checkpoint must belong to this training"):
        method.fit(scenes[:2], SHORT, folder=tmp_path / "killed", seed=3)


def test_crops_depend_on_seed_and_step():
    batches = FrameCrops(samples=[scene(n) for n in range(3)], settings=SHORT, seed=5)
    item, again, second = (
        batches.batch(7, "crops"),
        batches.batch(7, "crops"),
        batches.batch(8, "crops"),
    )
    torch.testing.assert_close(item.channels, again.channels, rtol=0, atol=0)
    assert not torch.equal(item.channels, second.channels)
    assert item.channels.shape == (2, len(CHANNELS), 32, 48)


def test_truth_and_depth_have_the_same_window():
    sample = scene()
    closed = np.where(np.isnan(sample.depth_m), sample.truth_m, sample.depth_m)
    whole = dataclasses.replace(sample, depth_m=closed)  # Without holes there are no islands.
    item = FrameCrops(samples=[whole], settings=SHORT, seed=5).batch(7, "crops")
    assert (item.sensor - item.truth).abs().max() < 0.03  # The camera's noise.


def test_false_islands_are_in_holes_and_wrong():
    rng = np.random.default_rng(0)
    sample = scene()
    original = np.isfinite(sample.depth_m)
    drawn = [with_false_islands(sample.depth_m, sample.truth_m, rng) for _ in range(200)]
    for entry in drawn:
        np.testing.assert_array_equal(entry[original], sample.depth_m[original])
    added = [np.isfinite(item) & ~original for item in drawn]
    assert 0.5 < np.mean([item.any() for item in added]) < 0.9
    assert max(item.sum() for item in added) <= 6 * 0.1 * original.sum()
    off = np.concatenate(
        [np.log(item / sample.truth_m)[new] for item, new in zip(drawn, added, strict=True)]
    )
    assert (np.abs(off) > 0.05).mean() > 0.97  # A slope can cancel part of the error.
    assert 0.6 < (off > 0).mean() < 0.9
    assert not np.array_equal(added[0], added[1])


def test_no_false_islands_without_holes_or_truth():
    rng = np.random.default_rng(0)
    sample = scene()
    unknown = np.full_like(sample.truth_m, np.nan)
    for _ in range(10):
        for depth, truth in (
            (sample.truth_m, sample.truth_m),
            (sample.depth_m, unknown),
        ):
            np.testing.assert_array_equal(with_false_islands(depth, truth, rng), depth)


def test_output_is_within_a_factor_of_two_of_the_proposals():
    """For arbitrary network outputs, as they may occur in unusual frames."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = SmallNetwork()
        torch.nn.init.normal_(network.body.head.weight, std=50)
    rng = torch.Generator().manual_seed(0)
    channels = torch.randn(1, len(CHANNELS), 32, 48, generator=rng)
    proposed = torch.randn(1, len(PROPOSALS), 32, 48, generator=rng)
    with torch.inference_mode():
        report = network(channels, proposed).log_depth
    low, high = proposed.amin(dim=1, keepdim=True), proposed.amax(dim=1, keepdim=True)
    assert (report <= high + 0.7).all() and (report >= low - 0.7).all()
    assert ((report > high) | (report < low)).any()


def test_large_frames_are_also_used_at_half_resolution():
    big = FrameSample(
        image=np.kron(scene().image, np.ones((2, 2), np.uint8)),
        depth_m=np.kron(scene().depth_m, np.ones((2, 2), np.float32)),
        truth_m=np.kron(scene().truth_m, np.ones((2, 2), np.float32)),
    )
    settings = SmallSettings(batch=8, crop_px=(48, 64))
    batches = FrameCrops(samples=[big], settings=settings, seed=0)
    truths = [truth for step in range(3) for truth in batches.batch(step, "crops").truth]
    posts = [int((truth < -0.5).any(dim=1).sum()) for truth in truths]
    assert max(posts) >= 1.8 * min(post for post in posts if post)


@pytest.mark.parametrize("place", [(0, 0), (41, 61)])
def test_a_crop_of_a_frame_with_hardly_any_depth_has_depth(place):
    """Also in batches with other frames, and at half resolution; crops of a step have one size."""
    sample = scene()
    depth = np.full_like(sample.depth_m, np.nan)
    depth[place] = 2.0
    only = dataclasses.replace(sample, depth_m=depth)
    settings = SmallSettings(batch=4, crop_px=(24, 32))
    batches = FrameCrops(samples=[sample, only], settings=settings, seed=0)
    for step in range(6):
        batch = batches.batch(step, "crops")
        assert batch.valid.shape == (4, 1, 24, 32)
        assert (batch.valid.flatten(1).sum(dim=1) >= 1).all()


def test_frames_smaller_than_a_crop_must_be_of_one_size():
    first, second = scene(), scene()
    lower = FrameSample(
        image=second.image[:30], depth_m=second.depth_m[:30], truth_m=second.truth_m[:30]
    )
    with pytest.raises(InputError, match="frames must be of one size where some are smaller"):
        FrameCrops(samples=[first, lower], settings=SmallSettings(crop_px=(48, 64)), seed=0)
    settings = SmallSettings(batch=4, crop_px=(24, 32))
    batch = FrameCrops(samples=[first, lower], settings=settings, seed=0).batch(0, "crops")
    assert batch.valid.shape == (4, 1, 24, 32)
    whole = SmallSettings(batch=2, crop_px=(512, 512))
    batch = FrameCrops(samples=[first, first], settings=whole, seed=0).batch(0, "crops")
    assert batch.valid.shape[2:] == first.depth_m.shape


def test_random_holes_have_the_same_share_at_other_places():
    sample = scene()
    second = with_random_holes(sample.depth_m, sample.truth_m, seed=0, number=0)
    was, now = np.isnan(sample.depth_m), np.isnan(second)
    assert was.sum() <= now.sum() <= was.sum() + 0.02 * was.size  # Single pixels are random.
    assert (was & now).sum() < 0.6 * was.sum()
    closed = was & ~now
    np.testing.assert_array_equal(second[closed], sample.truth_m[closed])
    unchanged = ~was & ~now
    np.testing.assert_array_equal(second[unchanged], sample.depth_m[unchanged])
    other_frame = with_random_holes(sample.depth_m, sample.truth_m, seed=0, number=1)
    assert not np.array_equal(now, np.isnan(other_frame))


def test_training_without_frames_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="frames must be at least one; got 0"):
        method.fit([], SHORT, folder=tmp_path, seed=0)
    with pytest.raises(InputError, match="checkpoint must exist"):
        method.load(tmp_path)
    with pytest.raises(InputError, match="crop_px must be in"):
        SmallSettings(crop_px=(0, 4))
