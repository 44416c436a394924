"""Weight files: saving, loading and refusals."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import torch
from torch import nn

from starling.learning.networks import checkpoint
from starling.patterns.errors import InputError

CONTENT = {"weights": {"a": torch.arange(4000.0)}, "step": 3, "names": ["x", "y"]}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    checkpoint.save(tmp_path / "new folder" / "kept.pt", "network", CONTENT)
    return tmp_path / "new folder" / "kept.pt"


def test_saved_content_is_loaded(path: Path) -> None:
    content = checkpoint.load(path, "network", {"step": int})
    assert torch.equal(content["weights"]["a"], CONTENT["weights"]["a"])
    assert content["step"] == 3
    assert content["names"] == ["x", "y"]


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_refuses_a_truncated_file(path: Path, share: float) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match=r"complete file of trained weights; got .* Train again"):
        checkpoint.load(path, "network", {"step": int})


def test_refuses_a_file_damaged_in_its_middle(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(InputError, match="complete file of trained weights"):
        checkpoint.load(path, "network", {"step": int})


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"must exist; got .*none\.pt\. Train first"):
        checkpoint.load(tmp_path / "none.pt", "network", {})


def test_refuses_another_version(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "VERSION", 99)
    with pytest.raises(InputError, match="version must be 99; got 1 in"):
        checkpoint.load(path, "network", {"step": int})


def test_refuses_another_kind(path: Path) -> None:
    with pytest.raises(InputError, match="must be of 'hybrid'; got 'network' in"):
        checkpoint.load(path, "hybrid", {})


def test_a_file_of_another_program_is_refused(path: Path) -> None:
    torch.save({"weights": torch.zeros(2)}, path)
    with pytest.raises(InputError, match="written by this program"):
        checkpoint.load(path, "network", {"step": int})


class _Command:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, ("exit 1",)


def test_code_in_a_file_is_not_run(path: Path) -> None:
    torch.save({"content": _Command()}, path)
    with pytest.raises(InputError, match="complete file of trained weights"):
        checkpoint.load(path, "network", {"step": int})


def test_a_failed_write_leaves_the_old_file(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(InputError):
        checkpoint.save(path, "network", {"step": 4})
    monkeypatch.undo()
    assert checkpoint.load(path, "network", {"step": int})["step"] == 3
    assert [file.name for file in path.parent.iterdir()] == ["kept.pt"]


def test_restores_weights_that_fit() -> None:
    remaining, network = nn.Linear(3, 2), nn.Linear(3, 2)
    checkpoint.restore(network, remaining.state_dict())
    assert torch.equal(network.weight, remaining.weight)


@pytest.mark.parametrize("network", [nn.Linear(4, 2), nn.Linear(3, 2, bias=False), nn.PReLU()])
def test_weights_of_another_shape_are_refused(network: nn.Module) -> None:
    with pytest.raises(InputError, match=r"checkpoint must have .* of shape"):
        checkpoint.restore(nn.Linear(3, 2), network.state_dict())


@pytest.mark.parametrize("content", [{}, {"step": 3.0}, {"step": None}, [1], 3])
def test_content_without_its_entries_is_refused(path: Path, content: object) -> None:
    whole = {"format": "starling weights", "version": 1, "kind": "network", "content": content}
    torch.save(whole, path)
    with pytest.raises(InputError, match=r"checkpoint must have step of type int; got .*kept\.pt"):
        checkpoint.load(path, "network", {"step": int})


@pytest.mark.parametrize("weights", [{"weight": 3}, {3: torch.zeros(2)}, {}])
def test_weights_that_are_no_tensors_are_refused(weights: dict) -> None:
    with pytest.raises(InputError, match="checkpoint must have"):
        checkpoint.restore(nn.Linear(3, 2), weights)


@pytest.mark.parametrize("surplus", [{"more": torch.zeros(2)}, {"more": None}, {3: torch.zeros(2)}])
def test_surplus_weights_are_refused(surplus: dict) -> None:
    network = nn.Linear(3, 2)
    with pytest.raises(InputError, match=r"must have (more|3) of shape None; got"):
        checkpoint.restore(network, {**network.state_dict(), **surplus})


@pytest.mark.parametrize("state", [{}, {"state": {}, "param_groups": [{}]}, {"state": 3}])
def test_the_state_of_another_optimizer_is_refused(state: dict) -> None:
    optimizer = torch.optim.Adam(nn.Linear(3, 2).parameters())
    with pytest.raises(InputError, match="checkpoint must fit its optimizer"):
        checkpoint.restore_optimizer(optimizer, state)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"seen": ["depth"]}, "must be trained on infrared; got depth"),
        ({"seen": [3]}, "must be trained on infrared; got 3"),
        ({"shape": [4, "x"]}, r"must have shape \[h, w\]"),
        ({"shape": [4]}, r"must have shape \[h, w\]"),
    ],
)
def test_a_network_of_other_inputs_is_refused(tmp_path: Path, changed: dict, message: str) -> None:
    network = nn.Linear(3, 2)
    content = {"weights": network.state_dict(), "seen": ["infrared"], "shape": [4, 5]}
    checkpoint.save(tmp_path / "cnn.pt", "cnn", {**content, **changed})
    with pytest.raises(InputError, match=rf"cnn\.pt: checkpoint {message}"):
        checkpoint.load_network(tmp_path, "cnn", network, ("infrared",))


@pytest.mark.parametrize("name", ["format", "version", "kind"])
def test_a_tensor_in_place_of_a_number_is_refused(path: Path, name: str) -> None:
    whole = torch.load(path, weights_only=True)
    torch.save({**whole, name: torch.ones(2, 3)}, path)
    with pytest.raises(InputError, match="checkpoint"):
        checkpoint.load(path, "network", {"step": int})


@pytest.mark.parametrize(
    ("weights", "actual"),
    [
        (torch.ones(4, 3).to_sparse(), "no plain tensor"),
        (torch.ones(4, 3, device="meta"), "no plain tensor"),
        (torch.ones(4, 3, dtype=torch.complex64), "no plain tensor"),
        ([1.0], "no plain tensor"),
        (torch.full((4, 3), float("nan")), "numbers that are not finite"),
        (torch.full((4, 3), 1e300, dtype=torch.float64), "numbers that are not finite"),
        (torch.ones(4, 3, dtype=torch.int32), r"numbers of type torch\.int32"),
    ],
    ids=["sparse", "meta", "complex", "list", "nan", "large", "whole"],
)
def test_weights_that_do_not_fit_are_refused(weights: object, actual: str) -> None:
    network = nn.Linear(3, 4)
    with pytest.raises(InputError, match=rf"must have weight of shape \(4, 3\); got {actual}"):
        checkpoint.restore(network, {**network.state_dict(), "weight": weights})  # type: ignore[dict-item]
