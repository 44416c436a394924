"""Output folder of long work that can be interrupted and continued."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from starling.patterns.errors import refuse
from starling.sim.console import lock, output, record

UNFINISHED = "unfinished.json"  # Describes the work; `starling.json` replaces it at the end.


@contextmanager
def opened(folder: Path, arguments: Mapping[str, Any], *, force: bool) -> Iterator[None]:
    """Create the folder, or continue in one with interrupted work of the same arguments.

    Other runs are refused until the context ends.

    Args:
        folder: created if missing.
        arguments: arguments of the work, plain values only.
        force: delete what starling wrote there before, finished or not.

    Raises:
        InputError: if it is a file, or holds other work, finished work without `force`, or files
            that are not from starling. Also if another run uses it.
    """
    if folder.exists() and not folder.is_dir():
        raise refuse("out", "must be a folder", f"the file {folder}", "Choose another name.")
    with output.refused(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with lock.exclusive(folder):
        with output.refused(folder):
            _begin(folder, record.dumps(arguments), force=force)
        yield


def _begin(folder: Path, text: str, *, force: bool) -> None:
    marker = folder / UNFINISHED
    ours = marker.is_file() or (folder / output.RECORD).is_file()
    if any(folder.iterdir()) and not ours:
        raise refuse("out", "must be an empty or new folder", folder, "Choose another one.")
    if ours and force:
        _empty(folder)
    elif ours and not marker.is_file():
        rule = "must be an empty or new folder"
        raise refuse("out", rule, folder, "Choose another or give --force.")
    elif ours and marker.read_text(encoding="utf-8") != text:
        rule = "must hold no other unfinished work"
        raise refuse("out", rule, folder, "Choose another, or give --force to drop it.")
    output.write_file(marker, text.encode(), force=True)


def _empty(folder: Path) -> None:
    for item in folder.iterdir():
        if item.is_dir() and not item.is_symlink():
            shutil.rmtree(item)
        else:
            item.unlink()


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
