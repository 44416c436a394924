"""Parts of published weights, read from a folder whole or refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from diffusers.models.modeling_utils import ModelMixin
from diffusers.utils import logging as diffusers_logging
from transformers.utils import logging as transformers_logging

from starling.learning.completion.diffusion.published import TRAIN
from starling.patterns.errors import refuse

# Their bars would come between this program's own.
for logging in (diffusers_logging, transformers_logging):
    logging.disable_progress_bar()


def network(kind: Any, folder: Path, name: str = "", *, published: str | None) -> Any:
    """Read a network in 32 bits; all its weights must be there, as the libraries draw the others.

    Args:
        kind: its class, of `diffusers` or `transformers`.
        folder: of the weights.
        name: of its folder in there; none where it is that folder.
        published: an id that would do, to name in a refusal; None where training here makes them.

    Raises:
        InputError: as `part`; if a weight is missing.
    """
    # The first library's other way to read wants a further package.
    diffused = issubclass(kind, ModelMixin)
    asked: dict[str, Any] = (
        {"torch_dtype": torch.float32, "low_cpu_mem_usage": False}
        if diffused
        else {"dtype": torch.float32}
    )
    read, found = part(kind, folder, name, published=published, output_loading_info=True, **asked)
    if missing := sorted(found["missing_keys"]):
        rule, got = "must be whole", f"{folder / name} without {missing[0]}"
        raise refuse("weights", rule, got, _advice(published))
    return read.eval().requires_grad_(False)


def part(kind: Any, folder: Path, name: str, *, published: str | None, **asked: Any) -> Any:
    """Read a part of any kind.

    Raises:
        InputError: if it is not there, or is of another kind or damaged.
    """
    path = folder / name
    if not path.is_dir():
        raise refuse("weights", f"must hold {name}/", folder, _advice(published))
    try:
        return kind.from_pretrained(path, local_files_only=True, **asked)
    except Exception as error:  # Whatever the libraries throw at what they cannot read.
        rule = f"must be readable as {kind.__name__}"
        raise refuse(
            "weights", rule, f"{path} ({type(error).__name__})", _advice(published)
        ) from error


def _advice(published: str | None) -> str:
    if published is None:
        return f"{TRAIN}; give OUT/weights whole."
    return f"Give a folder with all files of {published}, or of weights like it."
