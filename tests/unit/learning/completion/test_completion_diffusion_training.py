"""Training of diffusion: loss, batches, restarts and refusals."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

pytest.importorskip("diffusers", reason="the extra completion is not installed")

from starling import command_line
from starling.learning.completion.diffusion import (
    VARIANTS,
    Variant,
    method,
    model,
    training,
    weights,
)
from starling.learning.completion.diffusion.data import (
    DiffusionBatch,
    TrainingSample,
    draw_batches,
    random_crop,
)
from starling.learning.completion.diffusion.method import Diffusion
from starling.learning.completion.diffusion.training import DiffusionSettings, train
from starling.learning.completion.method import make_frame
from starling.patterns.errors import InputError
from tests.unit.learning import capture_sets
from tests.unit.learning.completion import tiny_diffusion

CPU = torch.device("cpu")
SHORT = DiffusionSettings(steps=5, batch=3, at_once=2, save_every=2, rate=1e-3)


def _sample(seed: int, shape: tuple[int, int] = (13, 18)) -> TrainingSample:
    frame = tiny_diffusion.frame(shape, seed)
    return TrainingSample(
        frame, np.linspace(1, 2, shape[1], dtype=np.float32)[None].repeat(shape[0], 0)
    )


SAMPLES = [_sample(seed) for seed in range(4)]
HELD = tiny_diffusion.Held(SAMPLES)
WHOLE: Any = {"crop_px": (512, 512), "multiple": 4, "device": CPU}


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_diffusion.write(tmp_path_factory.mktemp("weights"))


class _Killed(Exception):
    pass


def _kill(after: int) -> Any:
    def track(items: Sequence[Any], label: str) -> Iterable[Any]:
        for count, item in enumerate(items):
            if count == after:
                raise _Killed
            yield item

    return track


# Each takes half a minute; the variants share all code but the first layer.
EACH_VARIANT = [
    VARIANTS[0],
    *(pytest.param(variant, marks=pytest.mark.long) for variant in VARIANTS[1:]),
]


@pytest.mark.parametrize("variant", EACH_VARIANT)
def test_resumed_training_is_bit_identical(
    published: Path, variant: Variant, tmp_path: Path
) -> None:
    def run(folder: str, **how: Any) -> model.DiffusionModel:
        parts = weights.load(published)
        return train(parts, variant, HELD, SHORT, folder=tmp_path / folder, seed=3, **how)

    whole = run("whole")
    with pytest.raises(_Killed):
        run("killed", track=_kill(after=3))
    resumed = run("killed")
    read = model.trained_model(tmp_path / "killed" / training.WEIGHTS)
    expected = whole.conditioning.networks.state_dict()
    for second in (resumed, read):
        assert second.conditioning.variant == variant
        result = second.conditioning.networks.state_dict()
        assert result.keys() == expected.keys()
        for name, value in expected.items():
            assert torch.equal(result[name], value), name
    curves = [(tmp_path / name / training.CURVE).read_text() for name in ("whole", "killed")]
    assert curves[0] == curves[1] and curves[0].count("\n") == 6


@pytest.mark.parametrize("variant", EACH_VARIANT)
def test_the_loss_of_one_batch_decreases(published: Path, variant: Variant) -> None:
    """One sample, at fixed steps and with fixed noise."""
    built = model.untrained_model(weights.load(published), variant, seed=0)
    batch = _batch(SAMPLES[:1], 6)
    optimizer = torch.optim.Adam(training.trainable_parameters(built.conditioning), lr=3e-3)
    losses = []
    for _ in range(25):
        optimizer.zero_grad()
        loss = training.loss(built, batch, seed=0).mean()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < 0.8 * losses[0], losses


def _batch(samples: Sequence[TrainingSample], count: int) -> DiffusionBatch:
    (batch,) = draw_batches(
        tiny_diffusion.Held(samples), step=0, count=count, at_once=count, seed=0, **WHOLE
    )
    return batch


def test_the_loss_of_a_zero_prediction_is_the_variance_of_the_noise(published: Path) -> None:
    built = model.untrained_model(weights.load(published), "rgbd", seed=0)
    for value in built.conditioning.networks["unet"].get_submodule("conv_out").parameters():
        torch.nn.init.zeros_(value)
    loss = training.loss(built, _batch(SAMPLES, 40), seed=0)
    assert loss.shape == (40,)
    # 4 x 6 x 9 cells of 4 numbers a sample, without padding: std < 0.02.
    assert abs(loss.mean().item() - 1) < 0.1


def test_only_cells_with_known_truth_count(published: Path) -> None:
    """The noise predicted at other cells has no effect."""
    truth = SAMPLES[0].truth_m.copy()
    truth[:, 10:] = np.nan
    sample = TrainingSample(SAMPLES[0].frame, truth)
    assert _counted(published, "rgbd", sample) == {
        (row, column) for row in range(6) for column in range(5)
    }


def test_only_holes_count_with_the_mask(published: Path) -> None:
    """The hole is at rows 4 to 7, columns 6 to 8 of pixels; a cell is 2x2."""
    assert _counted(published, "rgbd-mask", SAMPLES[0]) == {
        (row, column) for row in (2, 3) for column in (3, 4)
    }


def _counted(published: Path, variant: Variant, sample: TrainingSample) -> set[tuple[int, int]]:
    """Cells whose predicted noise has an effect on the loss."""
    built = model.untrained_model(weights.load(published), variant, seed=0)
    report: list[torch.Tensor] = []

    def keep(module: Any, inputs: Any, output: Any) -> Any:
        report.append(output[0])
        output[0].retain_grad()
        return output

    built.conditioning.networks["unet"].register_forward_hook(keep)
    training.loss(built, _batch([sample], 1), seed=0).sum().backward()
    gradient = report[0].grad
    assert gradient is not None
    rows, columns = np.nonzero(gradient[0].abs().sum(dim=0).numpy())
    return {(int(row), int(column)) for row, column in zip(rows, columns, strict=True)}


def test_a_step_does_not_depend_on_the_batch_on_the_device(published: Path, tmp_path: Path) -> None:
    """Up to rounding."""
    curves = []
    for at_once in (1, 3):
        settings = dataclasses.replace(SHORT, at_once=at_once, steps=2, rate=1e-4)
        folder = tmp_path / str(at_once)
        train(weights.load(published), "rgbd", HELD, settings, folder=folder, seed=0)
        lines = (folder / training.CURVE).read_text().splitlines()[1:]
        curves.append([float(line.split(",")[1]) for line in lines])
    np.testing.assert_allclose(curves[0], curves[1], rtol=1e-4)


def test_every_sample_occurs_once_per_epoch() -> None:
    seen = [
        float(batch.inputs.image[place].sum())
        for step in range(4)
        for batch in draw_batches(HELD, step=step, count=2, at_once=2, seed=1, **WHOLE)
        for place in range(2)
    ]
    assert len(set(seen[:4])) == 4 and sorted(seen[:4]) == sorted(seen[4:])


def test_defaults_are_the_papers() -> None:
    assert (DiffusionSettings().steps, DiffusionSettings().batch, DiffusionSettings().rate) == (
        36_000,
        32,
        3e-5,
    )
    assert DiffusionSettings().crop_px == (8 * 64, 8 * 64)


def test_truth_is_unknown_in_the_padding_of_a_mixed_batch() -> None:
    batch = _batch([_sample(0, (9, 18)), _sample(1, (13, 10))], 2)
    assert batch.truth.shape == batch.inputs.image[:, :1].shape == (2, 1, 16, 20)
    known = 1 - batch.unknown[:, 0]
    assert sorted(known.sum(dim=(1, 2)).tolist()) == [13 * 10, 9 * 18]


def test_crops_are_aligned_and_random() -> None:
    rows, columns = np.mgrid[:40, :60].astype(np.float32)
    depth = (1 + rows + 100 * columns) / 1000
    frame = make_frame(depth / 10, depth, np.ones(depth.shape, bool))
    whole = TrainingSample(frame, depth)
    corners = set()
    for seed in range(20):
        part = random_crop(whole, (16, 24), np.random.default_rng(seed))
        assert part.frame.shape == part.truth_m.shape == (16, 24)
        np.testing.assert_array_equal(part.frame.depth_m, part.truth_m)
        np.testing.assert_allclose(part.frame.rgb[..., 0], part.truth_m / 10, rtol=1e-6)
        corners.add(float(part.truth_m[0, 0]))
    assert len(corners) > 15
    assert random_crop(whole, (512, 512), np.random.default_rng(0)) is whole
    assert random_crop(whole, (512, 24), np.random.default_rng(0)).frame.shape == (40, 24)


def test_a_crop_has_depth_even_if_the_frame_has_hardly_any() -> None:
    depth = np.full((40, 60), np.nan, np.float32)
    depth[39, 0] = 1
    frame = make_frame(np.zeros(depth.shape), depth, np.isfinite(depth))
    for seed in range(5):
        part = random_crop(TrainingSample(frame, depth), (16, 24), np.random.default_rng(seed))
        assert part.frame.shape == (16, 24) and part.frame.valid.sum() == 1


def test_trained_weights_complete(published: Path, tmp_path: Path) -> None:
    settings = dataclasses.replace(SHORT, steps=1)
    built = train(weights.load(published), "rgbd", HELD, settings, folder=tmp_path, seed=0)
    result = Diffusion(model=built, steps=2).fill(SAMPLES[0].frame)
    assert result.depth_m.shape == (13, 18)


def _other_size() -> list[TrainingSample]:
    return [TrainingSample(SAMPLES[0].frame, SAMPLES[0].truth_m[1:])]


def _no_depth() -> list[TrainingSample]:
    frame = tiny_diffusion.frame()
    blind = dataclasses.replace(frame, valid=np.zeros_like(frame.valid))
    return [TrainingSample(blind, SAMPLES[0].truth_m)]


def _endless() -> list[TrainingSample]:
    frame = tiny_diffusion.frame()
    return [TrainingSample(dataclasses.replace(frame, rgb=frame.rgb * np.inf), SAMPLES[0].truth_m)]


@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")
@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (list, "samples must be at least one; got 0. "),
        (_other_size, "frame and truth must have one size; got (13, 18) and (12, 18)"),
        (_no_depth, "samples must have sensor depth; got none in sample 0. "),
        (_endless, "loss must be a finite number; got nan. Stopped at batch 0: "),
    ],
)
def test_samples_refused(published: Path, samples: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        train(
            weights.load(published),
            "rgbd",
            tiny_diffusion.Held(samples()),
            SHORT,
            folder=tmp_path,
            seed=0,
        )
    assert str(error.value).startswith(message)


def test_settings_refused() -> None:
    with pytest.raises(InputError, match=r"^at_once must be in \[1, 1e\+07\]; got 0\. "):
        DiffusionSettings(at_once=0)
    with pytest.raises(InputError, match=r"^rate must be > 0; got 0\. "):
        DiffusionSettings(rate=0)
    with pytest.raises(InputError, match=r"^crop_px must be in \[1, 16384\]; got 0\. "):
        DiffusionSettings(crop_px=(0, 512))


def test_checkpoint_of_another_training_is_refused(published: Path, tmp_path: Path) -> None:
    settings = dataclasses.replace(SHORT, steps=1)
    train(weights.load(published), "rgbd", HELD, settings, folder=tmp_path, seed=0)
    with pytest.raises(
        InputError, match=r"training\.pt: checkpoint must belong to this training, with the same "
    ):
        train(weights.load(published), "rgbd", HELD, settings, folder=tmp_path, seed=1)


def test_weights_without_checkpoint_are_refused(published: Path, tmp_path: Path) -> None:
    (tmp_path / training.WEIGHTS).mkdir()
    with pytest.raises(InputError, match=r"^folder must not hold weights/ of another training; "):
        train(weights.load(published), "rgbd", HELD, SHORT, folder=tmp_path, seed=0)


def test_training_and_completion_on_the_command_line(
    published: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(method, "Diffusion", partial(Diffusion, steps=2))
    captures, out = capture_sets.write(tmp_path / "set"), tmp_path / "trained"
    flags = ["--start", str(published), "--variant", "rgbd-mask", "--steps", "1"]
    assert command_line.main(["train", "completion", str(captures), "--out", str(out), *flags]) == 0
    word = f"diffusion={out / 'weights'}"
    done = tmp_path / "done"
    arguments = ["complete", str(captures), "--method", word, "--out", str(done), "--json"]
    assert command_line.main(arguments) == 0
    report = json.loads("{" + capsys.readouterr().out.rpartition("\n{")[2])
    assert report["frames"] == 4 and report["method"] == word


def test_missing_packages_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    captures = capture_sets.write(tmp_path / "set")
    monkeypatch.setitem(sys.modules, "starling.learning.completion.diffusion.training", None)
    flags = ["--out", str(tmp_path / "out"), "--start", "anywhere"]
    assert command_line.main(["train", "completion", str(captures), *flags]) == 1
    assert (
        "diffusion needs starling.learning.completion.diffusion.training" in capsys.readouterr().err
    )
