"""Output folder of long work that can be interrupted and continued."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from starling.patterns.errors import refuse
from starling.sim.console import output, record

UNFINISHED = "unfinished.json"  # Describes the work; `starling.json` replaces it at the end.


def begin(folder: Path, arguments: Mapping[str, Any], *, force: bool) -> None:
    """Create the folder, or continue in one with interrupted work of the same arguments.

    Args:
        folder: created if missing.
        arguments: arguments of the work, plain values only.
        force: delete what starling wrote there before, finished or not.

    Raises:
        InputError: if it is a file, or holds other work, finished work without `force`, or files
            that are not from starling.
    """
    marker, text = folder / UNFINISHED, record.dumps(arguments)
    ours = marker.is_file() or (folder / output.RECORD).is_file()
    if folder.exists() and not folder.is_dir():
        raise refuse("out", "must be a folder", f"the file {folder}", "Choose another name.")
    if folder.is_dir() and any(folder.iterdir()) and not ours:
        raise refuse("out", "must be an empty or new folder", folder, "Choose another one.")
    if ours and force:
        shutil.rmtree(folder)
    elif ours and not marker.is_file():
        rule = "must be an empty or new folder"
        raise refuse("out", rule, folder, "Choose another or give --force.")
    elif ours and marker.read_text(encoding="utf-8") != text:
        rule = "must hold no other unfinished work"
        raise refuse("out", rule, folder, "Choose another, or give --force to drop it.")
    output.write_file(marker, text.encode(), force=True)


def end(folder: Path, verb: str, arguments: Mapping[str, Any], figures: Mapping[str, Any]) -> None:
    """Write the record: arguments, versions, figures.

    Raises:
        InputError: if it cannot be written.
    """
    content = {
        "verb": verb,
        "arguments": arguments,
        "versions": record.versions(),
        "figures": figures,
    }
    output.write_file(folder / output.RECORD, record.dumps(content).encode(), force=True)
    os.unlink(folder / UNFINISHED)
