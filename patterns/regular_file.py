"""Reading of regular files: pipes and devices block, or never end."""

from __future__ import annotations

import errno
from pathlib import Path


def read(path: Path) -> bytes:
    """Read a file that is no pipe or device.

    Raises:
        OSError: if it cannot be read, does not fit into memory, is a pipe or device, or has a
            null byte in its name.
    """
    refuse_others(path)
    try:
        return path.read_bytes()
    except MemoryError as error:
        raise OSError(errno.ENOMEM, "It does not fit into memory", str(path)) from error


def refuse_others(path: Path) -> None:
    """Refuse a pipe or device, and a name with a null byte.

    Raises:
        OSError: as said.
    """
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "Its name has a null byte")
    if is_pipe_or_device(path):
        raise OSError(errno.EINVAL, "It is a pipe or a device", str(path))


def is_pipe_or_device(path: Path) -> bool:
    """Return whether a path exists and is neither a regular file nor a folder."""
    return path.exists() and not (path.is_file() or path.is_dir())
