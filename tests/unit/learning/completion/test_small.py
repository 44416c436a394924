"""The compact network: what it chooses from, starts from, learns, keeps and leaves alone."""

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

from starling.learning.completion.frame import Frame, checked
from starling.learning.completion.method import complete
from starling.learning.completion.small import method
from starling.learning.completion.small.crops import Crops, Sample
from starling.learning.completion.small.false_islands import with_false_islands
from starling.learning.completion.small.network import SmallNetwork, Told, kept
from starling.learning.completion.small.proposals import NAMES, proposals
from starling.learning.completion.small.random_holes import with_random_holes
from starling.learning.completion.small.seen import CHANNELS, seen
from starling.learning.completion.small.settings import Settings
from starling.learning.networks.unet import parameter_count
from starling.patterns.errors import InputError

SHORT = Settings(steps=12, batch=2, crop_px=(32, 48), save_every=4, rate=3e-3)
NEAR, FAR = 1.0, 3.0


def scene(number: int = 0) -> Sample:
    """A near post before a far wall; left of it the camera is blind, as a stereo camera is."""
    rng = np.random.default_rng(number)
    truth = np.full((48, 64), FAR, np.float32)
    at, wide = int(rng.integers(24, 40)), int(rng.integers(6, 14))
    truth[:, at : at + wide] = NEAR
    depth = truth * rng.normal(1, 0.003, truth.shape).astype(np.float32)
    depth[:, at - 10 : at] = np.nan
    image = np.where(truth == NEAR, 200, 90).astype(np.uint8)
    return Sample(image=image, depth_m=depth, truth_m=truth)


def frame(sample: Sample) -> Frame:
    return checked(sample.image, sample.depth_m, np.isfinite(sample.depth_m))


def test_a_hole_goes_on_from_each_side():
    sample = scene()
    depth = np.where(np.isnan(sample.depth_m), np.nan, sample.truth_m)
    whole = checked(sample.image, depth, np.isfinite(depth))
    named = dict(zip(NAMES, proposals(whole), strict=True))
    hole = np.isnan(depth)
    np.testing.assert_array_equal(named["left"][hole], FAR)
    np.testing.assert_array_equal(named["right"][hole], NEAR)
    assert set(np.unique(named["nearest"][hole])) == {np.float32(NEAR), np.float32(FAR)}
    for one in named.values():
        np.testing.assert_array_equal(one[~hole], depth[~hole])


@given(st.integers(0, 2**31))
def test_proposals_are_known_everywhere_and_lie_between_known_depths(seed: int):
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.5, 4, (12, 17)).astype(np.float32)
    valid = rng.random(depth.shape) < rng.uniform(0.02, 0.9)
    valid[0, 0] = True
    found = proposals(checked(np.zeros(depth.shape, np.uint8), depth, valid))
    low, high = depth[valid].min(), depth[valid].max()
    assert np.isfinite(found).all()
    assert (found >= low * (1 - 1e-5)).all() and (found <= high * (1 + 1e-5)).all()


def test_scale_is_taken_out_of_what_is_seen():
    sample = scene()
    one = seen(frame(sample))
    twice = seen(checked(sample.image, 2 * sample.depth_m, np.isfinite(sample.depth_m)))
    np.testing.assert_allclose(one.channels, twice.channels, atol=1e-5)
    assert twice.median_m == pytest.approx(2 * one.median_m)
    assert one.channels.shape == (len(CHANNELS), 48, 64)


def test_before_it_has_learnt_it_gives_the_proposals_mean_and_the_camera_s_own():
    sample = scene()
    view = frame(sample)
    network = method.placed(SmallNetwork()).eval()
    found = method.Small(network).fill(view)
    np.testing.assert_array_equal(found.depth_m[view.valid], view.depth_m[view.valid])
    expected = np.exp(np.log(proposals(view)).mean(axis=0))
    np.testing.assert_allclose(found.depth_m[~view.valid], expected[~view.valid], rtol=1e-5)
    assert (found.sigma_m > 0).all()
    assert parameter_count(network) <= 2_000_000


