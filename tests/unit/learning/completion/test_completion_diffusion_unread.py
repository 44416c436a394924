"""Training samples that are read when they are drawn."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("diffusers", reason="the extra completion is not installed")

from starling.learning.completion.commands.train_captures import train_diffusion
from starling.learning.completion.data.layouts import list_frames
from starling.learning.completion.diffusion.data import ListedSamples
from starling.patterns.errors import InputError
from starling.sim.captures import png
from tests.unit.command_line import Capsys
from tests.unit.learning import capture_sets
from tests.unit.learning.completion import tiny_data_sets, tiny_diffusion
from tests.unit.learning.completion.test_completion_verbs import ran


@pytest.fixture
def captures(tmp_path: Path) -> Path:
    return capture_sets.write(tmp_path / "set")


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_diffusion.write(tmp_path_factory.mktemp("weights"))


def unread(captures: Path, holes: str = "camera") -> ListedSamples:
    return ListedSamples(frames=list_frames(str(captures), "captures"), holes=holes, seed=0)


def emptied(captures: Path, numbers: Sequence[int]) -> None:
    for number in numbers:
        path = captures / capture_sets.SCENES[number] / "0" / "depth.png"
        path.write_bytes(png.encode(np.zeros(capture_sets.SHAPE, np.uint16)))


def test_a_frame_is_read_when_it_is_drawn(captures: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    real = png.read
    monkeypatch.setattr(
        png, "read", lambda path, name, **size: read.append(str(path)) or real(path, name, **size)
    )
    drawn = unread(captures)
    assert len(drawn) == 4 and drawn.identity and not read
    sample = drawn[2]
    assert all("hall-view" in path for path in read)
    truth, ndp, infrared = capture_sets.drawn(2)
    np.testing.assert_array_equal(sample.frame.valid, ~ndp)
    np.testing.assert_allclose(sample.truth_m[4:], truth[4:], atol=0.0006)
    np.testing.assert_allclose(sample.frame.rgb[..., 0], infrared / np.float32(255), rtol=1e-6)
    assert drawn.shares == {2: pytest.approx(ndp.mean())}


def test_a_frame_without_depth_is_replaced_by_the_next(captures: Path) -> None:
    emptied(captures, [3])
    drawn, whole = unread(captures), unread(captures)
    np.testing.assert_array_equal(drawn[3].frame.rgb, whole[0].frame.rgb)
    assert drawn.shares[3] == 1
    emptied(captures, range(4))
    with pytest.raises(InputError, match="frames must have depth; got none in all 4"):
        unread(captures)[1]


def test_random_holes_are_deterministic(captures: Path) -> None:
    first, again = (unread(captures, "random")[1].frame.valid for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, unread(captures)[1].frame.valid)
    assert unread(captures, "random").identity != unread(captures).identity


def test_a_changed_frame_changes_the_identity(
    captures: Path, published: Path, tmp_path: Path
) -> None:
    how = {"start": str(published), "variant": "rgbd", "at_once": 8, "seed": 0}
    frames = list_frames(str(captures), "captures")
    folder = tmp_path / "out"
    result = train_diffusion(frames, "camera", steps=1, folder=folder, **how)
    assert result["frames"] == 4 and result["left_out"] == 0 and 0 < result["hole_share"] < 1
    train_diffusion(frames, "camera", steps=1, folder=folder, **how)
    emptied(captures, [1])
    with pytest.raises(InputError, match="checkpoint must belong to this training, with the same"):
        train_diffusion(frames, "camera", steps=1, folder=folder, **how)


@pytest.mark.long
def test_training_on_two_data_sets_on_the_command_line(
    published: Path, tmp_path: Path, capsys: Capsys
) -> None:
    """Data sets with unequal image sizes, as in the paper; then evaluated."""
    place = tiny_data_sets.write("irs", tmp_path / "irs")
    streets = tiny_data_sets.write("vkitti2", tmp_path / "streets")
    out = tmp_path / "out"
    flags = ("--layout", "irs", "--also", f"vkitti2={streets}", "--start", published)
    few = ("--steps", 1, "--at-once", 8, "--variant", "controlnet")
    report = ran(capsys, "train", "completion", place, *flags, *few, "--out", out)
    assert (report["method"], report["frames"], report["left_out"]) == ("diffusion", 4, 0)
    remaining = json.loads((out / "starling.json").read_text())["arguments"]
    assert (remaining["variant"], remaining["at_once"], remaining["layout"]) == (
        "controlnet",
        8,
        "irs",
    )
    method = ("--methods", "nearest", f"diffusion={out / 'weights'}")
    flags = ("--layout", "irs", "--align", "truth", "--frames", 1, "--out", tmp_path / "judged")
    result = ran(capsys, "evaluate", "completion", place, *method, *flags)
    assert result["frames"] == 1 and list(result["methods"])[1:] == list(method[1:])
