"""Published weights: where they lie on this machine."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import huggingface_hub

from starling.patterns.errors import refuse

TRAIN = "Run starling train completion CAPTURES --start WEIGHTS --out OUT"
_ID = re.compile(r"[\w.-]+/[\w.-]+")  # Of a hub: owner/name.
_SPARE = ("*fp16*", "*non_ema*", "*.ckpt", "*.bin")  # The same weights in other forms.


def folder(source: Path | str, *, published: str | None, files: Sequence[str]) -> Path:
    """Find weights in a folder, or get them from the hub, which keeps them on this machine.

    Args:
        source: a folder, or an id `owner/name`.
        published: an id that would do, to name in a refusal; None where training here makes them.
        files: patterns of what is needed, of the hub's.

    Raises:
        InputError: if there is no such folder and it is no id, or the hub does not give it.
    """
    if (path := Path(source)).is_dir():
        return path
    advice = f"Get them where there is a net: hf download {published} --local-dir DIR; give DIR."
    if published is None:
        advice = f"{TRAIN}; give OUT/weights."
    if isinstance(source, Path) or not _ID.fullmatch(source):
        raise refuse("weights", "must be a folder that exists", source, advice)
    try:
        found = huggingface_hub.snapshot_download(
            source, allow_patterns=[*files], ignore_patterns=[*_SPARE]
        )
    except (OSError, ValueError) as error:
        rule, got = "must be a folder or found on the hub", f"{source} ({type(error).__name__})"
        raise refuse("weights", rule, got, advice) from error
    return Path(found)
