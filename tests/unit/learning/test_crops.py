"""Samples and the batches drawn from them."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.learning.data.example import Example
from starling.learning.networks import samples
from starling.learning.networks.samples import SceneSample
from starling.patterns.errors import InputError
from tests.unit.learning.step_scenes import INFO, SHAPE, step_scene

WIDE = (200, 300)


def _sample(number: int, shape: tuple[int, int] = WIDE, room: str = "") -> SceneSample:
    """Channels: number of the scene, column, row (odd)."""
    rows, columns = np.indices(shape, dtype=np.float32)
    seen = np.stack([np.full(shape, number, np.float32), columns, rows + 1])
    counted = np.ones(shape, bool)
    name = f"scene{number}"
    return SceneSample(
        scene=name, room=room or name, inputs=seen, odd=(2,), target=rows + 1, counted=counted
    )


SAMPLES = [_sample(number) for number in range(5)]
_draw = partial(samples.draw, SAMPLES, count=4, crop_px=(80, 160), hidden=0.0, seed=0, part="crops")


def test_every_scene_is_drawn_equally_often() -> None:
    drawn = Counter(
        int(number) for step in range(25) for number in _draw(step=step).inputs[:, 0, 0, 0]
    )
    assert drawn == {number: 20 for number in range(5)}


def test_the_order_differs_between_epochs() -> None:
    orders = {tuple(int(x) for x in _draw(count=5, step=i).inputs[:, 0, 0, 0]) for i in range(8)}
    assert len(orders) > 4


@settings(max_examples=20)
@given(st.integers(0, 1000))
def test_crops_are_flipped_vertically_and_never_mirrored(step: int) -> None:
    batch = _draw(step=step)
    assert (batch.inputs[:, 1].diff(dim=-1) == 1).all()
    down = batch.target[:, 0].diff(dim=1)
    upside_down = down[:, 0, 0] < 0
    assert (down == torch.where(upside_down, -1.0, 1.0)[:, None, None]).all()
    # The odd channel is flipped and has changed its sign.
    odd = batch.inputs[:, 2] * torch.where(upside_down, -1.0, 1.0)[:, None, None]
    assert torch.equal(odd, batch.target[:, 0])


def test_about_half_are_flipped() -> None:
    turned = [float(_draw(step=i).target[0, 0, :2, 0].diff()) < 0 for i in range(200)]
    assert 70 < sum(turned) < 130


def test_about_half_hide_the_hideable_channels_only() -> None:
    hiding = [dataclasses.replace(sample, hideable=((0, -7.0), (2, 0.0))) for sample in SAMPLES]
    open_, hidden = 0, 0
    for step in range(50):
        plain = _draw(step=step)
        some = samples.draw(
            hiding, count=4, crop_px=(80, 160), hidden=0.5, seed=0, step=step, part="crops"
        )
        assert torch.equal(some.target, plain.target)
        assert torch.equal(some.counted, plain.counted)
        assert torch.equal(some.inputs[:, 1], plain.inputs[:, 1])
        for crop, whole in zip(some.inputs, plain.inputs, strict=True):
            open_ += torch.equal(crop, whole)
            hidden += bool((crop[0] == -7).all() and (crop[2] == 0).all())
    assert open_ + hidden == 200
    assert 70 < hidden < 130
    assert all((sample.inputs[2] > 0).all() for sample in hiding)  # The scenes do not change.


def test_the_draw_of_a_step_does_not_depend_on_earlier_steps() -> None:
    first, again, second = _draw(step=7), _draw(step=7), _draw(step=8)
    assert torch.equal(first.inputs, again.inputs)
    assert torch.equal(first.counted, again.counted)
    assert not torch.equal(first.inputs, second.inputs)
    assert not torch.equal(first.inputs, _draw(step=7, part="device").inputs)
    assert not torch.equal(first.inputs, _draw(step=7, seed=1).inputs)


@settings(max_examples=30)
@given(st.integers(0, 1000))
def test_pixels_near_a_cut_do_not_count_but_those_at_the_image_border_do(step: int) -> None:
    batch = _draw(step=step, count=1)
    rows, columns = batch.target[0, 0] - 1, batch.inputs[0, 1]
    margin_rows, margin_columns = 20, 32  # A quarter of 80, and the greatest margin.
    expected = torch.ones_like(rows, dtype=torch.bool)
    if rows.min() > 0:
        expected &= rows >= rows.min() + margin_rows
    if rows.max() < WIDE[0] - 1:
        expected &= rows <= rows.max() - margin_rows
    if columns.min() > 0:
        expected &= columns >= columns.min() + margin_columns
    if columns.max() < WIDE[1] - 1:
        expected &= columns <= columns.max() - margin_columns
    assert torch.equal(batch.counted[0, 0] > 0, expected)


def test_images_smaller_than_a_crop_are_taken_whole() -> None:
    batch = samples.draw(
        [_sample(0, (20, 30))],
        count=2,
        crop_px=(80, 160),
        hidden=0.0,
        seed=0,
        step=0,
        part="crops",
    )
    assert batch.inputs.shape == (2, 3, 20, 30)
    assert batch.counted.all()


def test_the_digest_changes_with_a_pixel_and_a_name() -> None:
    changed = _sample(0)
    changed.target[3, 4] += 1
    other_name = dataclasses.replace(_sample(0), scene="other")
    numbers = [samples.digest([sample]) for sample in (_sample(0), changed, other_name)]
    assert len(set(numbers)) == 3
    assert samples.digest([_sample(0)]) == numbers[0]


def test_share_weights_scenes_equally() -> None:
    few, many = _sample(0, (10, 10)), _sample(1, (10, 10))
    few.target[:], many.target[:] = 1, 0
    few.counted[1:] = False
    assert samples.share([few, many]) == 0.5


def _collect(folder: Path, *examples: Example) -> Sequence[SceneSample]:
    def depth(example: Example) -> np.ndarray:
        return example.depth_m[None]

    return samples.collect(examples, depth, odd=(), target=_ndp, folder=folder)


def _ndp(example: Example) -> np.ndarray:
    return np.asarray(example.ndp)


def _all_ndp(value: bool) -> Example:
    return dataclasses.replace(step_scene(0), ndp=np.full(SHAPE, value))


def _of_another_size() -> Example:
    info = dataclasses.replace(INFO, width=32)
    images = {"ndp": np.ones((48, 32), bool), "counted": np.ones((48, 32), bool)}
    depth = np.ones((48, 32), np.float32)
    return dataclasses.replace(step_scene(1), info=info, depth_m=depth, **images)


def test_samples_have_the_counted_pixels(tmp_path: Path) -> None:
    scenes = _collect(tmp_path, step_scene(0))
    sample = scenes[0]
    assert sample.target.dtype == np.float32
    np.testing.assert_array_equal(sample.target, step_scene(0).ndp)
    np.testing.assert_array_equal(sample.counted, step_scene(0).counted)


@pytest.mark.parametrize(
    ("examples", "message"),
    [
        ([], "examples must be at least one; got 0"),
        ([_all_ndp(True)], "must be some and not all of the counted ones"),
        ([_all_ndp(False)], "must be some and not all of the counted ones; got 0 of"),
        ([dataclasses.replace(step_scene(0), ndp=None)], "must have the device's depth"),
        (
            [step_scene(0), _of_another_size()],
            "size of the training scenes, 64x48; got 32x48 in scene1",
        ),
    ],
)
def test_examples_that_cannot_be_learnt_from_are_refused(
    examples: list[Example], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        _collect(tmp_path, *examples)


def test_refuses_a_truth_of_another_size_than_the_geometry(tmp_path: Path) -> None:
    small = np.zeros((8, 8), bool)
    small[0] = True
    images = {"ndp": small, "counted": np.ones((8, 8), bool), "depth_m": np.ones((8, 8))}
    with pytest.raises(InputError, match="ndp must be 64x48"):
        _collect(tmp_path, dataclasses.replace(step_scene(0), **images))