def test_depth_that_is_likely_false_is_replaced():
    given_, valid = torch.zeros(1, 1, 1, 3), torch.tensor([[[[1.0, 1.0, 0.0]]]])
    said = torch.full((1, 1, 1, 3), 0.7)
    false = torch.tensor([[[[-1.0, 1.0, -1.0]]]])
    told = Told(log_depth=said, log_scale=said, false=false)
    assert kept(told, given_, valid).flatten().tolist() == pytest.approx([0, 0.7, 0.7])


def test_it_learns_that_what_is_hidden_is_far(tmp_path: Path):
    """From a mean of near and far to far, on scenes it has not seen."""
    settings = Settings(steps=40, batch=2, crop_px=(48, 64), rate=6e-3, averaging=0.8)
    learnt = method.fit([scene(n) for n in range(1, 9)], settings, folder=tmp_path, seed=0)
    sample = scene(99)
    view = frame(sample)
    hole = ~view.valid
    before = method.Small(method.placed(SmallNetwork()).eval()).fill(view).depth_m
    after = complete(learnt, sample.image, sample.depth_m, view.valid).depth_m
    error = [float(np.abs(one - sample.truth_m)[hole].mean()) for one in (before, after)]
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


def test_killed_training_goes_on_to_the_same_bits(tmp_path: Path):
    scenes = [scene(n) for n in range(3)]
    whole = method.fit(scenes, SHORT, folder=tmp_path / "whole", seed=3)
    with pytest.raises(_Killed):
        method.fit(scenes, SHORT, folder=tmp_path / "killed", seed=3, track=_killing)
    resumed = method.fit(scenes, SHORT, folder=tmp_path / "killed", seed=3)
    for name, value in whole.network.state_dict().items():
        torch.testing.assert_close(resumed.network.state_dict()[name], value, rtol=0, atol=0)
    with pytest.raises(InputError, match="checkpoint must be of this training"):
        method.fit(scenes[:2], SHORT, folder=tmp_path / "killed", seed=3)


def test_crops_of_a_step_follow_from_the_seed_and_its_number():
    lot = Crops(samples=[scene(n) for n in range(3)], settings=SHORT, seed=5)
    one, again, other = lot.batch(7, "crops"), lot.batch(7, "crops"), lot.batch(8, "crops")
    torch.testing.assert_close(one.channels, again.channels, rtol=0, atol=0)
    assert not torch.equal(one.channels, other.channels)
    assert one.channels.shape == (2, len(CHANNELS), 32, 48)


def test_truth_and_depth_are_cut_alike():
    sample = scene()
    closed = np.where(np.isnan(sample.depth_m), sample.truth_m, sample.depth_m)
    whole = dataclasses.replace(sample, depth_m=closed)  # Without holes nothing false is put in.
    one = Crops(samples=[whole], settings=SHORT, seed=5).batch(7, "crops")
    assert (one.given - one.truth).abs().max() < 0.03  # The camera's noise.


def test_false_islands_lie_in_holes_and_are_off():
    rng = np.random.default_rng(0)
    sample = scene()
    own = np.isfinite(sample.depth_m)
    drawn = [with_false_islands(sample.depth_m, sample.truth_m, rng) for _ in range(200)]
    for one in drawn:
        np.testing.assert_array_equal(one[own], sample.depth_m[own])
    added = [np.isfinite(one) & ~own for one in drawn]
    assert 0.5 < np.mean([one.any() for one in added]) < 0.9
    assert max(one.sum() for one in added) <= 6 * 0.1 * own.sum()
    off = np.concatenate(
        [np.log(one / sample.truth_m)[new] for one, new in zip(drawn, added, strict=True)]
    )
    assert (np.abs(off) > 0.05).mean() > 0.97  # A slope may bring a part of one back.
    assert 0.6 < (off > 0).mean() < 0.9
    assert not np.array_equal(added[0], added[1])


def test_no_false_islands_where_there_is_no_hole_or_no_truth():
    rng = np.random.default_rng(0)
    sample = scene()
    unknown = np.full_like(sample.truth_m, np.nan)
    for _ in range(10):
        for depth, truth in (
            (sample.truth_m, sample.truth_m),
            (sample.depth_m, unknown),
        ):
            np.testing.assert_array_equal(with_false_islands(depth, truth, rng), depth)


