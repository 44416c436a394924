"""Size of diffusion-based completion with Stable Diffusion 2, and the time of one step.

    python benchmarks/learning/completion_diffusion.py [--size 768 576] [--step] [--threads 1]

Parameters are counted without allocating weights. `--step` allocates the denoising network with
random weights, which cost as much as trained ones, and runs it once (about 4 GB). Prints JSON.
"""

import argparse
import json
import resource
import time

import torch
from diffusers import AutoencoderKL, ControlNetModel, UNet2DConditionModel
from transformers import CLIPTextConfig, CLIPTextModel

from starling.learning.completion.diffusion.conditioning import widen
from starling.learning.networks.device import device
from starling.learning.networks.unet import parameter_count

# The published configurations of Stable Diffusion 2.
UNET = {
    "sample_size": 64,
    "block_out_channels": (320, 640, 1280, 1280),
    "attention_head_dim": (5, 10, 20, 20),
    "cross_attention_dim": 1024,
    "use_linear_projection": True,
}
VAE = {
    "block_out_channels": (128, 256, 512, 512),
    "down_block_types": ("DownEncoderBlock2D",) * 4,
    "up_block_types": ("UpDecoderBlock2D",) * 4,
    "layers_per_block": 2,
    "latent_channels": 4,
}
TEXT = CLIPTextConfig(
    hidden_size=1024,
    intermediate_size=4096,
    num_attention_heads=16,
    num_hidden_layers=23,
    hidden_act="gelu",
)
FLOAT_BYTES = 4
ADAM = 4  # Values per parameter: weight, gradient and two moments.


def main() -> None:
    """Print the sizes, and the time of a step if requested."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, nargs=2, default=(768, 576), help="width and height")
    parser.add_argument("--step", action="store_true", help="run one step of denoising")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    with torch.device("meta"):
        networks = {
            "unet": UNet2DConditionModel(**UNET),
            "autoencoder": AutoencoderKL(**VAE),
            "text_encoder": CLIPTextModel(TEXT),
        }
        networks["controlnet"] = ControlNetModel.from_unet(
            networks["unet"], conditioning_channels=4, load_weights_from_unet=False
        )
        for name, further in (("unet_rgbd", 0), ("unet_rgbd_mask", 1)):
            networks[name] = UNet2DConditionModel(**UNET)
            widen(networks[name], copies=3, further=further)
    counts = {name: parameter_count(network) for name, network in networks.items()}
    report = {
        "parameters": counts,
        "weights_gib": {name: _gib(count * FLOAT_BYTES) for name, count in counts.items()},
        "training_gib_before_activations": _gib(
            (ADAM * counts["unet_rgbd"] + counts["autoencoder"]) * FLOAT_BYTES
        ),
    }
    if options.step:
        report["step"] = _step(networks["unet_rgbd"], *options.size)
    print(json.dumps(report, indent=2))


def _step(network: UNet2DConditionModel, width: int, height: int) -> dict[str, object]:
    network = network.to_empty(device=device()).eval()
    with torch.inference_mode():
        for values in network.parameters():
            values.normal_(std=0.02)
        noisy = torch.randn(1, 12, height // 8, width // 8, device=device())
        text = torch.randn(1, 2, 1024, device=device())
        start = time.perf_counter()
        out = network(noisy, 500, encoder_hidden_states=text, return_dict=False)[0]
        finite = bool(out.isfinite().all())  # Synchronises with a GPU.
        seconds = time.perf_counter() - start
    return {
        "latents": [width // 8, height // 8],
        "seconds": round(seconds, 2),
        "finite": finite,
        "host_peak_gib": _gib(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024),
        "device": str(device()),
        "threads": torch.get_num_threads(),
    }


def _gib(size: int) -> float:
    return round(size / 2**30, 2)


if __name__ == "__main__":
    main()
