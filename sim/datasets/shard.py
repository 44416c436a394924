"""Tar archives of views in the WebDataset layout, and their conversion back to folders.

A frame is a sample: files that share the name before the first dot, `0000012/0.ir_left.png`. Files
that the frames of a view share, such as `truth.png`, are repeated in each sample. Equal views give
equal bytes.
"""

from __future__ import annotations

import io
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePosixPath

from starling.sim.datasets.render_view import RenderedView


def name(number: int) -> str:
    """Return the file name of a shard."""
    return f"shard-{number:06d}.tar"


def pack(views: Sequence[RenderedView]) -> bytes:
    """Pack views into one archive, frame by frame."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for view in views:
            for member, data in _samples(view):
                entry = tarfile.TarInfo(member)
                entry.size, entry.mode = len(data), 0o644
                archive.addfile(entry, io.BytesIO(data))
    return buffer.getvalue()


def _samples(view: RenderedView) -> Iterator[tuple[str, bytes]]:
    """Yield the files of each frame under the name of its sample."""
    shared = {
        path.name: data
        for path, data in ((PurePosixPath(n), d) for n, d in view.files.items())
        if len(path.parts) == 2
    }
    for repeat in range(len(view.rows)):
        prefix = f"{view.name}/{repeat}/"
        files = {n.removeprefix(prefix): d for n, d in view.files.items() if n.startswith(prefix)}
        for file, data in sorted({**shared, **files}.items()):
            yield f"{view.name}/{repeat}.{file}", data


def unpack(archive: bytes) -> dict[str, bytes]:
    """Return the files of a shard by path in a capture set.

    Args:
        archive: bytes from `pack`.
    """
    files: dict[str, bytes] = {}
    with tarfile.open(fileobj=io.BytesIO(archive), mode="r") as read:
        for member in read:
            file = read.extractfile(member)
            assert file is not None  # The archive holds regular files only.
            files |= _placed(member.name, file.read())
    return files


def _placed(member: str, data: bytes) -> Mapping[str, bytes]:
    view, _, rest = member.partition("/")
    repeat, _, file = rest.partition(".")
    where = view if file in SHARED else f"{view}/{repeat}"
    return {f"{where}/{file}": data}


SHARED = frozenset({"camera.toml", "label.png", "room", "scene.toml", "truth.png"})
