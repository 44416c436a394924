"""What a network made for text is told where there is none."""

from __future__ import annotations

import torch
from torch import Tensor
from transformers import CLIPTextModel, CLIPTokenizer


def empty_prompt(encoder: CLIPTextModel, tokenizer: CLIPTokenizer) -> Tensor:
    """Encode the empty prompt to (1, 2, d): begin and end, not padded, as in Marigold."""
    tokens = tokenizer("", padding="do_not_pad", return_tensors="pt")["input_ids"]
    with torch.no_grad():
        return encoder(torch.as_tensor(tokens, device=encoder.device))[0]