def test_what_is_said_lies_within_a_factor_of_two_of_what_is_proposed():
    """However wild the network's output is, as it may be in frames unlike all it learnt from."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = SmallNetwork()
        torch.nn.init.normal_(network.body.head.weight, std=50)
    rng = torch.Generator().manual_seed(0)
    channels = torch.randn(1, len(CHANNELS), 32, 48, generator=rng)
    proposed = torch.randn(1, len(NAMES), 32, 48, generator=rng)
    with torch.inference_mode():
        told = network(channels, proposed).log_depth
    low, high = proposed.amin(dim=1, keepdim=True), proposed.amax(dim=1, keepdim=True)
    assert (told <= high + 0.7).all() and (told >= low - 0.7).all()
    assert ((told > high) | (told < low)).any()


def test_large_frames_are_seen_at_half_their_size_too():
    big = Sample(
        image=np.kron(scene().image, np.ones((2, 2), np.uint8)),
        depth_m=np.kron(scene().depth_m, np.ones((2, 2), np.float32)),
        truth_m=np.kron(scene().truth_m, np.ones((2, 2), np.float32)),
    )
    settings = Settings(batch=8, crop_px=(48, 64))
    lot = Crops(samples=[big], settings=settings, seed=0)
    truths = [truth for step in range(3) for truth in lot.batch(step, "crops").truth]
    posts = [int((one < -0.5).any(dim=1).sum()) for one in truths]
    assert max(posts) >= 1.8 * min(post for post in posts if post)


@pytest.mark.parametrize("place", [(0, 0), (41, 61)])
def test_of_a_frame_almost_without_depth_a_crop_has_what_there_is(place):
    """Beside others, whole or at half the size: crops of one step have one size."""
    sample = scene()
    depth = np.full_like(sample.depth_m, np.nan)
    depth[place] = 2.0
    only = dataclasses.replace(sample, depth_m=depth)
    settings = Settings(batch=4, crop_px=(24, 32))
    lot = Crops(samples=[sample, only], settings=settings, seed=0)
    for step in range(6):
        batch = lot.batch(step, "crops")
        assert batch.valid.shape == (4, 1, 24, 32)
        assert (batch.valid.flatten(1).sum(dim=1) >= 1).all()


def test_frames_smaller_than_a_crop_must_be_of_one_size():
    first, second = scene(), scene()
    lower = Sample(
        image=second.image[:30], depth_m=second.depth_m[:30], truth_m=second.truth_m[:30]
    )
    with pytest.raises(InputError, match="frames must be of one size where some are smaller"):
        Crops(samples=[first, lower], settings=Settings(crop_px=(48, 64)), seed=0)
    settings = Settings(batch=4, crop_px=(24, 32))
    batch = Crops(samples=[first, lower], settings=settings, seed=0).batch(0, "crops")
    assert batch.valid.shape == (4, 1, 24, 32)
    whole = Settings(batch=2, crop_px=(512, 512))
    batch = Crops(samples=[first, first], settings=whole, seed=0).batch(0, "crops")
    assert batch.valid.shape[2:] == first.depth_m.shape


def test_random_holes_are_as_many_and_elsewhere():
    sample = scene()
    other = with_random_holes(sample, 0, 0)
    was, now = np.isnan(sample.depth_m), np.isnan(other.depth_m)
    assert was.sum() <= now.sum() <= was.sum() + 0.02 * was.size  # Single pixels are by lot.
    assert (was & now).sum() < 0.6 * was.sum()
    closed = was & ~now
    np.testing.assert_array_equal(other.depth_m[closed], sample.truth_m[closed])
    kept_ = ~was & ~now
    np.testing.assert_array_equal(other.depth_m[kept_], sample.depth_m[kept_])
    assert not np.array_equal(now, np.isnan(with_random_holes(sample, 0, 1).depth_m))


def test_nothing_to_learn_from_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="frames must be at least one; got 0"):
        method.fit([], SHORT, folder=tmp_path, seed=0)
    with pytest.raises(InputError, match="checkpoint must exist"):
        method.load(tmp_path)
    with pytest.raises(InputError, match="crop_px must be in"):
        Settings(crop_px=(0, 4))
