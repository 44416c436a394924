"""Shipped models: loading, records and accuracy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from starling.learning import shipped
from starling.learning.commands.train_captures import trained
from starling.learning.completion import methods
from starling.learning.completion.method import complete
from starling.learning.completion.small import expected_error
from starling.learning.completion.small import method as small
from starling.learning.completion.small.method import Small
from starling.sim import simulate
from starling.sim.console.output import RECORD
from starling.sim.scene import sources
from starling.sim.sensor import resolve

FOLDER = Path(shipped.__file__).parent


@pytest.mark.parametrize("name", shipped.NAMES)
def test_a_shipped_model_is_loaded_by_name(name):
    method, predictor = trained(Path(name))
    assert name == f"{method}-varied"
    assert predictor.shape == (360, 640)  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", shipped.NAMES)
def test_the_record_has_no_paths_and_the_readme_names_the_model(name):
    folder = FOLDER / name
    assert {path.name for path in folder.iterdir()} == {RECORD, f"{name.split('-')[0]}.pt"}
    assert "/" not in (folder / RECORD).read_text()
    assert f"`{name}`" in (FOLDER / "README.md").read_text()


def test_the_completion_network_is_loaded_by_name():
    network = methods.create("small")
    assert isinstance(network, Small)
    learnt = small.load(shipped.COMPLETION).network.state_dict()
    for name, value in network.network.state_dict().items():
        torch.testing.assert_close(value, learnt[name], rtol=0, atol=0)
    names = {RECORD, small.WEIGHTS, expected_error.FILE}
    assert {path.name for path in shipped.COMPLETION.iterdir()} == names
    groups = [getattr(network.error, name) for name in expected_error.GROUPS]
    assert all(group.half_95 > group.half_68 and group.scale >= 1 for group in groups)
    assert "/" not in (shipped.COMPLETION / RECORD).read_text()
    assert f"`{shipped.COMPLETION.name}`" in (FOLDER / "README.md").read_text()


def test_it_completes_a_simulated_room_better_than_classical_methods():
    """A room outside the training data."""
    size = ("width=640", "height=360", "fx_px=448", "fy_px=448", "cx_px=319.5", "cy_px=179.5")
    sensor = resolve.load("d415", edits=size)
    shot = simulate.simulate(sources.load("room:2000001", sensor), sensor, seed=0)
    depth, truth_m = shot.depth, shot.layers.truth.depth_m
    holes = ~depth.valid & np.isfinite(truth_m)
    errors = {
        name: np.abs(
            complete(methods.create(name), shot.ir_left, depth.depth_m, depth.valid).depth_m
            - truth_m
        )[holes].mean()
        for name in ("small", *methods.CLASSICAL)
    }
    assert min(errors, key=lambda name: errors[name]) == "small"


def test_other_paths_are_returned_unchanged(tmp_path):
    assert shipped.folder(tmp_path) == tmp_path
    assert shipped.folder(Path("hybrid-varied")) == FOLDER / "hybrid-varied"
