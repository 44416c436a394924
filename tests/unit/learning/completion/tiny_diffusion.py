"""Tiny random weights with the folders and names of published weights."""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from diffusers import AutoencoderKL, UNet2DConditionModel
from safetensors.torch import load_file, save_file
from transformers import CLIPTextConfig, CLIPTextModel

from starling.learning.completion.diffusion.data import TrainingSample
from starling.learning.completion.method import CompletionFrame, make_frame

_OLD_NAMES = {
    ".to_q.": ".query.",
    ".to_k.": ".key.",
    ".to_v.": ".value.",
    ".to_out.0.": ".proj_attn.",
}
_SCHEDULE = {
    "_class_name": "PNDMScheduler",
    "beta_start": 0.00085,
    "beta_end": 0.012,
    "beta_schedule": "scaled_linear",
    "num_train_timesteps": 1000,
    "prediction_type": "epsilon",
    "clip_sample": False,
    "set_alpha_to_one": False,
    "skip_prk_steps": True,
    "steps_offset": 1,
}
_VOCABULARY = ["!", "!</w>", "<|startoftext|>", "<|endoftext|>"]


def unet(**changed: Any) -> UNet2DConditionModel:
    """A network of Stable Diffusion 2's architecture, two levels of 8 and 16 channels."""
    settings: dict[str, Any] = {
        "sample_size": 8,
        "in_channels": 4,
        "block_out_channels": (8, 16),
        "down_block_types": ("CrossAttnDownBlock2D", "DownBlock2D"),
        "up_block_types": ("UpBlock2D", "CrossAttnUpBlock2D"),
        "attention_head_dim": (2, 4),
        "cross_attention_dim": 12,
        "layers_per_block": 1,
        "norm_num_groups": 4,
        "use_linear_projection": True,
    }
    return _seeded(UNet2DConditionModel, **settings | changed)


def autoencoder(**changed: Any) -> AutoencoderKL:
    """An autoencoder with a downsampling factor of two."""
    settings: dict[str, Any] = {
        "block_out_channels": (8, 8),
        "down_block_types": ("DownEncoderBlock2D",) * 2,
        "up_block_types": ("UpDecoderBlock2D",) * 2,
        "latent_channels": 4,
        "norm_num_groups": 4,
        "layers_per_block": 1,
        "sample_size": 16,
    }
    return _seeded(AutoencoderKL, **settings | changed)


def write(folder: Path, *, network: UNet2DConditionModel | None = None, **schedule: Any) -> Path:
    """Write all parts, with the autoencoder's and text encoder's names of 2022."""
    (network or unet()).save_pretrained(folder / "unet")
    autoencoder().save_pretrained(folder / "vae")
    _renamed(folder / "vae" / "diffusion_pytorch_model.safetensors", _old_name)
    sizes = {"hidden_size": 12, "intermediate_size": 16, "num_hidden_layers": 1}
    text = CLIPTextConfig(
        vocab_size=4, num_attention_heads=2, max_position_embeddings=8, eos_token_id=3, **sizes
    )
    _seeded(CLIPTextModel, text).save_pretrained(folder / "text_encoder")
    _renamed(folder / "text_encoder" / "model.safetensors", _prefixed)
    _json(folder / "scheduler" / "scheduler_config.json", _SCHEDULE | schedule)
    tokens = folder / "tokenizer"
    _json(tokens / "vocab.json", {word: number for number, word in enumerate(_VOCABULARY)})
    (tokens / "merges.txt").write_text("#version: 0.2\n")
    _json(tokens / "tokenizer_config.json", {"model_max_length": 77})
    return folder


def frame(shape: tuple[int, int] = (13, 18), seed: int = 0) -> CompletionFrame:
    """A slanted wall with a hole."""
    height, width = shape
    rng = np.random.default_rng(seed)
    depth = np.linspace(1, 2, width)[None] + 0.01 * rng.standard_normal(shape)
    valid = np.ones(shape, bool)
    valid[height // 3 : 2 * height // 3, width // 3 : width // 2] = False
    return make_frame(rng.random((height, width, 3)), depth, valid)


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """Samples in memory."""

    samples: Sequence[TrainingSample]

    @property
    def identity(self) -> str:
        arrays = [
            (sample.frame.rgb, sample.frame.depth_m, sample.truth_m) for sample in self.samples
        ]
        return str([zlib.crc32(np.ascontiguousarray(item).data) for row in arrays for item in row])

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, number: int) -> TrainingSample:
        return self.samples[number]


def _seeded(kind: Any, *inputs: Any, **named: Any) -> Any:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return kind(*inputs, **named).eval()


def _old_name(name: str) -> str:
    for new, old in _OLD_NAMES.items():
        name = name.replace(new, old)
    return name


def _prefixed(name: str) -> str:
    return name if name.startswith("text_model.") else f"text_model.{name}"


def _renamed(path: Path, rename: Any) -> None:
    weights = load_file(path)
    save_file({rename(name): value for name, value in weights.items()}, path, {"format": "pt"})


def _json(path: Path, content: dict[str, Any]) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(content))
